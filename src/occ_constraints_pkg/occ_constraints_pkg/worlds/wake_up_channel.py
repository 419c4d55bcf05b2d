# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""A channel between two processes for messages that must arrive within microseconds."""

from __future__ import annotations

import fcntl
import os
import select
import socket
import time
from collections.abc import Callable
from contextlib import suppress

# How long a receiver polls, in s, before it sleeps: waking up is slow, especially on virtual
# machines. It yields the core while polling. After a message that took longer, the next one is
# likely to take longer too, so it polls for the shorter time.
_LONG_POLL, _SHORT_POLL = 0.002, 0.0001
# How long it sleeps, in ms, before it checks whether to wait any longer.
_SLEEP = 1000


class WakeUpChannel:
    """One end of the channel.

    A sleeping receiver is woken by an eventfd, not by the socket: for a message on a socket, the
    kernel assumes that the sender is done and wakes the receiver on the sender's core.

    Attributes:
        descriptors: of the socket, of the event of this end, of the event of the other end; empty
            once closed.
    """

    def __init__(self, descriptors: tuple[int, ...]) -> None:
        """Take over descriptors that are open in this process; :meth:`close` closes them."""
        self.descriptors = descriptors
        self._socket = socket.socket(fileno=descriptors[0])
        self._socket.setblocking(False)
        self._event, self._other = descriptors[1:]
        self._poll_seconds = _LONG_POLL
        self._sleeper = select.poll()
        self._sleeper.register(self._event, select.POLLIN)
        # No events requested: a hang-up of the other end is reported anyway.
        self._sleeper.register(self._socket, 0)

    @classmethod
    def pair(cls) -> tuple[WakeUpChannel, WakeUpChannel]:
        """Return the two ends of a new channel.

        Raises:
            OSError: this process may not open that many descriptors.
        """
        opened: list[int] = []
        try:
            for end in socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET):
                opened.append(above_standard(end.detach()))
            for _ in range(2):
                opened.append(above_standard(os.eventfd(0, os.EFD_NONBLOCK | os.EFD_CLOEXEC)))
                opened.append(os.dup(opened[-1]))
        except OSError:
            for descriptor in opened:
                os.close(descriptor)
            raise
        first, second, event, same_event, other, same_other = opened
        return cls((first, event, other)), cls((second, same_other, same_event))

    def send(self, message: bytes) -> None:
        """Send a message.

        Raises:
            ConnectionError: the other end is closed.
        """
        self._socket.send(message)
        os.eventfd_write(self._other, 1)

    def receive(self, size: int, is_over: Callable[[], bool] = lambda: False) -> bytes:
        """Wait for a message of at most ``size`` bytes.

        Args:
            size: in bytes.
            is_over: called from time to time; ``True`` ends the wait.

        Returns:
            The message; empty once the other end is closed or ``is_over`` returns ``True``.
        """
        begun = time.monotonic()
        while True:
            try:
                message = self._socket.recv(size)
            except ConnectionError:
                return b''
            except BlockingIOError:
                if time.monotonic() < begun + self._poll_seconds:
                    os.sched_yield()
                    continue
            else:
                in_time = time.monotonic() < begun + _LONG_POLL
                self._poll_seconds = _LONG_POLL if in_time else _SHORT_POLL
                return message
            if not self._sleeper.poll(_SLEEP) and is_over():
                return b''
            with suppress(BlockingIOError):
                os.eventfd_read(self._event)

    def close(self) -> None:
        """Close this end; once is enough."""
        if self.descriptors:
            self._socket.close()
            for event in self.descriptors[1:]:
                os.close(event)
            self.descriptors = ()


def above_standard(descriptor: int) -> int:
    """Return a duplicate above 2 of a descriptor in the range of the standard streams.

    Descriptors 0 to 2 cannot be passed on: the other process has its own standard streams there.
    """
    if descriptor > 2:
        return descriptor
    try:
        return fcntl.fcntl(descriptor, fcntl.F_DUPFD_CLOEXEC, 3)
    finally:
        os.close(descriptor)
