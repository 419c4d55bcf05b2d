# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Node ``policy``: answers each observation with the action of a scripted or trained policy."""

from __future__ import annotations

import numpy as np
from sensor_msgs.msg import PointCloud2

from occ_constraints_pkg.agents.drivers import Driver, check_name, find_driver
from occ_constraints_pkg.agents.policy import GaussianPolicy
from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.features.serialized_tables import TableMessage
from occ_constraints_pkg.nodes.lockstep import Pairing, action_table, step_batch
from occ_constraints_pkg.ros.node import OccNode
from occ_constraints_pkg.ros.process import run_node
from occ_constraints_pkg.ros.qos import STEPS, overridable
from occ_constraints_pkg.ros.tables import subscribe_to_tables, table_bytes
from occ_constraints_pkg.worlds.base import World
from occ_constraints_pkg.worlds.registry import world_class


class Policy(OccNode):
    """Acts on the observation alone, or only once the monitor has judged it too."""

    def __init__(self) -> None:
        super().__init__('policy')
        self._name = self.parameter(
            'policy', 'random', "policy file (.npz), or a driver such as 'expert' or 'random'"
        )
        seed = self.parameter('seed', 0, 'seed of the random choices', low=0)
        self._explore = self.parameter(
            'explore', False, 'sample from a trained policy instead of taking its mean action'
        )
        wait = self.parameter(
            'wait_for_costs', False, 'act only when costs of the same stamp are there as well'
        )
        self.declared()
        self._rng = np.random.default_rng(seed)
        # A mistake is to show before the first observation, as far as the world plays no part.
        check_name(self._name)
        if self._name.endswith('.npz'):
            GaussianPolicy.load(self._name)
        self._driver: Driver | None = None
        self._last: tuple[int, bytes] | None = None
        self._kind: type[World] | None = None
        self._action = self.create_publisher(
            PointCloud2, 'action', STEPS, qos_overriding_options=overridable()
        )
        self._pairing = Pairing(self._answer) if wait else None
        topics = {'observation': self._on_observation}
        if self._pairing is not None:
            topics['costs'] = self._pairing.on_second
        names = [subscribe_to_tables(self, *item).topic_name for item in topics.items()]
        self.get_logger().info(f'policy {self._name!r}, waiting for {" and ".join(names)}')

    def _on_observation(self, message: TableMessage) -> None:
        if self._pairing is not None:
            self._pairing.on_first(message)
        else:
            self._answer(message, None)

    def _answer(self, message: TableMessage, _costs: TableMessage | None) -> None:
        world, stamp = message.frame_id, message.stamp_ns
        if self._last is not None and stamp == self._last[0]:
            # A repeat: the answer was lost or crossed with it. Nothing is drawn anew.
            self._action.publish(self._last[1])
            return
        if self._kind is None or self._kind.name != world:
            self._kind = world_class(world)
            self._driver = find_driver(self._kind, self._name, self._rng, explore=self._explore)
        try:
            batch = step_batch(message.table)
            action = self._driver(batch.observation)
        except OccError as error:
            self.get_logger().error(f'observation ignored: {error}', throttle_duration_sec=1.0)
            return
        answer = action_table(self._kind.action_columns, action)
        self._last = stamp, table_bytes(answer, stamp, world)
        self._action.publish(self._last[1])


def main(argv: list[str] | None = None) -> int:
    """Run the node."""
    return run_node(Policy, argv)
