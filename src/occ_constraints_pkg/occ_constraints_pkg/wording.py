# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Numbers in sentences: with nouns, and left out."""

from __future__ import annotations

import re

# Not those that are part of a name.
_NUMBER = re.compile(r'(?<![\w.])-?\d[\d.]*(e[-+]?\d+)?(?!\w)')


def count_of(number: int, noun: str) -> str:
    """Return a number with its noun, as ``1 rule`` or ``2 rules``."""
    return f'{number} {noun}' if number == 1 else f'{number} {noun}s'


def without_numbers(text: str) -> str:
    """Return what a sentence says whatever its numbers are: the same with others is no news."""
    return _NUMBER.sub('', text)
