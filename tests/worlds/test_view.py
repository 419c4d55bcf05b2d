# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.worlds.geometry import matrix_of
from occ_constraints_pkg.worlds.registry import make_world

TASKS = ('PointGoal1', 'PointPush1', 'CarGoal1', 'CarPush1')


@pytest.fixture(params=TASKS)
def world(request):
    pytest.importorskip('mujoco')
    world = make_world(request.param, 2)
    world.reset(seed=3)
    yield world
    world.close()


def _ahead(world):
    """Return an action that drives straight on."""
    return np.array([[1.0, 0.0] if 'Point' in world.name else [1.0, 1.0]] * 2)


def test_a_robot_that_drives_on_moves_along_its_own_x_axis(world):
    start = world.view(1).position
    for _ in range(25):
        world.step(_ahead(world))
    view = world.view(1)
    x_axis = matrix_of(view.quaternion[None])[0][:, 0]
    moved = view.position - start
    assert np.linalg.norm(moved) > 0.1
    assert moved @ x_axis > 0.97 * np.linalg.norm(moved)
    assert view.linear_velocity[0] > 0.3
    assert abs(view.linear_velocity[1]) < 0.1
    assert view.acceleration[2] > 2.0


def test_beams_point_at_things(world):
    view = world.view(0)
    to_base = matrix_of(view.quaternion[None])[0].T
    assert view.ranges.keys() == set(world.view_kinds)
    angles = view.first_beam + view.beam_step * np.arange(16)
    assert -np.pi < angles[0] < angles[-1] < np.pi
    names = {'hazards': 'hazard', 'vases': 'vase', 'pillars': 'pillar', 'push_box': 'box'}
    for kind, ranges in view.ranges.items():
        places = [t.position for t in view.things if t.kind == names.get(kind, kind)]
        local = (np.array(places) - view.position) @ to_base.T
        distance = np.hypot(local[:, 0], local[:, 1])
        nearest = local[distance.argmin()]
        bearing = np.arctan2(nearest[1], nearest[0])
        off = np.angle(np.exp(1j * (angles[ranges.argmin()] - bearing)))
        assert abs(off) <= view.beam_step / 2 + 1e-6
        assert ranges.min() == pytest.approx(distance.min(), abs=1e-5)
        assert np.isinf(ranges).any()


def test_all_there_is_is_in_the_view(world):
    kinds = sorted(thing.kind for thing in world.view(0).things)
    if 'Goal' in world.name:
        assert kinds == ['goal'] + ['hazard'] * 8 + ['robot', 'vase']
    else:
        assert kinds == ['box', 'goal', 'hazard', 'hazard', 'pillar', 'robot']
    for thing in world.view(0).things:
        assert thing.shape in ('box', 'cylinder')
        assert (thing.size > 0).all()
        assert np.linalg.norm(thing.quaternion) == pytest.approx(1)


@pytest.mark.parametrize(('speed', 'turning'), [(0.4, 0.0), (-0.3, 0.0), (0.0, 0.8), (0.3, -0.6)])
def test_a_velocity_command_is_obeyed(world, speed, turning):
    # Out of everybody's way.
    world.physics.qpos[:, 0] += 20.0
    speeds, headings = [], []
    for step in range(120):
        action = np.stack([world.action_for(row, speed, turning) for row in (0, 1)])
        world.step(action)
        if step >= 60:
            view = world.view(0)
            x_axis = matrix_of(view.quaternion[None])[0][:, 0]
            speeds.append(view.linear_velocity[0])
            headings.append(np.arctan2(x_axis[1], x_axis[0]))
    # The gyro of a Point chatters, so the way it turned is what counts.
    headings = np.unwrap(headings)
    rate = (headings[-1] - headings[0]) / (world.step_seconds * (len(headings) - 1))
    np.testing.assert_allclose([np.mean(speeds), rate], [speed, turning], atol=0.15)


def test_a_world_without_headings_says_so():
    world = make_world('simple_nav', 1)
    assert world.view_kinds is None
    with pytest.raises(OccError, match='no view'):
        world.view(0)
    with pytest.raises(OccError, match='velocity commands'):
        world.action_for(0, 1.0, 0.0)
