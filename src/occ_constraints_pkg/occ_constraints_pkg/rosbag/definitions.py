# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Message definitions to store beside recorded messages."""

from __future__ import annotations

import logging
import os
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, TypesysError, get_types_from_msg, get_typestore

_log = logging.getLogger(__name__)


@cache
def find_definition(msgtype: str) -> tuple[str, str]:
    """Return a type's definition and hash.

    Types of ROS 2 Jazzy's common packages are known; others are looked for as
    ``share/<package>/msg/<Name>.msg`` under the directories of ``AMENT_PREFIX_PATH``.

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
        found.update(get_types_from_msg(_read(name), name))
        missing.extend(part_types(found[name]))
    return found


def _read(msgtype: str) -> str:
    package, kind, name = msgtype.split('/')
    for prefix in os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep):
        path = Path(prefix) / 'share' / package / kind / f'{name}.msg'
        if prefix and path.is_file():
            return path.read_text(encoding='utf-8')
    raise FileNotFoundError(msgtype)


def part_types(definition: Any) -> Iterator[str]:
    """Yield the names of the message types among a parsed definition's fields."""
    for _, (kind, argument) in definition[1]:
        if kind in (Nodetype.ARRAY, Nodetype.SEQUENCE):
            kind, argument = argument[0]
        if kind == Nodetype.NAME:
            yield argument
