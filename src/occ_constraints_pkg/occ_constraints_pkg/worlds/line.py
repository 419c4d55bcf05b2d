# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""A line between two processes, for messages that must arrive within microseconds."""

from __future__ import annotations

import os
import select
import socket
import time

# How long a process looks for a message, in s, before it goes to sleep: waking up takes a while.
# It yields to whoever else wants the core meanwhile.
_PATIENCE = 0.0002


class Line:
    """One end of the line.

    Whoever sleeps is woken through an event of its own and not by the socket: the kernel takes a
    message on a socket for the sender's last act, and wakes the receiver on the sender's core.

    Attributes:
        descriptors: of the socket, of the event that wakes this end, of the one for the other end.
    """

    def __init__(self, descriptors: tuple[int, ...]) -> None:
        """Take over descriptors that are open in this process; :meth:`close` closes them."""
        self.descriptors = descriptors
        self._socket = socket.socket(fileno=descriptors[0])
        self._socket.setblocking(False)
        self._event, self._other = descriptors[1:]
        self._sleep = select.poll()
        self._sleep.register(self._event, select.POLLIN)
        # No events: it tells when the other end is closed, without being asked to.
        self._sleep.register(self._socket, 0)

    @classmethod
    def pair(cls) -> tuple[Line, Line]:
        """Return the two ends of a new line."""
        first, second = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        events = [os.eventfd(0, os.EFD_NONBLOCK | os.EFD_CLOEXEC) for _ in range(2)]
        copies = [os.dup(event) for event in events]
        return cls((first.detach(), *events)), cls((second.detach(), *reversed(copies)))

    def send(self, message: bytes) -> None:
        """Send a message.

        Raises:
            BrokenPipeError: the other end is closed.
        """
        self._socket.send(message)
        os.eventfd_write(self._other, 1)

    def receive(self, size: int) -> bytes:
        """Wait for a message of at most ``size`` bytes; empty once the other end is closed."""
        end = time.monotonic() + _PATIENCE
        while True:
            try:
                return self._socket.recv(size)
            except ConnectionResetError:
                return b''
            except BlockingIOError:
                if time.monotonic() < end:
                    os.sched_yield()
                    continue
            self._sleep.poll()
            try:
                os.eventfd_read(self._event)
            except BlockingIOError:
                continue

    def close(self) -> None:
        """Close this end; once is enough."""
        self._socket.close()
        for event in self.descriptors[1:]:
            os.close(event)
        self.descriptors = self.descriptors[:1]
