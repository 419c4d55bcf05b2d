# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The experts that are shipped drive where they are offered."""

import numpy as np
from occ_constraints_pkg.agents.drivers import find_driver
from occ_constraints_pkg.worlds.highway import Highway, RestrictedHighway


def test_the_expert_of_the_highway_drives_all_restricted_scenarios_without_a_violation():
    number = RestrictedHighway.scenarios
    world = RestrictedHighway(number)
    observation, _ = world.start(np.arange(number), list(range(number)))
    drive, same = (
        find_driver(kind, 'expert', np.random.default_rng(0))
        for kind in (RestrictedHighway, Highway)
    )
    np.testing.assert_array_equal(drive(observation), same(observation))
    for _ in range(world.max_episode_steps):
        observation, _, terminated, truncated, _ = world.step(drive(observation))
        assert not terminated.any()
    assert truncated.all()
