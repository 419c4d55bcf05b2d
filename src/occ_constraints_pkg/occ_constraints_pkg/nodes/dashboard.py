# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Node ``dashboard``: serves a page that shows all robots live, on this computer only."""

from __future__ import annotations

import queue
import sys
import time
from collections.abc import Callable

from occ_constraints_pkg.dashboard.access import access_of, is_loopback, new_token, read_token
from occ_constraints_pkg.dashboard.application import Wish
from occ_constraints_pkg.dashboard.documents import Documents
from occ_constraints_pkg.dashboard.server import PageServer
from occ_constraints_pkg.documents import read_text
from occ_constraints_pkg.errors import ConfigurationError
from occ_constraints_pkg.fleet.calls import Calls
from occ_constraints_pkg.fleet.model import Fleet
from occ_constraints_pkg.fleet.network import Network
from occ_constraints_pkg.ros.node import OccNode
from occ_constraints_pkg.ros.process import run_node

_TICK_SECONDS = 0.2
# Calls of services that may be under way at once.
_MOST_WISHES = 8


class Dashboard(OccNode):
    """Brings the model of all robots up to date at a fixed rate, and hands it to the page's server.

    ROS has the main thread, as in every node; the server has a thread of its own. Between them go
    bytes and, if allowed, wishes.
    """

    def __init__(self) -> None:
        super().__init__('dashboard')
        self._host = self.parameter('host', '127.0.0.1', 'address to listen to')
        self._port = self.parameter('port', 8417, 'port; 0: any that is free', low=0, high=65535)
        hosts = self.parameter(
            'hosts', [], 'further names that a browser may call this computer by; none: localhost'
        )
        allows_control = self.parameter(
            'allow_control', False, 'let those with the token enable, disable, prune and reset'
        )
        token_file = self.parameter(
            'token_file', '', 'file that holds the token; none: a new one, printed on stderr'
        )
        self.declared()
        if token_file and not allows_control:
            raise ConfigurationError(
                'token_file is given but nothing may be changed; allowed is it with '
                'allow_control:=true'
            )
        self._token_is_new = allows_control and not token_file
        token = ''
        if allows_control:
            token = read_token(read_text(token_file), token_file) if token_file else new_token()
        access = access_of(self._host, hosts, token)
        self._token = token
        self._wishes: queue.SimpleQueue[Wish] = queue.SimpleQueue()
        self._fleet = Fleet()
        self._documents = Documents(self._fleet, allows_control=access.allows_control)
        self._server = PageServer(access, self._take_wish)
        self._network: Network | None = None
        # Pages that were opened when everything was told last.
        self._arrivals = 0

    def begin(self) -> None:
        """Join the ROS domain as a listener, and serve the page."""
        self._network = Network(self._fleet, self.context)
        self._server.start(self._host, self._port)
        shown = f'[{self._host}]' if ':' in self._host else self._host
        address = f'http://{shown}:{self._server.port}/'
        control = 'with the token, rules can be changed' if self._token else 'read-only'
        self.get_logger().info(f'the page is at {address} ({control})')
        if self._token_is_new:
            # Not logged, for logs are kept and copied.
            print(f'to change something, open {address}#token={self._token}', file=sys.stderr)
        if not is_loopback(self._host):
            self.get_logger().warning(
                f'whoever reaches port {self._server.port} of this computer can read the page'
                + (', and the token is sent in clear' if self._token else '')
                + '; allowed without this warning is host:=127.0.0.1, through a tunnel: ssh -L'
            )
        self.steady_timer(_TICK_SECONDS, self._tick)

    def close(self) -> None:
        """Leave all clients."""
        self._server.close()
        if self._network is not None:
            self._network.close()

    def _tick(self) -> None:
        self._network.poll()
        # Lines are for those without a page.
        self._fleet.fresh_changes()
        while not self._wishes.empty():
            self._do(self._wishes.get())
        if not self._server.streams:
            return
        arrivals = self._server.arrivals
        messages = self._documents.messages(time.monotonic(), anew=arrivals != self._arrivals)
        self._arrivals = arrivals
        self._server.publish(messages)

    def _take_wish(self, wish: Wish) -> bool:
        """Keep a wish for the next tick; called in the server's thread."""
        waiting = self._wishes.qsize() + len(self._network.calls.under_way)
        if waiting >= _MOST_WISHES:
            return False
        self._wishes.put(wish)
        return True

    def _do(self, wish: Wish) -> None:
        """Call the service of a monitor that is known; nothing else can be called."""
        robot = self._fleet.robots.get(wish.robot)
        if robot is None or not robot.monitor:
            self._fleet.note(
                time.monotonic(), wish.robot, 'failed', 'no monitor is known that could be asked'
            )
            return
        known = {rule.id for rule in robot.rule_set.rules} if robot.rule_set else set()
        if wish.rule and wish.rule not in known:
            self._fleet.note(
                time.monotonic(), robot.name, 'failed', f'there is no rule {wish.rule!r}'
            )
            return
        self.get_logger().info(f'the page asks {robot.monitor}: {wish.action} {wish.rule}'.rstrip())
        _call(self._network.calls, robot.monitor, wish)()


def _call(calls: Calls, monitor: str, wish: Wish) -> Callable[[], None]:
    """Return the call that fulfils a wish."""
    return {
        'enable': lambda: calls.enable(monitor, True),
        'disable': lambda: calls.enable(monitor, False),
        'prune': lambda: calls.prune(monitor),
        'reset_stats': lambda: calls.reset_stats(monitor),
        'enable_rule': lambda: calls.enable_rule(monitor, wish.rule, True),
        'disable_rule': lambda: calls.enable_rule(monitor, wish.rule, False),
    }[wish.action]


def main(argv: list[str] | None = None) -> int:
    """Run the node."""
    return run_node(Dashboard, argv)
