# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The one exception for mistakes that a user can mend."""

# Top-level module -> the extra that brings it with pip. ROS packages have many more names, all
# of which mean the extra 'ros'.
_EXTRAS = {
    'torch': 'train',
    'mujoco': 'train',
    'matplotlib': 'report',
    'jinja2': 'report',
    'rclpy': 'ros',
}


class OccError(Exception):
    """A user's mistake or a faulty input, told in one sentence.

    The sentence says what is wrong, where (file, key, topic), what was found there and what is
    allowed. The command line prints it without a traceback and exits with code 2.
    """


def missing_extra(what: str, error: ModuleNotFoundError) -> OccError:
    """Return the sentence that tells which extra brings a module that is not installed.

    Args:
        what: who needs it, for example ``node 'monitor'``.
        error: what the import raised.

    Raises:
        ModuleNotFoundError: ``error`` itself, when no extra brings the module: then the
            installation is damaged or the code wrong, and a user cannot mend it.
    """
    module = (error.name or '').partition('.')[0]
    extra = _EXTRAS.get(module, 'ros' if module.endswith(('_msgs', '_srvs', '_interfaces')) else '')
    if not extra:
        raise error
    hint = ', or source the ROS 2 setup file' if extra == 'ros' else ''
    return OccError(
        f'{what} needs the module {module!r}, which is not installed: '
        f"pip install 'occ_constraints_pkg[{extra}]'{hint}"
    )
