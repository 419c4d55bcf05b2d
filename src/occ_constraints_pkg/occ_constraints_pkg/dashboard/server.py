# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The page's HTTP server, in a thread of its own, with bounds on what clients may take up."""

from __future__ import annotations

import asyncio
import logging
import socket
import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import uvicorn
from uvicorn.protocols.http.h11_impl import H11Protocol

from occ_constraints_pkg.dashboard.access import Access
from occ_constraints_pkg.dashboard.application import Application, Wish
from occ_constraints_pkg.errors import ConfigurationError

MOST_CONNECTIONS = 128
"""Connections that are kept open; for a further one the oldest without a stream is cut."""
IDLE_SECONDS = 20.0
"""So long a connection lives that gets no stream, whatever it does."""
_MOST_HEADER = 16384
_JOIN_SECONDS = 5.0
_BACKLOG = 128


@dataclass(frozen=True)
class _Running:
    """What there is from the start to the end."""

    loop: asyncio.AbstractEventLoop
    server: uvicorn.Server
    thread: threading.Thread


class PageServer:
    """Serves the page until it is closed.

    Args:
        access: what requests have to carry.
        wish: called in the server's thread with what a page asks for; returns whether it is taken.
    """

    def __init__(self, access: Access, wish: Callable[[Wish], bool]) -> None:
        self._application = Application(access, wish)
        self._running: _Running | None = None
        self.host, self.port = '', 0

    @property
    def streams(self) -> int:
        """How many pages are open."""
        return self._application.streams

    @property
    def arrivals(self) -> int:
        """How many pages have been opened so far."""
        return self._application.arrivals

    def start(self, host: str, port: int) -> None:
        """Listen, and answer from now on.

        Args:
            host: a name or an address of this computer.
            port: 0 for any that is free.

        Raises:
            ConfigurationError: it cannot be listened there.
        """
        listening = _listen(host, port)
        self.host, self.port = host, listening.getsockname()[1]
        # A flood of nonsense must not become a flood of lines.
        logging.getLogger('uvicorn.error').setLevel(logging.CRITICAL)
        config = uvicorn.Config(
            self._application,
            http=_protocol(self._application),
            loop='asyncio',
            ws='none',
            lifespan='off',
            interface='asgi3',
            log_config=None,
            access_log=False,
            proxy_headers=False,
            server_header=False,
            date_header=False,
            timeout_keep_alive=int(IDLE_SECONDS),
            timeout_graceful_shutdown=1,
            h11_max_incomplete_event_size=_MOST_HEADER,
        )
        loop, server = asyncio.new_event_loop(), uvicorn.Server(config)
        thread = threading.Thread(
            target=_serve, args=(loop, server, listening), name='page', daemon=True
        )
        self._running = _Running(loop, server, thread)
        thread.start()

    def publish(self, messages: Mapping[str, bytes]) -> None:
        """Hand messages, by kind, to all pages that are open; returns at once."""
        self._call(self._application.publish, messages)

    def close(self) -> None:
        """Leave all clients, and end the thread."""
        if self._running is None:
            return
        self._running.server.should_exit = True
        self._call(self._application.close)
        self._running.thread.join(_JOIN_SECONDS)

    def _call(self, function: Callable[..., None], *arguments: Any) -> None:
        if self._running is None:
            return
        try:
            self._running.loop.call_soon_threadsafe(function, *arguments)
        except RuntimeError:
            # The loop has ended: nobody is there to be told.
            return


def _serve(
    loop: asyncio.AbstractEventLoop, server: uvicorn.Server, listening: socket.socket
) -> None:
    asyncio.set_event_loop(loop)
    try:
        loop.run_until_complete(server.serve(sockets=[listening]))
    finally:
        listening.close()
        loop.close()


def _listen(host: str, port: int) -> socket.socket:
    try:
        family, kind, _, _, address = socket.getaddrinfo(
            host, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE
        )[0]
        listening = socket.socket(family, kind)
        try:
            listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            listening.bind(address)
            listening.listen(_BACKLOG)
        except OSError:
            listening.close()
            raise
    except (OSError, UnicodeError) as error:
        reason = getattr(error, 'strerror', None) or error
        raise ConfigurationError(
            f'cannot listen to {host} port {port}: {reason}; allowed is an address of this '
            'computer and a port that is free (-p port:=0 for any)'
        ) from error
    return listening


def _protocol(application: Application) -> type[H11Protocol]:
    """Return uvicorn's protocol, with bounds on connections."""
    connections: dict[H11Protocol, tuple[asyncio.Transport, asyncio.TimerHandle]] = {}

    class BoundedProtocol(H11Protocol):
        def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
            super().connection_made(transport)
            if len(connections) >= MOST_CONNECTIONS:
                for other, (oldest, timer) in connections.items():
                    if not _is_streaming(oldest):
                        oldest.abort()
                        timer.cancel()
                        del connections[other]
                        break
            connections[self] = transport, self._watch(transport)

        def connection_lost(self, error: Exception | None) -> None:
            if self in connections:
                connections.pop(self)[1].cancel()
            super().connection_lost(error)

        def _watch(self, transport: asyncio.Transport) -> asyncio.TimerHandle:
            return asyncio.get_running_loop().call_later(IDLE_SECONDS, self._check, transport)

        def _check(self, transport: asyncio.Transport) -> None:
            if _is_streaming(transport):
                connections[self] = transport, self._watch(transport)
            else:
                transport.abort()

    def _is_streaming(transport: asyncio.Transport) -> bool:
        peer = transport.get_extra_info('peername')
        return peer is not None and application.is_streaming((peer[0], peer[1]))

    return BoundedProtocol
