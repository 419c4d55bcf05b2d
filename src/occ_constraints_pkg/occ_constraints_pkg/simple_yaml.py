# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The greater part of the YAML that is written here, quickly.

The YAML library, which is pure Python, takes about a millisecond for a rule. Nearly all of a
constraints file is of a simple form: a word, a number, or a list or mapping of these on one line,
in blocks indented by two. What has this form is read and written here, exactly as the library does;
it is asked for everything else, piece by piece.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Callable, Iterator
from typing import Any

QUOTED_STARTS = ('?', ':')
"""Text that begins so has another meaning if it is not quoted."""

# Neither the space at an end nor the characters left out have a meaning in the middle of a line.
_TEXT = re.compile(r'[A-Za-z][A-Za-z0-9_./^()-]*(?: [A-Za-z0-9_./^()-]+)*')
_NO_TEXT = frozenset(['null', 'true', 'false', 'yes', 'no', 'on', 'off', 'y', 'n'])
_QUOTED = {'<': '<', '<=': '<=', '>': "'>'", '>=': "'>='", '1': "'1'", '': "''"}
_WORDS = {
    'null': None,
    'true': True,
    'false': False,
    **{text: value for value, text in _QUOTED.items()},
}
_INTEGER = re.compile(r'-?(?:0|[1-9][0-9]*)')
_FLOAT = re.compile(r'-?(?:0|[1-9][0-9]*)\.[0-9]+')
# Longer lines may be folded, and so may the lines of what is indented so far.
_WIDTH = 95
_DEEPEST_INDENT = 40


def write(document: Any, by_library: Callable[[Any], str]) -> str:
    """Return a document as the YAML library writes it.

    Args:
        document: plain values.
        by_library: writes a document with the library.
    """
    if not isinstance(document, dict) or _is_flow(document):
        return by_library(document)
    return ''.join(_Writer(by_library).document(document))


class _Writer:
    def __init__(self, by_library: Callable[[Any], str]) -> None:
        self._library = by_library

    def document(self, document: dict[Any, Any]) -> Iterator[str]:
        """Yield the entries of a document."""
        for key, value in document.items():
            try:
                yield ''.join(self._mapping({key: value}, 0))
            except NotSimpleError:
                yield self._piece({key: value}, 0)

    def _mapping(self, mapping: dict[Any, Any], indent: int) -> Iterator[str]:
        if indent > _DEEPEST_INDENT:
            raise NotSimpleError
        for key, value in mapping.items():
            name = _scalar(key)
            if name is None:
                yield self._piece({key: value}, indent)
            elif _is_flow(value):
                text = _flow(value)
                line = f'{" " * indent}{name}: {text}\n'
                is_simple = text is not None and len(line) <= _WIDTH
                yield line if is_simple else self._piece({key: value}, indent)
            elif isinstance(value, dict):
                yield f'{" " * indent}{name}:\n'
                yield from self._mapping(value, indent + 2)
            else:
                yield f'{" " * indent}{name}:\n'
                yield from self._sequence(value, indent)

    def _sequence(self, items: list[Any], indent: int) -> Iterator[str]:
        for item in items:
            if _is_flow(item):
                text = _flow(item)
                line = f'{" " * indent}- {text}\n'
                is_simple = text is not None and len(line) <= _WIDTH
                yield line if is_simple else self._piece([item], indent)
            elif isinstance(item, dict):
                first, *others = self._mapping(item, indent + 2)
                yield f'{" " * indent}- {first[indent + 2 :]}'
                yield from others
            else:
                yield self._piece([item], indent)

    def _piece(self, piece: Any, indent: int) -> str:
        """Return an entry of a mapping or a sequence as the library writes it at an indent."""
        # In a document of which it is a part at that place, and no line of its own.
        other = next(name for name in 'ab' if name not in piece)
        nested: Any
        if isinstance(piece, dict):
            nested, before, after = {**piece, other: [[0]]}, indent // 2, 2
        else:
            nested, before, after = [*piece, [[0]]], indent // 2 + 1, 1
        for _ in range(before):
            nested = {other: nested}
        lines = self._library(nested).split('\n')
        return ''.join(f'{line}\n' for line in lines[before : -after - 1])


def _is_flow(value: Any) -> bool:
    """Return whether a value is written on one line: scalars, and collections of nothing else."""
    if isinstance(value, dict):
        return all(_is_scalar(item) for pair in value.items() for item in pair)
    return not isinstance(value, list) or all(map(_is_scalar, value))


def _is_scalar(value: Any) -> bool:
    if isinstance(value, str):
        # The others have a style of their own, which makes a block of what they are in.
        return value[:1] not in QUOTED_STARTS
    return not isinstance(value, dict | list)


def _flow(value: Any) -> str | None:
    """Return the text of what is written on one line, ``None`` if it is not simple."""
    if not isinstance(value, dict | list):
        return _scalar(value)
    scalars = value if isinstance(value, list) else itertools.chain.from_iterable(value.items())
    texts = [text for text in map(_scalar, scalars) if text is not None]
    if isinstance(value, list):
        return f'[{", ".join(texts)}]' if len(texts) == len(value) else None
    if len(texts) < 2 * len(value):
        return None
    pairs = zip(texts[::2], texts[1::2], strict=True)
    return f'{{{", ".join(f"{key}: {text}" for key, text in pairs)}}}'


