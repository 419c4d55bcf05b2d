# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Ctrl-C, SIGTERM and a closed terminal as a request that a program answers when it is ready."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from contextlib import contextmanager

PARENT_VARIABLE = 'OCC_PARENT_PID'
"""Environment variable with a process id: a node, or the training of one
seed, ends when that is its parent no more."""

_SIGNALS = [signal.SIGINT, signal.SIGTERM]
if hasattr(signal, 'SIGHUP'):
    _SIGNALS.append(signal.SIGHUP)


class StopRequest:
    """Remembers that the process was asked to end.

    A signal sets only a mark, so that whatever is going on runs to its end and files are left
    whole; long work that has nothing to lose is put into :meth:`interrupting`.

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
        """Take the signals over for the block, in which a request is only noted.

        Only the main thread may enter it.
        """
        if self._is_listening:
            before, self._ending = self._ending, None
            try:
                yield
            finally:
                self._ending = before
            return
        self.made, self._is_listening = False, True
        # A program started under nohup is meant to outlive its terminal.
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
        """Within the block a request raises KeyboardInterrupt, one made before at once."""
        self._interrupts = True
        try:
            if self.made:
                raise KeyboardInterrupt
            yield
        finally:
            self._interrupts = False

    @contextmanager
    def ending_at_once(self, code: int, words: str = '') -> Iterator[None]:
        """Within the block a request ends the process on the spot, without a word of Python's.

        It is for imports: they take seconds, have nothing to lose, and an exception among them
        may come out as another one. Signals are listened to as in :meth:`listening`, and a block
        of that within this one takes over.

        Args:
            code: the exit code.
            words: a line for stderr; none: nothing is said.
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
            # Unbuffered, for the buffer may be in use where the signal came.
            os.write(2, f'{words}\n'.encode())
        os._exit(code)

    def _on_signal(self, _number: int, _frame: object) -> None:
        self.made = True
        if self._ending is not None:
            self._end()
        if self._interrupts:
            raise KeyboardInterrupt


stop_request = StopRequest()
"""The process's one request: signals know no other scope."""


def parent_is_gone() -> bool:
    """Return whether the process named in :data:`PARENT_VARIABLE` is this one's parent no more."""
    parent = os.environ.get(PARENT_VARIABLE)
    return parent is not None and parent != '' and os.getppid() != int(parent)
