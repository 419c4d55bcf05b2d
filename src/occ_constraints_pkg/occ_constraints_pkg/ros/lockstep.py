# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Pairing of two topics by stamp, the identity of a step."""

from __future__ import annotations

from collections.abc import Callable

from occ_constraints_pkg.features.serialized_tables import TableMessage


class Pairing:
    """Hands on two messages once both topics have shown the same stamp.

    Lock-step has one step under way at a time, so only the newest message of each topic is kept;
    a message that is repeated while its partner is held is handed on again, as it should be: the
    answer may have been lost.

    Attributes:
        first: the newest message of the first topic, ``None`` before any.
    """

    def __init__(self, callback: Callable[[TableMessage, TableMessage], None]) -> None:
        self._callback = callback
        self.first: TableMessage | None = None
        self._second: TableMessage | None = None

    def on_first(self, message: TableMessage) -> None:
        """Take a message of the first topic."""
        self.first = message
        self._try()

    def on_second(self, message: TableMessage) -> None:
        """Take a message of the second topic."""
        self._second = message
        self._try()

    def _try(self) -> None:
        first, second = self.first, self._second
        if first is None or second is None:
            return
        if first.stamp_ns != second.stamp_ns:
            return
        self._second = None
        self._callback(first, second)
