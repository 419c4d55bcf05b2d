# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Why something is so, where that may change while it goes on."""

from __future__ import annotations

from occ_constraints_pkg.wording import without_numbers

_MOST = 4


class Reasons:
    """The first few reasons of something, each once, whatever its numbers.

    Args:
        first: the first one; may be empty.
    """

    def __init__(self, first: str = '') -> None:
        self._texts: list[str] = []
        self._kinds: set[str] = set()
        self.add(first)

    @property
    def first(self) -> str:
        """The first one; empty without any."""
        return self._texts[0] if self._texts else ''

    def add(self, text: str) -> bool:
        """Take one more; return whether it is news."""
        kind = without_numbers(text)
        if not kind or kind in self._kinds or len(self._kinds) >= _MOST:
            return False
        self._kinds.add(kind)
        self._texts.append(text)
        return True

    def __str__(self) -> str:
        return '; then: '.join(self._texts)
