# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""A process on a terminal of its own, for programs that draw on a screen."""

from __future__ import annotations

import fcntl
import os
import pty
import select
import struct
import subprocess
import termios
import time
from collections.abc import Callable, Mapping, Sequence
from types import TracebackType

# What a terminal that can draw says of itself, whatever the one that this runs on says.
_ABLE = {'TERM': 'xterm-256color', 'COLORTERM': 'truecolor', 'NO_COLOR': ''}
_LOOK_SECONDS = 0.1
_END_SECONDS = 15.0


class TerminalProcess:
    """Runs a program on a pseudo-terminal and reads what it draws.

    Attributes:
        output: all that it has written so far.
        process: the program.

    Args:
        arguments: of the program, its path first.
        environment: of the program.
        columns: of the terminal.
        rows: of the terminal.
        variables: more of the environment.
    """

    def __init__(
        self,
        arguments: Sequence[str],
        environment: Mapping[str, str],
        *,
        columns: int = 120,
        rows: int = 40,
        variables: Mapping[str, str] | None = None,
    ) -> None:
        self.output = b''
        self._own, other = pty.openpty()
        self.resize(columns, rows)
        self.process = subprocess.Popen(
            arguments,
            stdin=other,
            stdout=other,
            stderr=other,
            env={**environment, **_ABLE, **(variables or {})},
            start_new_session=True,
        )
        os.close(other)

    def __enter__(self) -> TerminalProcess:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self.process.poll() is None:
            self.process.kill()
            self.process.wait()
        os.close(self._own)

    def resize(self, columns: int, rows: int) -> None:
        """Give the terminal another size, as a window manager does."""
        fcntl.ioctl(self._own, termios.TIOCSWINSZ, struct.pack('HHHH', rows, columns, 0, 0))

    def press(self, keys: str) -> None:
        """Send keys."""
        os.write(self._own, keys.encode())

    def read(self, seconds: float, until: Callable[[bytes], bool] = lambda _: False) -> bool:
        """Read what comes, for a while or until the output is as wanted; return whether it is."""
        end = time.monotonic() + seconds
        while not until(self.output):
            left = max(0.0, end - time.monotonic())
            ready, _, _ = select.select([self._own], [], [], min(left, _LOOK_SECONDS))
            data = b''
            if ready:
                try:
                    data = os.read(self._own, 1 << 16)
                except OSError:
                    # On Linux that is how a terminal ends that nobody has open any more.
                    break
                self.output += data
            if not data and left <= 0.0:
                break
        return until(self.output)

    def wait(self, seconds: float = _END_SECONDS) -> int | None:
        """Read until the program ends; return its exit code, None if it does not end."""
        end = time.monotonic() + seconds
        while self.process.poll() is None and time.monotonic() < end:
            self.read(_LOOK_SECONDS)
        return self.process.poll()
