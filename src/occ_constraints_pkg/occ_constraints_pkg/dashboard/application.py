# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""What the page's server answers, as an ASGI application: files, the stream, and wishes."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Awaitable, Callable, Iterable, Mapping, MutableMapping
from dataclasses import dataclass
from typing import Any

from occ_constraints_pkg.dashboard.access import HEADERS, Access, Refusal
from occ_constraints_pkg.web.assets import asset

MOST_STREAMS = 32
"""Pages that may be open at once."""
_MOST_BODY = 2048
# A client that takes nothing for so long has gone.
_SEND_SECONDS = 10.0

Scope = Mapping[str, Any]
Receive = Callable[[], Awaitable[MutableMapping[str, Any]]]
Send = Callable[[MutableMapping[str, Any]], Awaitable[None]]

ACTIONS = ('enable', 'disable', 'prune', 'reset_stats', 'enable_rule', 'disable_rule')


@dataclass(frozen=True)
class Wish:
    """Something that the page asks to be done.

    Attributes:
        action: one of :data:`ACTIONS`.
        robot: topic of its verdicts.
        rule: id, for the last two actions; else empty.
    """

    action: str
    robot: str
    rule: str = ''


class Mailbox:
    """What one client has not been sent yet: of each kind the newest message, never more."""

    def __init__(self) -> None:
        self._waiting: dict[str, bytes] = {}
        self._wake = asyncio.Event()
        self.is_closed = False

    def put(self, frames: Mapping[str, bytes]) -> None:
        """Replace what waits; nothing is ever waited for."""
        self._waiting.update(frames)
        self._wake.set()

    def close(self) -> None:
        """End the stream."""
        self.is_closed = True
        self._wake.set()

    async def take(self) -> bytes:
        """Wait for something, and return all that waits; empty once it is closed."""
        await self._wake.wait()
        self._wake.clear()
        waiting, self._waiting = self._waiting, {}
        return b'' if self.is_closed else b''.join(waiting.values())


class Application:
    """Answers requests.

    Attributes:
        arrivals: how many streams have begun so far.
        streaming: addresses of the clients of the open ones.

    Args:
        access: what requests have to carry.
        wish: hands on a wish, and returns whether it could.
    """

    def __init__(self, access: Access, wish: Callable[[Wish], bool]) -> None:
        self._access, self._wish = access, wish
        self._files = _files()
        self._mailboxes: dict[Mailbox, object] = {}
        self.arrivals = 0

    @property
    def streams(self) -> int:
        """How many pages are open."""
        return len(self._mailboxes)

    def is_streaming(self, client: object) -> bool:
        """Return whether the client at an address is being sent the stream."""
        return client in self._mailboxes.values()

    def publish(self, messages: Mapping[str, bytes]) -> None:
        """Hand messages, by kind, to all clients."""
        frames = {
            kind: b'event: %s\ndata: %s\n\n' % (kind.encode(), data)
            for kind, data in messages.items()
        }
        for mailbox in self._mailboxes:
            mailbox.put(frames)

    def close(self) -> None:
        """End all streams."""
        for mailbox in self._mailboxes:
            mailbox.close()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer one request."""
        if scope['type'] != 'http':
            return
        headers: dict[bytes, list[bytes]] = {}
        for name, value in scope['headers']:
            headers.setdefault(name.lower(), []).append(value)
        try:
            self._access.check_host(headers)
            await self._answer(scope, headers, receive, send)
        except Refusal as refusal:
            body = json.dumps({'error': refusal.reason}).encode()
            more = [(b'retry-after', b'5')] if refusal.status == 503 else []
            await _respond(send, refusal.status, b'application/json', body, more)

    async def _answer(
        self, scope: Scope, headers: Mapping[bytes, list[bytes]], receive: Receive, send: Send
    ) -> None:
        path, method = scope['path'], scope['method']
        wanted = ('POST',) if path == '/control' else ('GET', 'HEAD')
        if path not in self._files and path not in ('/stream', '/control'):
            raise Refusal(404, 'there is no such page')
        if method not in wanted:
            raise Refusal(405, f'allowed is {" or ".join(wanted)}')
        if path == '/control':
            self._access.check_control(headers)
            if not self._wish(read_wish(await _body(headers, receive))):
                raise Refusal(503, 'too much is under way')
            await _respond(send, 202, b'application/json', b'{}')
        elif path == '/stream' and method == 'GET':
            await self._stream(scope, receive, send)
        else:
            kind, body = self._files.get(path, (b'text/event-stream', b''))
            await _respond(send, 200, kind, body if method == 'GET' else b'')

    async def _stream(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Send what is published until the client has gone."""
        if self.streams >= MOST_STREAMS:
            raise Refusal(503, f'{MOST_STREAMS} pages are open; allowed are no more')
        mailbox = Mailbox()
        self._mailboxes[mailbox] = scope['client']
        self.arrivals += 1
        leaving = asyncio.ensure_future(_close_when_gone(receive, mailbox))
        try:
            async with asyncio.timeout(_SEND_SECONDS):
                await _begin(send, 200, b'text/event-stream')
                await _part(send, b'retry: 1000\n\n')
            while frames := await mailbox.take():
                async with asyncio.timeout(_SEND_SECONDS):
                    await _part(send, frames)
            async with asyncio.timeout(_SEND_SECONDS):
                await _part(send, b'', is_last=True)
        except TimeoutError:
            # The connection is cut, as that of everybody who is not streaming for long.
            pass
        finally:
            leaving.cancel()
            del self._mailboxes[mailbox]


