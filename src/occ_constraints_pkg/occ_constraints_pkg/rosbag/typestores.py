# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Message types as the definitions in a bag give them.

Bags repeat the same definitions, and parsing one takes as long as reading thousands of messages;
so what was parsed is remembered.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache, lru_cache
from typing import Any

from rosbags.typesys import Stores, TypesysError, get_typestore

from occ_constraints_pkg.rosbag.definition_bounds import BoundsError, parse_definition
from occ_constraints_pkg.rosbag.definitions import part_types
from occ_constraints_pkg.rosbag.idl_text import IdlError

# The parsers fail on wrong definitions in whichever way comes first.
_WRONG = (
    *(TypesysError, LookupError, ValueError, SyntaxError, RecursionError, AssertionError),
    *(NameError, TypeError, AttributeError, ArithmeticError, MemoryError),
)


class UndefinedTypeError(ValueError):
    """A type's definition is missing, incomplete or cannot be read.

    Attributes:
        reason: what is out of bounds in it, as part of a sentence; empty for anything else.
    """

    def __init__(self, error: BaseException) -> None:
        super().__init__(str(error))
        self.reason = str(error) if isinstance(error, BoundsError | IdlError) else ''


@lru_cache(maxsize=256)
def find_typestore(definition: str, kind: str, msgtype: str) -> Any:
    """Return a ``rosbags`` typestore that knows a type.

    Each definition gets a store of its own: bags join topics whose definitions of a shared part
    differ, and a common store would refuse the second.

    Args:
        definition: text as the bag has it; empty means the type of that name in ROS 2 Jazzy.
        kind: ``ros2msg`` or ``ros2idl``.
        msgtype: the type's name.

    Raises:
        UndefinedTypeError: the definition does not suffice.
    """
    try:
        store = _jazzy()
        if definition.strip():
            store = get_typestore(Stores.EMPTY)
            store.register(_parsed(definition, kind, msgtype))
        _check_parts(store.fielddefs, msgtype)
        store.get_msgdef(msgtype)
    except _WRONG as error:
        raise UndefinedTypeError(error) from error
    return store


def find_definitions(definition: str, kind: str, msgtype: str) -> Mapping[str, Any]:
    """Return the parsed definitions of a type and its parts, by name.

    Takes the same arguments as :func:`find_typestore`, and a small part of its time.

    Raises:
        UndefinedTypeError: the definition cannot be read.
    """
    try:
        if definition.strip():
            return _empty_definitions() | _parsed(definition, kind, msgtype)
        return _jazzy().fielddefs
    except _WRONG as error:
        raise UndefinedTypeError(error) from error


_parsed = lru_cache(maxsize=256)(parse_definition)


def _check_parts(definitions: Mapping[str, Any], msgtype: str) -> None:
    """Raise KeyError for a part that is not defined; the store would miss it when it decodes."""
    checked, waiting = set(), [msgtype]
    while waiting:
        name = waiting.pop()
        if name not in checked:
            checked.add(name)
            waiting += part_types(definitions[name])


@cache
def _empty_definitions() -> dict[str, Any]:
    # Not quite empty: every store of rosbags knows the types of times.
    return dict(get_typestore(Stores.EMPTY).fielddefs)


@cache
def _jazzy() -> Any:
    return get_typestore(Stores.ROS2_JAZZY)
