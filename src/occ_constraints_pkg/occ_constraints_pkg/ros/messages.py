# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Stamps, and the Python classes of message types that are known by name only."""

from __future__ import annotations

import os
import re
import site
import sys
from functools import cache
from importlib import import_module
from importlib.machinery import PathFinder
from pathlib import Path
from typing import Any

from builtin_interfaces.msg import Time

from occ_constraints_pkg.errors import InputError

_SECOND = 1_000_000_000
_TYPE_NAME = re.compile(r'(?!\w*__)[a-z][a-z0-9_]*/msg/[A-Z][A-Za-z0-9]*')


def to_time(nanoseconds: int) -> Time:
    """Return a time message."""
    seconds, rest = divmod(nanoseconds, _SECOND)
    return Time(sec=seconds, nanosec=rest)


def to_nanoseconds(stamp: Time) -> int:
    """Return a time message as nanoseconds."""
    return stamp.sec * _SECOND + stamp.nanosec


@cache
def message_class(msgtype: str) -> Any:
    """Return the Python class of a message type such as ``sensor_msgs/msg/LaserScan``.

    The name may come from a recording or from the network, so nothing is imported but packages
    that ROS has generated and somebody has installed.

    Raises:
        OccError: it cannot name a message type, or no installed package provides it.
    """
    if not _TYPE_NAME.fullmatch(msgtype):
        raise InputError(
            f'{msgtype[:100]!r} is no message type; allowed are names such as std_msgs/msg/String'
        )
    package, _, name = msgtype.split('/')
    kind = None
    if _is_installed(package):
        kind = getattr(import_module(f'{package}.msg'), name, None)
    if not hasattr(kind, 'get_fields_and_field_types'):
        raise InputError(
            f'message type {msgtype!r} is not installed; install the ROS package that defines it'
        )
    return kind


def _is_installed(package: str) -> bool:
    """Return, without importing anything, whether a package of messages is installed.

    Then it lies where Python packages are installed, or below a directory of ``AMENT_PREFIX_PATH``,
    and has the compiled type support that ROS generates for messages. Whatever lies in the present
    directory, perhaps beside a recording of somebody else, is no such package.
    """
    found = PathFinder.find_spec(package, [path for path in sys.path if _is_for_packages(path)])
    if found is None or found.origin is None:
        return False
    loaded = sys.modules.get(package)
    taken = PathFinder.find_spec(package) if loaded is None else loaded.__spec__
    folder = Path(found.origin).parent
    return (
        taken is not None
        and taken.origin == found.origin
        and (folder / 'msg' / '__init__.py').is_file()
        and any(folder.glob(f'{package}_s__rosidl_typesupport_c*'))
    )


def _is_for_packages(path: str) -> bool:
    folder = Path(path).absolute()
    prefixes = os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep)
    return folder != Path.cwd() and (
        folder in (Path(item) for item in (*site.getsitepackages(), site.getusersitepackages()))
        or any(folder.is_relative_to(Path(prefix).absolute()) for prefix in prefixes if prefix)
    )
