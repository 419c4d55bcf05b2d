# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
import json

import numpy as np
import pytest

pytest.importorskip('mujoco')
from occ_constraints_pkg.worlds.safety_gym import CarPush1, PointGoal1, PointPush1  # noqa: E402

from benchmarks import worlds as bench  # noqa: E402
from experiments import worlds  # noqa: E402
from experiments.reference_traces import reference_start  # noqa: E402


def test_starts_of_the_reference_keep_our_rules():
    for kind in (PointGoal1, CarPush1):
        layout, _ = reference_start(kind, 7)
        places = np.concatenate(
            [
                layout.robot[:, :2],
                layout.goal,
                *layout.hazards,
                *layout.pillars,
                layout.movable[:, :2],
            ]
        )
        keepouts = kind.rules.keepouts
        assert len(places) == len(keepouts)
        first, second = np.triu_indices(len(keepouts), 1)
        gap = np.linalg.norm(places[first] - places[second], axis=1)
        assert (gap >= keepouts[first] + keepouts[second]).all()
        assert (np.abs(places).max(axis=1) <= 1.5 - keepouts).all()


def test_means_are_compared_and_missing_records_are_told(monkeypatch, tmp_path, run_experiment):
    monkeypatch.setattr(worlds, 'REFERENCE', worlds.REFERENCE[1:2])
    monkeypatch.setattr(PointGoal1, 'max_episode_steps', 150)
    (tmp_path / 'nothing').mkdir()
    code, out, err = run_experiment('worlds --episodes 12 --data nothing -o .')
    assert code == 0
    assert err.count('no reference traces') == 4
    result = json.loads((tmp_path / 'worlds.json').read_text())
    (row,) = result['means']
    assert row['driver'] == 'straightv'
    # A seventh of an episode brings some of its return, at nearly its speed.
    assert 0.5 < row['return'] < 6
    assert 0.5 < row['speed'] < 0.9
    assert row['return_standard_errors'] < -2
    assert (tmp_path / 'worlds.md').read_text() in out
    assert '| PointGoal1 | `straightv` |' in out


def test_the_benchmark_measures_every_task(monkeypatch):
    monkeypatch.setattr(bench, 'TASKS', ('PointPush1',))
    monkeypatch.setattr(bench, 'ROBOTS', 4)
    monkeypatch.setattr(PointPush1, 'max_episode_steps', 30)
    result = bench.run(0.01)
    assert set(result['metrics']) == {
        'PointPush1_env_steps_per_s',
        'PointPush1_env_steps_per_bare_step_ratio',
        'PointPush1_two_per_one_process_ratio',
        'PointPush1_reset_us',
    }
    assert set(result['peers']) == {'PointPush1_bare_mujoco_env_steps_per_s'}
    for value in (*result['metrics'].values(), *result['peers'].values()):
        assert value > 0
