# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Who may ask for what: names of this host, origins, and the token for what changes something."""

from __future__ import annotations

import hmac
import ipaddress
import secrets
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from occ_constraints_pkg.errors import ConfigurationError

LOCAL_NAMES = frozenset({'localhost', '127.0.0.1', '::1'})
LEAST_TOKEN = 16
"""Characters that a token must have."""

# Nothing is loaded from elsewhere, nothing inline runs, and no other page may frame or read it.
HEADERS = (
    (
        b'content-security-policy',
        b"default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; "
        b"img-src data:; base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    ),
    (b'x-content-type-options', b'nosniff'),
    (b'x-frame-options', b'DENY'),
    (b'referrer-policy', b'no-referrer'),
    (b'cross-origin-resource-policy', b'same-origin'),
    (b'cross-origin-opener-policy', b'same-origin'),
    (b'cache-control', b'no-store'),
)


class Refusal(Exception):  # noqa: N818
    """A request that is not answered as it asks.

    Attributes:
        status: of HTTP.
        reason: one sentence for people.
    """

    def __init__(self, status: int, reason: str) -> None:
        super().__init__(reason)
        self.status, self.reason = status, reason


@dataclass(frozen=True)
class Access:
    """What requests have to carry.

    Attributes:
        hosts: names of this host that a browser may call it by, without a port. A page of another
            site whose name is suddenly resolved to this host is refused by its name.
        token: for what changes something; empty: nothing may be changed.
    """

    hosts: frozenset[str]
    token: str = ''

    @property
    def allows_control(self) -> bool:
        """Whether anything may be changed at all."""
        return bool(self.token)

    def check_host(self, headers: Mapping[bytes, list[bytes]]) -> None:
        """Check by which name this host is called.

        Raises:
            Refusal: by none of its own.
        """
        named = headers.get(b'host', [])
        if len(named) != 1 or _without_port(named[0]) not in self.hosts:
            raise Refusal(
                421,
                f'this page is not served under that name; allowed are {", ".join(self.names)}, '
                'and those of the parameter hosts',
            )

    def check_control(self, headers: Mapping[bytes, list[bytes]]) -> None:
        """Check whether a request may change something.

        Raises:
            Refusal: it may not.
        """
        if not self.allows_control:
            raise Refusal(403, 'this page is read-only; allowed with the parameter allow_control')
        origins = headers.get(b'origin', [])
        site = headers.get(b'sec-fetch-site', [b'same-origin'])
        own = b'http://' + headers[b'host'][0].lower()
        if any(item.lower() != own for item in origins) or site != [b'same-origin']:
            raise Refusal(403, 'the request comes from another page')
        # Not compared as text, which would be refused for other letters than those of ASCII.
        given = b''.join(headers.get(b'authorization', []))
        if not hmac.compare_digest(given, b'Bearer ' + self.token.encode()):
            raise Refusal(401, 'the token is missing or wrong')
        if headers.get(b'content-type', []) != [b'application/json']:
            raise Refusal(415, 'allowed is the content type application/json')

    @property
    def names(self) -> list[str]:
        """The names in order."""
        return sorted(self.hosts)


def access_of(host: str, others: Iterable[str], token: str) -> Access:
    """Return what requests have to carry.

    Args:
        host: the address that is listened to.
        others: further names of this host.
        token: for what changes something; empty for nothing.

    Raises:
        ConfigurationError: a name is none.
    """
    names = set(LOCAL_NAMES)
    for name in (host, *others):
        if not name or any(sign in name for sign in '/@?# *') or '://' in name:
            raise ConfigurationError(
                f'hosts: got {name!r}; allowed is a name or an address of this computer, without '
                'a port, such as robot.local'
            )
        if not _is_any(name):
            names.add(name.lower().strip('[]'))
    return Access(frozenset(names), token)


def is_loopback(host: str) -> bool:
    """Return whether only this computer reaches an address."""
    try:
        return ipaddress.ip_address(host.strip('[]')).is_loopback
    except ValueError:
        return host.lower() == 'localhost'


def new_token() -> str:
    """Return a token that nobody guesses."""
    return secrets.token_urlsafe(24)


def read_token(text: str, where: str) -> str:
    """Return the token that a file holds.

    Raises:
        ConfigurationError: it is too short, or has signs that no header has.
    """
    token = text.strip()
    is_plain = token.isascii() and token.isprintable() and ' ' not in token
    if not is_plain or len(token) < LEAST_TOKEN:
        raise ConfigurationError(
            f'{where}: got a token of {len(token)} signs; allowed are {LEAST_TOKEN} or more '
            'letters, digits and signs of ASCII without a blank, such as of: openssl rand -hex 24'
        )
    return token


def _is_any(name: str) -> bool:
    try:
        return ipaddress.ip_address(name.strip('[]')).is_unspecified
    except ValueError:
        return False


def _without_port(value: bytes) -> str:
    text = value.decode('latin-1').lower()
    if text.startswith('['):
        name, bracket, port = text[1:].partition(']')
        return name if bracket and (not port or _is_port(port)) else ''
    name, colon, port = text.partition(':')
    return name if not colon or _is_port(f':{port}') else ''


def _is_port(text: str) -> bool:
    return text.startswith(':') and text[1:].isdecimal()