def _scalar(value: Any) -> str | None:
    """Return the text of a scalar, ``None`` if it is not simple."""
    if value is None or isinstance(value, bool):
        return {None: 'null', True: 'true', False: 'false'}[value]
    if isinstance(value, int):
        return str(value)
    if isinstance(value, float):
        text = repr(value)
        return text if _FLOAT.fullmatch(text) else None
    if not isinstance(value, str):
        return None
    is_simple = _TEXT.fullmatch(value) and value.lower() not in _NO_TEXT
    return value if is_simple else _QUOTED.get(value)


class NotSimpleError(Exception):
    """A document that the library has to read or write as a whole."""


def read(text: str, by_library: Callable[[str], Any]) -> dict[str, Any]:
    """Return the mapping that a text holds.

    What is not simple is read by the library, entry by entry. An entry ends before the next line
    that is not indented further. Where it does not, because of a quote or a bracket that is still
    open, the library finds a mistake in it.

    Args:
        text: YAML.
        by_library: reads a document with the library.

    Raises:
        NotSimpleError: the whole text has to be read by the library.
        Exception: of the library, which then has to read the whole text, too.
    """
    if _ODD.search(text):
        raise NotSimpleError
    reader = _Reader(text.split('\n'), by_library)
    found, end = reader.mapping(0, 0)
    if end < len(reader.lines) or not found:
        raise NotSimpleError
    return found


# Characters that are spaces or ends of lines to the library only.
_ODD = re.compile('[\t\r\x0b\x0c\x85\u2028\u2029\ufeff]')
_KEY = re.compile(r'([A-Za-z][A-Za-z0-9_]*):(?: (.+))?')


class _Reader:
    """Reads blocks from lines; a position is the number of a line.

    Attributes:
        lines: of the text.
    """

    def __init__(self, lines: list[str], by_library: Callable[[str], Any]) -> None:
        self.lines = lines
        self._library = by_library

    def mapping(self, at: int, indent: int) -> tuple[dict[str, Any], int]:
        """Return the mapping that begins at a position, and the position after it."""
        found: dict[str, Any] = {}
        at = self._skip(at)
        while self._indent(at) == indent and not self._is_item(at, indent):
            match = _KEY.fullmatch(self.lines[at], indent)
            if match is None or match[1] in found or match[1].lower() in _NO_TEXT:
                raise NotSimpleError
            found[match[1]], at = self._entry(at, indent, match[1], match[2])
        return found, at

    def _entry(self, at: int, indent: int, key: str, rest: str | None) -> tuple[Any, int]:
        below = self._skip(at + 1)
        try:
            if rest is not None:
                value, end = _value(rest), below
            elif self._is_item(below, indent):
                value, end = self._sequence(below, indent)
            elif self._indent(below) == indent + 2:
                value, end = self.mapping(below, indent + 2)
            else:
                raise NotSimpleError
            if self._indent(end) > indent:
                raise NotSimpleError
        except NotSimpleError:
            piece, end = self._piece(at, indent, has_items=rest is None)
            if not isinstance(piece, dict) or list(piece) != [key]:
                raise
            value = piece[key]
        return value, end

    def _sequence(self, at: int, indent: int) -> tuple[list[Any], int]:
        items = []
        while self._is_item(at, indent):
            line = self.lines[at]
            rest = line[indent + 2 :]
            try:
                if _KEY.fullmatch(rest):
                    self.lines[at] = f'{" " * (indent + 2)}{rest}'
                    try:
                        item, end = self.mapping(at, indent + 2)
                    finally:
                        self.lines[at] = line
                else:
                    item, end = _value(rest), self._skip(at + 1)
                if self._indent(end) > indent:
                    raise NotSimpleError
            except NotSimpleError:
                piece, end = self._piece(at, indent, has_items=False)
                if not isinstance(piece, list) or len(piece) != 1:
                    raise
                (item,) = piece
            items.append(item)
            at = end
        return items, at

    def _piece(self, at: int, indent: int, *, has_items: bool) -> tuple[Any, int]:
        """Return what the library reads of an entry or item, and the position after it."""
        end = self._skip(at + 1)
        while self._indent(end) > indent or (has_items and self._is_item(end, indent)):
            end = self._skip(end + 1)
        lines = (line.removeprefix(' ' * indent) for line in self.lines[at:end])
        return self._library('\n'.join(lines)), end

    def _skip(self, at: int) -> int:
        """Return the position of the first line from one on that is not empty or a comment."""
        while at < len(self.lines) and self.lines[at].lstrip(' ')[:1] in ('', '#'):
            at += 1
        return at

    def _indent(self, at: int) -> int:
        """Return the indent of a line; -1 after the last one."""
        if at == len(self.lines):
            return -1
        return len(self.lines[at]) - len(self.lines[at].lstrip(' '))

    def _is_item(self, at: int, indent: int) -> bool:
        return self._indent(at) == indent and self.lines[at].startswith('- ', indent)


def _value(text: str) -> Any:
    """Return what is written on one line."""
    inner = text[1:-1]
    if text[0] == '{' and text[-1] == '}':
        pairs = [pair.split(': ') for pair in inner.split(', ')] if inner else []
        if any(len(pair) != 2 for pair in pairs):
            raise NotSimpleError
        found = {_read_scalar(key): _read_scalar(value) for key, value in pairs}
        if len(found) < len(pairs):
            raise NotSimpleError
        return found
    if text[0] == '[' and text[-1] == ']':
        return [_read_scalar(item) for item in inner.split(', ')] if inner else []
    return _read_scalar(text)


def _read_scalar(text: str) -> Any:
    if text in _WORDS:
        return _WORDS[text]
    if _FLOAT.fullmatch(text):
        return float(text)
    if _INTEGER.fullmatch(text):
        return int(text)
    if _TEXT.fullmatch(text) and text.lower() not in _NO_TEXT:
        return text
    raise NotSimpleError
