# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
import numpy as np
from occ_constraints_pkg.worlds import layout as module
from occ_constraints_pkg.worlds.layout import sample_goal, sample_layout

_KEEPOUTS = np.array([0.4, 0.305] + [0.18] * 8 + [0.15])


def test_everything_keeps_clear_of_everything_and_of_the_edge():
    layout = sample_layout([np.random.default_rng(seed) for seed in range(100)])
    places = np.concatenate(
        [layout.robot[:, None, :2], layout.goal[:, None], layout.hazards, layout.vase[:, None, :2]],
        axis=1,
    )
    assert (np.abs(places).max(axis=2) <= 1.5 - _KEEPOUTS).all()
    first, second = np.triu_indices(11, 1)
    distance = np.linalg.norm(places[:, first] - places[:, second], axis=2)
    assert (distance >= _KEEPOUTS[first] + _KEEPOUTS[second] - 1e-12).all()
    # The whole floor is used.
    assert np.abs(layout.hazards).max() > 1.3
    for yaw in (layout.robot[:, 2], layout.vase[:, 2]):
        assert yaw.min() >= 0
        assert 5 < yaw.max() < 2 * np.pi


def test_a_new_goal_keeps_clear_of_where_things_are_now():
    rng = np.random.default_rng(0)
    layout = sample_layout([rng])
    obstacles = np.concatenate([[[0.0, 0.0]], layout.hazards[0], [[1.2, 1.2]]])
    keepouts = np.delete(_KEEPOUTS, 1)
    for _ in range(50):
        goal = sample_goal(rng, obstacles)
        assert np.abs(goal).max() <= 1.5 - 0.305
        assert (np.linalg.norm(obstacles - goal, axis=1) >= keepouts + 0.305 - 1e-12).all()


def test_no_room_for_a_goal_is_told(monkeypatch):
    monkeypatch.setattr(module, '_OBSTACLE_KEEPOUTS', np.full(10, 3.0))
    assert sample_goal(np.random.default_rng(0), np.zeros((10, 2))) is None
