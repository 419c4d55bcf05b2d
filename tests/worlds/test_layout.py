# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from occ_constraints_pkg.worlds.layout import PlacementRules

# Keepouts of the robot, the goal, hazards, pillars and the movable thing.
_GOAL = PlacementRules(robot=0.4, goal=0.305, hazards=(0.18,) * 8, pillars=(), movable=0.15)
_PUSH = PlacementRules(robot=0.4, goal=0.4, hazards=(0.4,) * 2, pillars=(0.3,), movable=0.2)
_CASES = [
    (_GOAL, [0.4, 0.305] + [0.18] * 8 + [0.15]),
    (_PUSH, [0.4, 0.4, 0.4, 0.4, 0.3, 0.2]),
]


@pytest.mark.parametrize(('rules', 'keepouts'), _CASES)
def test_everything_keeps_clear_of_everything_and_of_the_edge(rules, keepouts):
    layout = rules.sample_layout([np.random.default_rng(seed) for seed in range(100)])
    robot, movable = layout.robot[:, None, :2], layout.movable[:, None, :2]
    places = np.concatenate(
        [robot, layout.goal[:, None], layout.hazards, layout.pillars, movable], axis=1
    )
    keepouts = np.array(keepouts)
    assert places.shape == (100, len(keepouts), 2)
    assert (np.abs(places).max(axis=2) <= 1.5 - keepouts).all()
    first, second = np.triu_indices(len(keepouts), 1)
    distance = np.linalg.norm(places[:, first] - places[:, second], axis=2)
    assert (distance >= keepouts[first] + keepouts[second] - 1e-12).all()
    # The whole floor is used.
    assert np.abs(layout.movable[:, :2]).max() > 1.2
    for yaw in (layout.robot[:, 2], layout.movable[:, 2]):
        assert yaw.min() >= 0
        assert 5 < yaw.max() < 2 * np.pi


@pytest.mark.parametrize(('rules', 'keepouts'), _CASES)
def test_a_new_goal_keeps_clear_of_where_things_are_now(rules, keepouts):
    rng = np.random.default_rng(0)
    layout = rules.sample_layout([rng])
    obstacles = np.concatenate([[[0.0, 0.0]], layout.hazards[0], layout.pillars[0], [[1.2, 1.2]]])
    reach = np.delete(keepouts, 1) + keepouts[1]
    for _ in range(50):
        goal = rules.sample_goal(rng, obstacles)
        assert np.abs(goal).max() <= 1.5 - keepouts[1]
        assert (np.linalg.norm(obstacles - goal, axis=1) >= reach - 1e-12).all()


def test_no_room_for_a_goal_is_told():
    rules = PlacementRules(robot=3.0, goal=0.3, hazards=(), pillars=(), movable=0.1)
    assert rules.sample_goal(np.random.default_rng(0), np.zeros((2, 2))) is None
