# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Ctrl-C, SIGTERM and a closed terminal as a request to stop at the next safe point."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache

PARENT_VARIABLE = 'OCC_PARENT_PID'
"""Environment variable with a process id: a node, or the training of one
seed, ends when that process is no longer its parent."""

_SIGNALS = [signal.SIGINT, signal.SIGTERM]
if hasattr(signal, 'SIGHUP'):
    _SIGNALS.append(signal.SIGHUP)


class StopRequest:
    """Records that the process was asked to stop.

    A signal only sets a flag, so that the current work is completed and files are consistent; long
    work that can be aborted is put into :meth:`interrupting`.

    Attributes:
        made: whether the process was asked to end since :meth:`listening` was entered.
    """

    def __init__(self) -> None:
        self.made = False
        self._is_listening = False
        self._interrupts = False
        self._ending: tuple[int, str] | None = None

    @contextmanager
    def listening(self) -> Iterator[None]:
        """Handle signals within the block, where a request is only recorded.

        Main thread only.
        """
        if self._is_listening:
            before, self._ending = self._ending, None
            try:
                yield
            finally:
                self._ending = before
            return
        self.made, self._is_listening = False, True
        # A program started with nohup outlives its terminal.
        numbers = [
            number
            for number in _SIGNALS
            if number in _SIGNALS[:2] or signal.getsignal(number) != signal.SIG_IGN
        ]
        handlers = {number: signal.signal(number, self._on_signal) for number in numbers}
        try:
            yield
        finally:
            self._is_listening = False
            for number, handler in handlers.items():
                signal.signal(number, handler)

    @contextmanager
    def interrupting(self) -> Iterator[None]:
        """Within the block a request raises KeyboardInterrupt; an earlier one at once."""
        self._interrupts = True
        try:
            if self.made:
                raise KeyboardInterrupt
            yield
        finally:
            self._interrupts = False

    @contextmanager
    def ending_at_once(self, code: int, words: str = '') -> Iterator[None]:
        """Within the block a request ends the process at once, without a traceback.

        For imports: they take seconds and can be aborted, and an exception in them may be
        converted to another one. Signals are handled as in :meth:`listening`, and a nested block of
        that takes precedence.

        Args:
            code: the exit code.
            words: a line for stderr, if not empty.
        """
        with self.listening():
            before, self._ending = self._ending, (code, words)
            try:
                if self.made:
                    self._end()
                yield
            finally:
                self._ending = before

    def _end(self) -> None:
        assert self._ending is not None
        code, words = self._ending
        if words:
            # Unbuffered, because the signal may have interrupted a use of the buffer.
            os.write(2, f'{words}\n'.encode())
        os._exit(code)

    def _on_signal(self, _number: int, _frame: object) -> None:
        self.made = True
        if self._ending is not None:
            self._end()
        if self._interrupts:
            raise KeyboardInterrupt


stop_request = StopRequest()
"""The only instance: signals are per process."""


def parent_is_gone() -> bool:
    """Return whether the process in :data:`PARENT_VARIABLE` is no longer the parent."""
    return _parent() not in (0, os.getppid())


@cache
def _parent() -> int:
    # Read once, for nodes ask at every message.
    return int(os.environ.get(PARENT_VARIABLE) or 0)