async def _close_when_gone(receive: Receive, mailbox: Mailbox) -> None:
    while (await receive())['type'] != 'http.disconnect':
        pass
    mailbox.close()


def read_wish(body: bytes) -> Wish:
    """Return what a request asks for.

    Raises:
        Refusal: it is none of the things that can be asked for.
    """
    try:
        said = json.loads(body)
    except (ValueError, RecursionError):
        said = None
    keys = ('action', 'robot', 'rule')
    if not isinstance(said, dict) or not all(isinstance(said.get(key, ''), str) for key in keys):
        raise Refusal(400, 'allowed is an object with the texts action, robot and rule')
    wish = Wish(*(said.get(key, '') for key in keys))
    if wish.action not in ACTIONS:
        raise Refusal(400, f'action: allowed are {", ".join(ACTIONS)}')
    if not wish.robot or bool(wish.rule) != wish.action.endswith('_rule'):
        raise Refusal(400, 'robot is missing, or a rule is missing or named for nothing')
    return wish


async def _body(headers: Mapping[bytes, list[bytes]], receive: Receive) -> bytes:
    """Return the body of a request, of which no more is taken than a wish can have."""
    told = b''.join(headers.get(b'content-length', []))
    if told.isdigit() and int(told[:9]) > _MOST_BODY:
        raise Refusal(413, f'allowed are {_MOST_BODY} bytes')
    body = b''
    while True:
        message = await receive()
        body += message.get('body', b'')
        if len(body) > _MOST_BODY:
            raise Refusal(413, f'allowed are {_MOST_BODY} bytes')
        if not message.get('more_body'):
            return body


async def _respond(
    send: Send,
    status: int,
    kind: bytes,
    body: bytes,
    more: Iterable[tuple[bytes, bytes]] = (),
) -> None:
    length = (b'content-length', str(len(body)).encode())
    # What is left of a request that is refused is not read.
    end = [] if status < 400 else [(b'connection', b'close')]
    await _begin(send, status, kind, [length, *end, *more])
    await _part(send, body, is_last=True)


async def _begin(
    send: Send, status: int, kind: bytes, more: Iterable[tuple[bytes, bytes]] = ()
) -> None:
    headers = [(b'content-type', kind), *HEADERS, *more]
    await send({'type': 'http.response.start', 'status': status, 'headers': headers})


async def _part(send: Send, body: bytes, *, is_last: bool = False) -> None:
    await send({'type': 'http.response.body', 'body': body, 'more_body': not is_last})


def _files() -> dict[str, tuple[bytes, bytes]]:
    """Return type and content of what is served, by path."""
    page = asset('page/index.html', __package__).replace('<!-- patterns -->', asset('patterns.svg'))
    style = asset('style.css') + asset('page/dashboard.css', __package__)
    program = b'text/javascript; charset=utf-8'
    return {
        '/': (b'text/html; charset=utf-8', page.encode()),
        '/style.css': (b'text/css; charset=utf-8', style.encode()),
        '/charts.js': (program, asset('charts.js').encode()),
        '/dashboard.js': (program, asset('page/dashboard.js', __package__).encode()),
    }
