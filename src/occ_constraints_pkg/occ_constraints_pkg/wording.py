# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Numbers with nouns in sentences."""

from __future__ import annotations


def count_of(number: int, noun: str) -> str:
    """Return a number with its noun, as ``1 rule`` or ``2 rules``."""
    return f'{number} {noun}' if number == 1 else f'{number} {noun}s'
