# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""A line between two processes, for messages that must arrive within microseconds."""

from __future__ import annotations

import fcntl
import os
import select
import socket
import time
from collections.abc import Callable
from contextlib import suppress

# How long a process looks for a message, in s, before it goes to sleep: waking up takes a while, on
# virtual machines above all. It yields to whoever else wants the core meanwhile. Where the message
# before took longer than that, the next one is likely to as well, and looking is in vain.
_PATIENCE, _LITTLE_PATIENCE = 0.002, 0.0001
# How long it sleeps, in ms, before it looks whether there is anything to wait for.
_SLEEP = 1000


class Line:
    """One end of the line.

    Whoever sleeps is woken through an event of its own and not by the socket: the kernel takes a
    message on a socket for the sender's last act, and wakes the receiver on the sender's core.

    Attributes:
        descriptors: of the socket, of the event that wakes this end, of the one for the other end;
            empty once it is closed.
    """

    def __init__(self, descriptors: tuple[int, ...]) -> None:
        """Take over descriptors that are open in this process; :meth:`close` closes them."""
        self.descriptors = descriptors
        self._socket = socket.socket(fileno=descriptors[0])
        self._socket.setblocking(False)
        self._event, self._other = descriptors[1:]
        self._patience = _PATIENCE
        self._sleep = select.poll()
        self._sleep.register(self._event, select.POLLIN)
        # No events: it tells when the other end is closed, without being asked to.
        self._sleep.register(self._socket, 0)

    @classmethod
    def pair(cls) -> tuple[Line, Line]:
        """Return the two ends of a new line.

        Raises:
            OSError: this process may not open as many descriptors.
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
            is_over: asked now and then whether to wait no more.

        Returns:
            The message; empty once the other end is closed, or where ``is_over`` says so.
        """
        begun = time.monotonic()
        while True:
            try:
                message = self._socket.recv(size)
            except ConnectionError:
                return b''
            except BlockingIOError:
                if time.monotonic() < begun + self._patience:
                    os.sched_yield()
                    continue
            else:
                in_time = time.monotonic() < begun + _PATIENCE
                self._patience = _PATIENCE if in_time else _LITTLE_PATIENCE
                return message
            if not self._sleep.poll(_SLEEP) and is_over():
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
    """Return a descriptor in place of one that standard input or output would have if open.

    What is to be handed to another process may be none of these, for that process gets others.
    """
    if descriptor > 2:
        return descriptor
    try:
        return fcntl.fcntl(descriptor, fcntl.F_DUPFD_CLOEXEC, 3)
    finally:
        os.close(descriptor)
