# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""An observer of nodes, for tests: it is patient, and calls services."""

from occ_constraints_pkg.demo.observer import Observer
from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.ros.qos import SETTLED_CHECKS

# How long new endpoints may take to find one another, after the first look that shows them.
_SETTLED_SECONDS = SETTLED_CHECKS * 0.05
# A client knows a service before the service knows the client, and an answer sent within that
# moment is dropped. No call tells when it is over; so a request without an answer is repeated.
_ANSWER_SECONDS = 3.0
# For what must come: a test fails after so many seconds, which a busy machine may need.
_PATIENCE = 60.0


class Listener(Observer):
    """Adds calls of services, and waiting for an answer without the delay of looking for it."""

    def __init__(self, *arguments):
        super().__init__(*arguments)
        self._clients = {}

    def spin_until(self, condition, seconds=_PATIENCE):
        super().spin_until(condition, seconds)

    def wait_for_monitor(self, subscribers, seconds=_PATIENCE):
        super().wait_for_monitor(subscribers, seconds)

    def spin_until_done(self, future):
        self._executor.spin_until_future_complete(future, _PATIENCE)
        if not future.done():
            raise OccError(f'no answer came within {_PATIENCE:g} s')

    def call(self, kind, service, **fields):
        """Return the answer of a service; as requests are repeated, it may act twice."""
        client, futures = self._clients.get(service), []
        if client is None:
            client = self._clients[service] = self.node.create_client(kind, service)
            self.spin_until(client.service_is_ready)
            self.spin(_SETTLED_SECONDS)

        def answered():
            return [future.result() for future in futures if future.done()]

        for _ in range(round(_PATIENCE / _ANSWER_SECONDS)):
            futures.append(client.call_async(kind.Request(**fields)))
            self.spin(_ANSWER_SECONDS, answered)
            if answered():
                return answered()[0]
        raise OccError(f'service {service!r} gave no answer within {_PATIENCE:g} s')
