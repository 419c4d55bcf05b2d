# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Against traces of safety-gymnasium 1.0.0 (MuJoCo 2.3.3) under random actions.

Contacts with vase, box and pillar are not compared, as MuJoCo's collision routines have changed.
"""

import os
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip('mujoco')
from occ_constraints_pkg.worlds.registry import world_class  # noqa: E402

from experiments.reference_traces import (  # noqa: E402
    TASKS,
    ReferenceGoals,
    free_run,
    load_traces,
    reference_start,
    reference_step,
    single_steps,
)

_DATA = Path(os.environ.get('OCC_TEST_DATA', Path(__file__).parents[3] / 'shared' / 'data'))
_FOLDER = _DATA / 'safety_gym_traces'


def _traces(task):
    if not (_FOLDER / f'{task}_random.npz').is_file():
        pytest.skip(f'no reference traces in {_FOLDER}')
    return load_traces(task, _FOLDER)


@pytest.mark.parametrize('task', ['PointGoal1', 'PointPush1'])
def test_every_single_step_of_a_point(task):
    """From each recorded state, one step gives the next: position, reward, cost, every column."""
    traces = _traces(task)
    found = single_steps(traces)
    assert np.isfinite(found.position).sum() > 3900
    worst = found.over(traces.untouched)
    assert worst['position'] < 1e-13
    assert worst['sensors'] < 1e-6
    assert worst['lidars'] < 1e-6
    # A box that settles in the record moves by this much in steps that we do not see.
    assert worst['reward'] < (1e-12 if 'Goal' in task else 1e-9)
    assert not worst['cost']


@pytest.mark.parametrize('task', ['PointGoal1', 'PointPush1'])
def test_the_path_of_a_point(task):
    """The turning servo chatters, which amplifies rounding: the path still stays within 10 cm."""
    traces = _traces(task)
    steps = 300
    found = free_run(traces, steps)
    assert (found.position[:, :10] < 1e-9).all()
    assert found.over(np.minimum(traces.untouched, steps))['position'] < 0.1


@pytest.mark.parametrize('task', ['CarGoal1', 'CarPush1'])
def test_the_path_of_a_car_and_everything_along_it(task):
    """Whole episodes agree, until something is touched."""
    traces = _traces(task)
    steps = 400
    found = free_run(traces, steps)
    most = np.minimum(traces.untouched, steps)
    followed = found.followed(most)
    # In one episode a contact with the floor hangs on less than the paths agree by.
    assert (followed == most).sum() >= 4
    assert followed.min() > 100
    worst = found.over(followed)
    assert worst['position'] < 1e-5
    assert worst['sensors'] < 1e-3
    assert worst['lidars'] < 1e-4
    assert worst['reward'] < 1e-5
    assert not worst['cost']


def test_new_goals_are_those_of_the_reference():
    """Every goal after the first in the records is drawn, to the last bit."""
    goals = 0
    for task in TASKS:
        traces, kind = _traces(task), world_class(task)
        rules = ReferenceGoals(kind.rules.keepouts)
        stepped = _Stepped()
        for number in range(len(traces.goal)):
            layout, rng = reference_start(kind, number)
            stepped.generators = [rng]
            for step in range(1, traces.untouched[number]):
                reference_step(stepped, None)
                goal = traces.goal[number, step, :2]
                if (goal == traces.goal[number, step - 1, :2]).all():
                    continue
                things = (traces.pos[number, step, :2], *layout.hazards[0], *layout.pillars[0])
                drawn = rules.sample_goal(rng, np.stack([*things, layout.movable[0, :2]]))
                np.testing.assert_array_equal(drawn, goal)
                goals += 1
    assert goals == 2


class _Stepped:
    """Stands for a world whose steps are in the record."""

    def step(self, action):
        del action


def test_an_episode_with_a_new_goal_follows_the_record_to_its_end():
    """From the start and the actions alone: 999 steps of a car, past the goal that it reaches."""
    traces = _traces('CarGoal1')
    found = free_run(traces)
    (episode,) = (
        number
        for number, followed in enumerate(found.followed(traces.untouched))
        if followed == 999 and (traces.goal[number] != traces.goal[number, 0]).any()
    )
    assert found.position[episode].max() < 1e-5
    assert found.lidars[episode].max() < 1e-4
    assert found.reward[episode].max() < 1e-5
    assert not found.cost[episode].any()
