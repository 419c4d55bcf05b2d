# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The scenarios of the world ``highway`` in highway-env itself, to compare and to draw."""

from __future__ import annotations

import numpy as np
from highway_env import utils
from highway_env.envs.highway_env import HighwayEnvFast
from highway_env.road.road import Road, RoadNetwork
from highway_env.vehicle.behavior import IDMVehicle
from occ_constraints_pkg.worlds.highway_features import FAR
from occ_constraints_pkg.worlds.highway_scenarios import LANE_WIDTH, SPEED_LIMIT, Scenario
from occ_constraints_pkg.worlds.highway_traffic import STEP_SECONDS

_FREQUENCY = round(1 / STEP_SECONDS)


class ReferenceHighway(HighwayEnvFast):
    """``highway-fast-v0`` from the start of a :class:`Scenario`, with continuous actions at 5 Hz.

    Args:
        scenario: where everyone is at the start.
        controlled: whether the ego is driven by actions; otherwise it is traffic like the others.
        steering_range: steering angle of action 1.0, in rad.
        duration: seconds after which an episode is truncated.
        render_mode: as in gymnasium.
    """

    def __init__(
        self,
        scenario: Scenario,
        *,
        controlled: bool = True,
        steering_range: float,
        duration: float,
        render_mode: str | None = None,
    ) -> None:
        self._scenario, self._controlled = scenario, controlled
        super().__init__(
            {
                'action': {
                    'type': 'ContinuousAction',
                    'steering_range': (-steering_range, steering_range),
                    'speed_range': (0.0, 40.0),
                },
                'simulation_frequency': _FREQUENCY,
                'policy_frequency': _FREQUENCY,
                'duration': duration,
                'offroad_terminal': True,
            },
            render_mode,
        )

    def _create_road(self) -> None:
        network = RoadNetwork.straight_road_network(self._scenario.lanes, speed_limit=SPEED_LIMIT)
        self.road = Road(network, np_random=self.np_random)

    def _create_vehicles(self) -> None:
        given = self._scenario
        for index in range(len(given.x)):
            place = np.array([given.x[index], given.y[index]])
            if index == 0 and self._controlled:
                vehicle = self.action_type.vehicle_class(self.road, place, speed=given.speed[0])
            else:
                vehicle = IDMVehicle(
                    self.road,
                    place,
                    speed=given.speed[index],
                    target_speed=given.desired_speed[index],
                )
                vehicle.DELTA = given.delta[index]
            # As in highway-fast: traffic passes through traffic.
            vehicle.check_collisions = index == 0
            self.road.vehicles.append(vehicle)
        self.controlled_vehicles = self.road.vehicles[:1]

    def states(self) -> np.ndarray:
        """Return x, y, heading and speed of all vehicles, the ego first: (V, 4) in m, rad, m/s."""
        return np.array([[*v.position, v.heading, v.speed] for v in self.road.vehicles])

    def let_traffic_drive(self) -> None:
        """Advance by one step with no action."""
        self._simulate(None)

    def surroundings(self) -> tuple[np.ndarray, np.ndarray]:
        """Return what the ego knows by highway-env's own means, in m and m/s.

        Returns:
            (10,) the features of the paper, and (6,) speeds of the neighbours relative to its own.
        """
        ego, (origin, end, lane) = self.vehicle, self.vehicle.lane_index
        gaps, relative = np.full((2, 3), FAR), np.zeros((2, 3))
        for side, index in enumerate((lane - 1, lane, lane + 1)):
            if not 0 <= index < self._scenario.lanes:
                continue
            front, rear = self.road.neighbour_vehicles(ego, (origin, end, index))
            for row, other in enumerate((rear, front)):
                if other is not None:
                    gap = abs(ego.lane_distance_to(other)) - ego.LENGTH
                    gaps[row, side] = utils.constrain(gap, 0.0, FAR)
                    relative[row, side] = other.velocity[0] - ego.velocity[0]
        y = ego.position[1]
        edges = y + LANE_WIDTH / 2, LANE_WIDTH * (self._scenario.lanes - 0.5) - y
        known = np.array([ego.velocity[0], -ego.velocity[1], *gaps.ravel(), *edges])
        return known, relative.ravel()
