# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Escaping of foreign text for terminals and logs."""

from __future__ import annotations

import re

# Controls (C0, DEL, C1), marks of text direction, line separators, and halves of surrogate pairs,
# which cannot be encoded.
_UNSAFE = re.compile(
    '[\x00-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028\u2029\u202a-\u202e\u2066-\u2069\ud800-\udfff]'
)


def printable(text: str, *, keep_lines: bool = False) -> str:
    r"""Return text with control characters escaped, as ``\n`` or ``\x1b``.

    Names, units, notes, topics and paths come from files and from the network. Unescaped, they
    could clear a terminal or forge a line of a log.

    Args:
        text: any text.
        keep_lines: whether line breaks and tabs stay as they are.
    """
    if keep_lines:
        return _UNSAFE.sub(lambda m: m[0] if m[0] in '\n\t' else _escaped(m), text)
    return _UNSAFE.sub(_escaped, text)


def _escaped(match: re.Match[str]) -> str:
    return match[0].encode('unicode_escape', 'surrogatepass').decode('ascii')
