# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Exceptions for mistakes that a user can fix, with types that a program can act on."""

from importlib import import_module
from typing import Any

from occ_constraints_pkg.terminal import printable

# Top-level module -> the extra that installs it. ROS packages have many more names, all of which
# belong to the extra 'ros'.
EXTRAS = {
    'torch': 'train',
    'mujoco': 'train',
    'gymnasium': 'train',
    'highway_env': 'train',
    'matplotlib': 'report',
    'jinja2': 'report',
    'textual': 'report',
    'rich': 'report',
    'sklearn': 'dev',
    'pandas': 'dev',
    'uvicorn': 'dashboard',
    'h11': 'dashboard',
    'rclpy': 'ros',
}


class OccError(Exception):
    """A mistake of the user or a faulty input, described in one sentence.

    The sentence says what is wrong, where (file, key, topic), what was found and what is allowed.
    The command line prints it without a traceback and exits with code 2. Control characters are
    escaped, so that it stays on one line.

    Example:
        >>> try:
        ...     occ.load_feature_map('PointGaol1')
        ... except occ.OccError as error:
        ...     print(error)
        there is no feature map 'PointGaol1'; did you mean 'PointGoal1'? allowed are ...
    """

    def __str__(self) -> str:
        return printable(super().__str__())


class ConfigurationError(OccError, ValueError):
    """A setting, option, parameter, feature map or constraints file is not allowed as it is.

    Example:
        >>> occ.learn('bags/simple_nav_expert', 'simple_nav', contamination=2.0)
        Traceback (most recent call last):
        occ_constraints_pkg.errors.ConfigurationError: ...2.0; allowed is 0 <= contamination < 1
    """


class DataError(OccError, ValueError):
    """A recording, table or file of results cannot be read, or lacks what is asked of it.

    Example:
        >>> occ.learn('bags/simple_nav_expert')
        Traceback (most recent call last):
        occ_constraints_pkg.errors.DataError: ... a recording needs a feature map: -m FILE or a name
    """


class InputError(OccError, ValueError):
    """A message or a topic cannot be used by a running node.

    Example:
        >>> issubclass(occ.InputError, ValueError)
        True
    """


class MissingDependencyError(OccError, ImportError):
    """A required package is not installed; the sentence says how to install it.

    Example:
        >>> issubclass(occ.MissingDependencyError, ImportError)
        True
    """


def import_needed(what: str, module: str) -> Any:
    """Import a module of ours that needs an extra, or a module that comes with one.

    Args:
        what: who needs it, for the message.
        module: its full name.

    Raises:
        MissingDependencyError: something it imports is not installed; the sentence names the
            extra that brings it.
    """
    try:
        return import_module(module)
    except ModuleNotFoundError as error:
        if (told := missing_extra(what, error)) is None:
            # A damaged installation or a bug, which a user cannot fix.
            raise
        raise told from error


def missing_extra(what: str, error: ImportError) -> MissingDependencyError | None:
    """Return the sentence that names the extra a missing module comes with; None if none has it.

    Args:
        what: who needs the module.
        error: why it could not be imported.
    """
    missing = (error.name or '').partition('.')[0]
    is_ros = missing.endswith(('_msgs', '_srvs', '_interfaces'))
    extra = EXTRAS.get(missing, 'ros' if is_ros else '')
    if not (extra and isinstance(error, ModuleNotFoundError)):
        return None
    hint = ', or source the ROS 2 setup file' if extra == 'ros' else ''
    return MissingDependencyError(
        f'{what} needs the module {missing!r}, which is not installed: '
        f"pip install 'occ_constraints_pkg[{extra}]'{hint}"
    )
