# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

pytest.importorskip('highway_env')

from highway_env import utils
from highway_env.vehicle.kinematics import Vehicle
from occ_constraints_pkg.worlds.highway_traffic import _overlap

from experiments.highway_fidelity import compare


def test_traffic_alone_drives_as_in_highway_env_for_40_s():
    found = compare([5])
    assert found.steps == 200
    assert found.lane_changes > 5
    assert found.position < 1e-9
    assert found.surroundings < 1e-9
    assert found.ends_differ == 0


def test_with_an_ego_that_swerves_and_brakes_all_is_the_same_up_to_its_end():
    # One swerves, one keeps steering to the left, one does not slow down for others.
    rng = np.random.default_rng(0)
    actions = rng.uniform(-1.0, 1.0, (60, 3, 2)) * (1.0, 0.02)
    actions[:, 1] = 0.0, 0.01
    actions[:, 2] = 1.0, 0.0
    found = compare([0, 4, 8], actions=actions, steps=60)
    assert found.steps > 60
    assert found.position < 1e-9
    assert found.surroundings < 1e-9
    assert found.ends_differ == 0
    assert found.collisions >= 1
    assert found.off_road >= 1


def test_overlap_is_that_of_highway_env():
    rng = np.random.default_rng(0)
    n = 400
    offset = rng.uniform(-6.0, 6.0, (2, n))
    angles = rng.uniform(-0.6, 0.6, (2, n))
    speeds = rng.uniform(0.0, 40.0, (2, n))
    own, other = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    moved = 0.2 * (speeds[0] * own - speeds[1] * other)
    now, soon = _overlap(offset, own, other, moved)
    for i in range(n):
        pair = [
            Vehicle(None, place, heading, speed)
            for place, heading, speed in (
                (np.zeros(2), angles[0, i], speeds[0, i]),
                (offset[:, i], angles[1, i], speeds[1, i]),
            )
        ]
        shapes = [vehicle.polygon() for vehicle in pair]
        ways = [vehicle.velocity * 0.2 for vehicle in pair]
        assert utils.are_polygons_intersecting(*shapes, *ways)[:2] == (now[i], soon[i])
    assert 0 < now.sum() < soon.sum() < n
