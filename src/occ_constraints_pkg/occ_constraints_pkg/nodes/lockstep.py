# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Lock-step of sim, policy and learner: tables of a step, their pairing by stamp, who else answers.

A message's stamp is the identity of a step.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from rclpy.publisher import Publisher
from rclpy.subscription import Subscription

from occ_constraints_pkg.errors import InputError, OccError
from occ_constraints_pkg.features.serialized_tables import TableMessage
from occ_constraints_pkg.features.table import Table
from occ_constraints_pkg.ros.node import OccNode
from occ_constraints_pkg.ros.tables import subscribe_to_tables
from occ_constraints_pkg.worlds.base import Column
from occ_constraints_pkg.worlds.stream import StepBatch

STEP_COLUMNS = ('reward', 'terminated', 'truncated', 'episode', 'true_cost')


def observation_table(columns: Sequence[Column], batch: StepBatch) -> Table:
    """Return a step as the table that ``observation`` carries: float32, one row per robot.

    An episode's number is exact in float32 up to 16.7 million.
    """
    names = (*(column.name for column in columns), *STEP_COLUMNS)
    values = np.empty((len(batch.reward), len(names)), dtype=np.float32)
    values[:, : len(columns)] = batch.observation
    for index, name in enumerate(STEP_COLUMNS, start=len(columns)):
        values[:, index] = getattr(batch, name)
    return Table(names, values)


def step_batch(table: Table) -> StepBatch:
    """Return the step that an observation table carries.

    Raises:
        OccError: the table does not end in the columns of a step.
    """
    size = len(STEP_COLUMNS)
    if table.names[-size:] != STEP_COLUMNS:
        raise InputError(
            f'an observation table must end in the columns {", ".join(STEP_COLUMNS)}; '
            f'this one has {", ".join(table.names)}'
        )
    reward, terminated, truncated, episode, true_cost = table.values[:, -size:].T
    return StepBatch(
        table.values[:, :-size],
        reward.astype(np.float64),
        terminated > 0,
        truncated > 0,
        episode.astype(np.int64),
        true_cost.astype(np.float64),
    )


def action_table(columns: Sequence[Column], action: np.ndarray) -> Table:
    """Return actions (N, a) as the table that ``action`` carries: float32."""
    return Table(tuple(column.name for column in columns), np.asarray(action, dtype=np.float32))


class Pairing:
    """Passes on two messages once both topics have shown the same stamp.

    Lock-step has one step under way at a time, so only the newest message of each topic is kept;
    a message that is repeated while its partner is kept is passed on again, as it should be: the
    answer may have been lost.

    Attributes:
        first: the newest message of the first topic, ``None`` before any.

    Args:
        callback: called with the messages of the first and the second topic.
    """

    def __init__(self, callback: Callable[[TableMessage, TableMessage], None]) -> None:
        self._callback = callback
        self.first: TableMessage | None = None
        self._second: TableMessage | None = None

    def on_first(self, message: TableMessage) -> None:
        """Take a message of the first topic."""
        self.first = message
        self._pair()

    def on_second(self, message: TableMessage) -> None:
        """Take a message of the second topic."""
        self._second = message
        self._pair()

    def _pair(self) -> None:
        first, second = self.first, self._second
        if first is None or second is None:
            return
        if first.stamp_ns != second.stamp_ns:
            return
        self._second = None
        self._callback(first, second)


class CompetingPublishers:
    """Detects nodes that answer a step otherwise than this one: whose action was carried out?

    It subscribes to the topic of the answers only once that has another publisher, which alone
    proves nothing: a node that was killed is listed for some seconds more.

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

    def check_publishers(self) -> None:
        """Find out whether there are other publishers; call it now and then."""
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
