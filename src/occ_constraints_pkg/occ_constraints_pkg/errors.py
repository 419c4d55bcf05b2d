# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The one exception for mistakes that a user can mend."""

from importlib import import_module
from typing import Any

# Top-level module -> the extra that brings it with pip. ROS packages have many more names, all
# of which mean the extra 'ros'.
_EXTRAS = {
    'torch': 'train',
    'mujoco': 'train',
    'matplotlib': 'report',
    'jinja2': 'report',
    'sklearn': 'dev',
    'rclpy': 'ros',
}


class OccError(Exception):
    """A user's mistake or a faulty input, told in one sentence.

    The sentence says what is wrong, where (file, key, topic), what was found there and what is
    allowed. The command line prints it without a traceback and exits with code 2.
    """


def import_needed(what: str, module: str) -> Any:
    """Import a module of ours that needs an extra, or a module that comes with one.

    Args:
        what: who needs it, for the message.
        module: its full name.

    Raises:
        OccError: something it imports is not installed; the sentence says what to install.
    """
    try:
        return import_module(module)
    except ModuleNotFoundError as error:
        missing = (error.name or '').partition('.')[0]
        is_ros = missing.endswith(('_msgs', '_srvs', '_interfaces'))
        if missing in ('', __name__.partition('.')[0]):
            # A part of this package is missing, which a user cannot mend.
            raise
        extra = _EXTRAS.get(missing, 'ros' if is_ros else '')
        hint = ', or source the ROS 2 setup file' if extra == 'ros' else ''
        if not extra:
            hint = ', or activate the virtual environment that has it (source .venv/bin/activate)'
        raise OccError(
            f'{what} needs the module {missing!r}, which is not installed: '
            f"pip install 'occ_constraints_pkg{f'[{extra}]' if extra else ''}'{hint}"
        ) from error
