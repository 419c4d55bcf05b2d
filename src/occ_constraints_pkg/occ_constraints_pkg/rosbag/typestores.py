# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Message types as the definitions in a bag give them.

Bags repeat the same definitions, and parsing one takes as long as reading thousands of messages;
so what was parsed is remembered.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import cache, lru_cache
from typing import Any

from rosbags.typesys import Stores, TypesysError, get_typestore

from occ_constraints_pkg.rosbag.definition_bounds import (
    BoundsError,
    parse_definition,
    part_types,
)
from occ_constraints_pkg.rosbag.definitions import installed_type
from occ_constraints_pkg.rosbag.idl_text import IdlError

# The parsers fail on wrong definitions in whichever way comes first.
_WRONG = (
    *(TypesysError, LookupError, ValueError, SyntaxError, RecursionError, AssertionError),
    *(NameError, TypeError, AttributeError, ArithmeticError, MemoryError),
)


# Units of a wstring, the most frequent first.
_WIDE = ('uint16', 'uint32', 'uint8')
# Besides Jazzy, those of the longest support first.
_RELEASES = (
    Stores.ROS2_HUMBLE,
    Stores.ROS2_FOXY,
    Stores.ROS2_GALACTIC,
    Stores.ROS2_IRON,
    Stores.ROS2_KILTED,
    Stores.ROS2_DASHING,
)


class UndefinedTypeError(ValueError):
    """A type's definition is missing, incomplete or cannot be read.

    Attributes:
        reason: what is out of bounds in it, as part of a sentence; empty for anything else.
    """

    def __init__(self, error: BaseException) -> None:
        super().__init__(str(error))
        self.reason = str(error) if isinstance(error, BoundsError | IdlError) else ''


def possible_definitions(
    definition: str, kind: str, msgtype: str
) -> Iterator[tuple[str, str, str, str]]:
    """Yield the arguments of :func:`find_typestore` that a topic's messages may need.

    There are several where the bag does not say all: without a definition, the type may be as it
    was in another release of ROS 2 than Jazzy; and a ``wstring`` is not the same in all
    middlewares. Only the messages show which it is.

    Args:
        definition: text as the bag has it; empty for none.
        kind: ``ros2msg`` or ``ros2idl``.
        msgtype: the type's name.
    """
    for wide in _WIDE if 'wstring' in definition else _WIDE[:1]:
        yield definition, kind, msgtype, wide
    if not definition.strip():
        texts = (_text_of_release(store, msgtype) for store in _RELEASES)
        for text in dict.fromkeys(text for text in texts if text):
            yield text, 'ros2msg', msgtype, _WIDE[0]


@lru_cache(maxsize=256)
def find_typestore(definition: str, kind: str, msgtype: str, wide: str = 'uint16') -> Any:
    """Return a ``rosbags`` typestore that knows a type.

    Each definition gets a store of its own: bags join topics whose definitions of a shared part
    differ, and a common store would refuse the second.

    Args:
        definition: text as the bag has it; empty means the type of that name in ROS 2 Jazzy, or
            else one that :func:`~occ_constraints_pkg.rosbag.definitions.installed_type` finds, as
            for its parts.
        kind: ``ros2msg`` or ``ros2idl``.
        msgtype: the type's name.
        wide: see :func:`~occ_constraints_pkg.rosbag.definition_bounds.parse_definition`.

    Raises:
        UndefinedTypeError: the definition does not suffice.
    """
    try:
        types = find_definitions(definition, kind, msgtype, wide)
        jazzy = _jazzy()
        if all(jazzy.fielddefs.get(name) is item for name, item in types.items()):
            store = jazzy
        else:
            store = get_typestore(Stores.EMPTY)
            store.register({name: ([], fields) for name, (_, fields) in types.items()})
        store.get_msgdef(msgtype)
    except UndefinedTypeError:
        raise
    except _WRONG as error:
        raise UndefinedTypeError(error) from error
    return store


def find_definitions(
    definition: str, kind: str, msgtype: str, wide: str = 'uint16'
) -> Mapping[str, Any]:
    """Return the parsed definitions of a type and its parts, by name.

    Takes the same arguments as :func:`find_typestore`, and a small part of its time.

    Raises:
        UndefinedTypeError: the definition does not suffice, or cannot be read.
    """
    try:
        types = dict(_parsed(definition, kind, msgtype, wide)) if definition.strip() else {}
        return _completed(types, msgtype)
    except _WRONG as error:
        raise UndefinedTypeError(error) from error


_parsed = lru_cache(maxsize=256)(parse_definition)


def _completed(types: Mapping[str, Any], msgtype: str) -> dict[str, Any]:
    """Return a type with all its parts: those given, and where they are missing, known ones.

    Raises:
        LookupError: a part is not known.
    """
    found: dict[str, Any] = {}
    waiting = [msgtype]
    while waiting:
        name = waiting.pop()
        if name not in found:
            found[name] = types[name] if name in types else _known_type(name)
            waiting += part_types(found[name])
    return found


def _known_type(name: str) -> Any:
    jazzy = _jazzy().fielddefs
    try:
        return installed_type(name, in_folders_only=name in jazzy)[name]
    except FileNotFoundError:
        return jazzy[name]


@cache
def _text_of_release(store: Stores, msgtype: str) -> str:
    """Return the definition of a type in another release; empty where it has none."""
    types = get_typestore(store)
    return types.generate_msgdef(msgtype, ros_version=2)[0] if msgtype in types.fielddefs else ''


@cache
def _jazzy() -> Any:
    return get_typestore(Stores.ROS2_JAZZY)
