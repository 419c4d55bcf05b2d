# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Others that answer the same steps: then nobody knows which answer was carried out."""

from __future__ import annotations

import numpy as np
from rclpy.publisher import Publisher
from rclpy.subscription import Subscription

from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.features.serialized_tables import TableMessage
from occ_constraints_pkg.features.table import Table
from occ_constraints_pkg.ros.process import OccNode
from occ_constraints_pkg.ros.table_topics import subscribe_to_tables


class Rivals:
    """Notices nodes that answer a step otherwise than this one.

    It listens to the topic of the answers only from when it is seen to have another publisher. That
    alone proves nothing: a node that was killed is listed for some seconds more.

    Attributes:
        found: whether one has answered, and there may still be one.

    Args:
        node: the one that answers as well.
        publisher: by which it does.
    """

    def __init__(self, node: OccNode, publisher: Publisher) -> None:
        self.found = False
        self._node, self._topic = node, publisher.topic_name
        self._subscription: Subscription | None = None
        self._stamp: int | None = None
        self._answer: Table | None = None

    def look(self) -> None:
        """Look whether there are other publishers; call it now and then."""
        if self._node.count_publishers(self._topic) < 2:
            self.found = False
        elif self._subscription is None:
            self._subscription = subscribe_to_tables(self._node, self._topic, self._on_answer)

    def expect(self, stamp_ns: int, answer: Table | None) -> None:
        """Note the newest step, and this node's own answer to it once there is one."""
        self._stamp, self._answer = stamp_ns, answer

    def _on_answer(self, message: TableMessage) -> None:
        # This node's own answers come as well, and all but the last are to steps of the past.
        if message.stamp_ns != self._stamp:
            return
        try:
            values = message.table.values
        except OccError:
            return
        if self._answer is None or not np.array_equal(values, self._answer.values):
            self.found = True
