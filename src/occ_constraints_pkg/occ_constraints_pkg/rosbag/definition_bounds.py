# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Message definitions of bags, checked against bounds before code is generated from them."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from typing import Any

from rosbags.interfaces import Nodetype
from rosbags.typesys import get_types_from_idl, get_types_from_msg

from occ_constraints_pkg.rosbag.idl_text import reduced_idl
from occ_constraints_pkg.rosbag.storage import MAX_PIECE_BYTES

_NAME = re.compile(r'[A-Za-z]\w*(?:/[A-Za-z]\w*){1,2}', re.ASCII)
_SEPARATOR = re.compile(r'^={80}\n(?:IDL: .*\n)?', re.MULTILINE)
_NOTHING = re.compile(r'^[ \t]*(?:#.*)?(?:\n|\Z)', re.MULTILINE)
# Constants of texts, and those without a value; the parser does not know all of them.
_TEXT_CONSTANT = re.compile(
    r'^[ \t]*(?:w?string(?:<=\d+)?[ \t]+[A-Za-z]\w*[ \t]*=.*'
    r'|\w+[ \t]+[A-Z]\w*[ \t]*=[ \t]*(?:#.*)?)(?:\n|\Z)',
    re.MULTILINE,
)
_WSTRING = re.compile(r'^([ \t]*)wstring(?:<=\d+)?(?=[ \t\[])', re.MULTILINE)
WIDE_TEXT = 'occ_definitions/msg/WideText'
"""What stands for ``wstring``: its text is not read, but what follows it is."""
_MOST_CHARACTERS = 1 << 20
# The largest messages of ROS have some hundred fields, those of their parts included, and some
# dozen parts.
_MOST_FIELDS, _MOST_TYPES = 1_000, 200
# Fields of the parts in parts, each as often as it is there.
_MOST_UNROLLED = 50_000
_MOST_LEVELS = 30
_LARGEST_INTEGER = 2**64 - 1


class BoundsError(ValueError):
    """A definition is beyond what a message needs; the text says how, as part of a sentence."""


def parse_definition(
    definition: str, kind: str, msgtype: str, wide: str = 'uint16'
) -> dict[str, Any]:
    """Parse a definition as a bag has it, in bounded time and memory.

    Args:
        definition: the text.
        kind: ``ros2msg`` or ``ros2idl``.
        msgtype: the type's name.
        wide: what a ``wstring`` is a sequence of, which differs between middlewares: ``uint16`` or
            ``uint32`` for a character each, or ``uint8`` where its length counts bytes.

    Returns:
        Type name to ``([], fields)``, as ``rosbags`` has definitions, for the type and its parts.
        The constants are checked and left out: no message contains them.

    Raises:
        ValueError: the definition is wrong or out of bounds.
        Exception: whatever the parsers of ``rosbags`` raise on text that they do not understand.
    """
    if not _NAME.fullmatch(msgtype):
        raise BoundsError(f'{msgtype[:100]!r} is no name of a type')
    if len(definition) > _MOST_CHARACTERS:
        raise BoundsError(f'it has {len(definition)} characters; allowed are {_MOST_CHARACTERS}')
    definition = definition.replace('\r\n', '\n').replace('\r', '\n')
    if kind == 'ros2msg':
        for pattern in (_NOTHING, _TEXT_CONSTANT):
            definition = pattern.sub('', definition)
        definition = _WSTRING.sub(rf'\1{WIDE_TEXT.replace("/msg", "")}', definition)
        types = get_types_from_msg(definition, msgtype)
    else:
        types = {}
        for part in _SEPARATOR.split(definition):
            if part.strip():
                types.update(get_types_from_idl(reduced_idl(part)))
    for constants, _ in types.values():
        for name, _, value in constants:
            _check_constant(name, value)
    types = {
        name: ([], [(field, _without_wstring(item)) for field, item in fields])
        for name, (_, fields) in types.items()
    }
    if WIDE_TEXT in {part for item in types.values() for part in part_types(item)}:
        units = (Nodetype.SEQUENCE, ((Nodetype.BASE, (wide, 0)), 0))
        types[WIDE_TEXT] = ([], [('units', units)])
    count = sum(_repetitions(field) for _, fields in types.values() for _, field in fields)
    if count > _MOST_FIELDS or len(types) > _MOST_TYPES:
        raise BoundsError(
            f'it has {count} fields in {len(types)} types; allowed are {_MOST_FIELDS} in '
            f'{_MOST_TYPES}'
        )
    sizes: dict[str, tuple[int, int]] = {}
    for name in types:
        _measure(name, types, sizes, 0)
    return types


def part_types(definition: Any) -> Iterator[str]:
    """Yield the names of the message types among a parsed definition's fields."""
    for _, (kind, argument) in definition[1]:
        if kind in (Nodetype.ARRAY, Nodetype.SEQUENCE):
            kind, argument = argument[0]
        if kind == Nodetype.NAME:
            yield argument


def _without_wstring(field: Any) -> Any:
    kind, argument = field
    if kind in (Nodetype.ARRAY, Nodetype.SEQUENCE):
        element, *length = argument
        return kind, (_without_wstring(element), *length)
    is_wide = kind == Nodetype.BASE and argument[0] == 'wstring'
    return (Nodetype.NAME, WIDE_TEXT) if is_wide else field


def _check_constant(name: str, value: Any) -> None:
    fits = math.isfinite(value) if isinstance(value, float) else True
    if isinstance(value, int):
        fits = abs(value) <= _LARGEST_INTEGER
    if not fits:
        raise BoundsError(f'the constant {name} does not fit into 64 bits')


def _repetitions(field: Any) -> int:
    """Return how often code is generated for a field: for each element of some arrays."""
    kind, argument = field
    if kind != Nodetype.ARRAY:
        return 1
    element, length = argument
    is_number = element[0] == Nodetype.BASE and element[1][0] != 'string'
    return 1 if is_number else length


def _measure(
    name: str, types: Mapping[str, Any], sizes: dict[str, tuple[int, int]], depth: int
) -> tuple[int, int]:
    """Return how many fields a type has, those of its parts included, and its least size.

    Raises:
        BoundsError: it has too many, is too large, or contains itself.
    """
    if name in sizes:
        return sizes[name]
    if name not in types:
        # It is one of those that every store knows, or is missed later on.
        return 1, 1
    if depth > _MOST_LEVELS:
        raise BoundsError(f'{name[:100]} contains itself, or nests more than {_MOST_LEVELS} deep')
    fields = size = 0
    for _, field in types[name][1]:
        element, times = field, 1
        if field[0] in (Nodetype.ARRAY, Nodetype.SEQUENCE):
            element, times = field[1]
        part = (1, 1)
        if element[0] == Nodetype.NAME:
            part = _measure(element[1], types, sizes, depth + 1)
        fields += part[0] * _repetitions(field)
        size += part[1] * (times if field[0] == Nodetype.ARRAY else 1)
    if fields > _MOST_UNROLLED or size > MAX_PIECE_BYTES:
        raise BoundsError(
            f'{name[:100]} has {fields} fields and at least {size} bytes; allowed are '
            f'{_MOST_UNROLLED} and {MAX_PIECE_BYTES}'
        )
    sizes[name] = fields, size
    return fields, size
