# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Message definitions that no bag brings: of ROS 2's common packages, installed, or in a folder."""

from __future__ import annotations

import logging
import os
from functools import cache
from pathlib import Path
from typing import Any

from rosbags.typesys import Stores, TypesysError, get_typestore

from occ_constraints_pkg.rosbag.definition_bounds import parse_definition, part_types

_log = logging.getLogger(__name__)
_KINDS = {'.msg': 'ros2msg', '.idl': 'ros2idl'}
# What --definitions names, for the whole process.
_folders: list[Path] = []


def search_folder(folder: str | Path) -> None:
    """Look for definitions in a folder, too, before all others; for the whole process.

    Args:
        folder: somewhere in it are ``<package>/msg/<Name>.msg`` or ``.idl``, as in a workspace's
            sources, in what it installed, or in a clone of a package's repository.
    """
    path = Path(folder).resolve()
    if path not in _folders:
        _folders.append(path)


@cache
def find_definition(msgtype: str) -> tuple[str, str]:
    """Return a type's definition and hash.

    Types of ROS 2 Jazzy's common packages are known; others are looked for where
    :func:`search_folder` says, and as ``share/<package>/msg/<Name>.msg`` or ``.idl`` under the
    directories of ``AMENT_PREFIX_PATH``.

    Args:
        msgtype: for example ``nav_msgs/msg/Odometry``.

    Returns:
        ``(text, hash)``: the definition with those of all parts, in ``ros2msg`` form, and the
        ``RIHS01_...`` type hash. Both are empty, with a warning in the log, for an unknown type.
    """
    store = _store()
    try:
        if msgtype not in store.fielddefs:
            store.register(_installed(msgtype))
        text, _ = store.generate_msgdef(msgtype, ros_version=2)
        return text, store.hash_rihs01(msgtype)
    except (TypesysError, OSError, KeyError, ValueError, AssertionError):
        _log.warning('no definition of %s was found; it is recorded without one', msgtype)
        return '', ''


@cache
def _store() -> Any:
    # A store of its own: it grows by the installed types that are asked for.
    return get_typestore(Stores.ROS2_JAZZY)


def _installed(msgtype: str) -> dict[str, Any]:
    """Return the parsed type with all its parts that Jazzy's common packages do not have."""
    found: dict[str, Any] = {}
    missing = [msgtype]
    while missing:
        name = missing.pop()
        if name in found or name in _store().fielddefs:
            continue
        found.update(installed_type(name))
        missing.extend(part_types(found[name]))
    return found


def installed_type(msgtype: str, *, in_folders_only: bool = False) -> dict[str, Any]:
    """Return the parsed definition of a type, without its parts, by name.

    Args:
        msgtype: for example ``px4_msgs/msg/VehicleOdometry``.
        in_folders_only: whether to look only where :func:`search_folder` says.

    Raises:
        FileNotFoundError: there is none.
        Exception: as :func:`~occ_constraints_pkg.rosbag.definition_bounds.parse_definition` does.
    """
    for folder in _folders:
        if (path := _definitions_in(folder).get(msgtype)) is not None:
            return _parsed(path, msgtype)
    if not in_folders_only and msgtype.count('/') == 2:
        package, kind, name = msgtype.split('/')
        for prefix in filter(None, os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep)):
            for suffix in _KINDS:
                path = Path(prefix) / 'share' / package / kind / f'{name}{suffix}'
                if path.is_file():
                    return _parsed(path, msgtype)
    raise FileNotFoundError(msgtype)


def _parsed(path: Path, msgtype: str) -> dict[str, Any]:
    text = path.read_text(encoding='utf-8', errors='replace')
    return parse_definition(text, _KINDS[path.suffix], msgtype)


@cache
def _definitions_in(folder: Path) -> dict[str, Path]:
    # Of a type that has both, the .msg comes last and is used.
    found = sorted(path for path in folder.rglob('*') if path.suffix in _KINDS)
    return {
        f'{path.parent.parent.name}/msg/{path.stem}': path
        for path in found
        if path.parent.name == 'msg'
    }
