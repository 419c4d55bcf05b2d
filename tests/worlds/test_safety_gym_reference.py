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
from occ_constraints_pkg.experiments.reference_traces import (  # noqa: E402
    free_run,
    load_traces,
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
