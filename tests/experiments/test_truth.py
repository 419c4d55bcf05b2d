# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The experiment on recovering the true cost, with drawn states in place of drives."""

import json

import numpy as np
import pytest
from occ_constraints_pkg.errors import OccError

pytest.importorskip('mujoco', reason='MuJoCo is not installed')
pytest.importorskip('matplotlib', reason='matplotlib is not installed')

from experiments import states, truth
from experiments.states import drive_states

RADIUS = 0.2
STEPS = 1001


def drawn_states(name, driver, feature_map, episodes, seed):
    """Free movement in the plane: within ``RADIUS`` of a hazard for 5 % of the time."""
    rng = np.random.default_rng(seed)
    distance = np.sqrt(rng.random((episodes, STEPS)) / 0.05) * RADIUS
    values = rng.uniform(-1.0, 1.0, (episodes, STEPS, len(feature_map.features)))
    values[..., 4:] = 0.0
    values[..., 4] = 1.0 - np.minimum(distance, 3.0) / 3.0
    return values.astype(np.float32), distance < RADIUS


@pytest.fixture(scope='module')
def results(tmp_path_factory):
    folder = tmp_path_factory.mktemp('truth')
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(truth, 'drive_states', drawn_states)
        # Each of these drives is costly for 5 % of the time.
        patch.setattr(truth, 'MOST_COSTLY', 0.06)
        return folder, truth.run_truth(folder, samples=10_000, draws=2, names=['PointGoal1'])


def test_free_movement_is_recovered(results):
    lines = results[1]['lines']
    assert list(lines) == [
        f'PointGoal1, {level}, {size}' for level in truth.LEVELS for size in (1000, 10_000)
    ]
    line = lines['PointGoal1, expert, 10000']
    assert line['heedless_driver'] == 'straightv'
    assert line['costly_share']['mean'] == pytest.approx(0.05, abs=0.005)
    # Beyond the edge nobody keeps a distance, so it is estimated from the other samples.
    assert line['flagged_share']['mean'] <= 0.056
    assert line['f1']['mean'] > 0.9
    # Every such drive is costly somewhere, so there is no safe one to be covered.
    assert line['coverage'] == {'mean': None, 'std': None}


def test_done_lines_are_kept_and_files_written(results, monkeypatch):
    folder, first = results
    monkeypatch.setattr(truth, 'drive_states', lambda *_: pytest.fail('drove again'))
    again = truth.run_truth(folder, samples=10_000, draws=2, names=['PointGoal1'])
    assert again['lines'] == first['lines']
    assert json.loads((folder / 'truth.json').read_text())['lines'] == first['lines']
    assert '| PointGoal1 | mixed | 10000 | ' in (folder / 'truth.md').read_text()
    assert (folder / 'truth.png').stat().st_size > 1000
    with pytest.raises(OccError, match='other settings'):
        truth.run_truth(folder, draws=3)


def test_costly_drives_are_mixed_in_until_there_are_enough(monkeypatch):
    def some_costly(name, driver, feature_map, episodes, seed):
        values, costly = drawn_states(name, driver, feature_map, episodes, seed)
        costly[:] = False
        if seed >= 20_000:
            costly[::2, : STEPS // 2] = True
        return values, costly

    monkeypatch.setattr(truth, 'drive_states', some_costly)
    drives = truth._Episodes('PointGoal1', 20_000, 2, 0)
    rng = np.random.default_rng(0)
    values, costly, episodes = drives._demonstrations(None, np.arange(19), rng)
    assert len(values) == len(costly) == 19 * STEPS
    assert np.unique(episodes, return_counts=True)[1].tolist() == [STEPS] * 19
    assert not costly.any()
    values, costly, episodes = drives._demonstrations(0.045, np.arange(19), rng)
    assert len(values) == 19 * STEPS
    assert 0.045 <= costly.mean() < 0.09


def test_the_costliest_drives_are_left_out():
    values = np.arange(4.0)[:, None, None] * np.ones((1, 100, 1))
    costly = np.zeros((4, 100), dtype=bool)
    costly[0, :3] = costly[2, :50] = costly[3, :1] = True
    kept, kept_costly = truth.without_costliest(values, costly)
    # 0, 1 and 3 % are 4/3 % in all; without the 3 % they are a half.
    assert kept[:, 0, 0].tolist() == [1.0, 3.0]
    assert kept_costly.sum() == 1
    with pytest.raises(OccError, match=r'best episode 3\.0% of the samples are costly'):
        truth.without_costliest(values[[0, 2]], costly[[0, 2]])


def test_the_blind_see_no_hazard_and_the_rest():
    names = ['velocimeter_x', 'hazards_lidar_0', 'goal_lidar_0', 'hazards_lidar_1']
    observation = np.arange(1.0, 9.0).reshape(2, 4)
    seen = states.blinded(lambda rows: rows, names)(observation)
    assert seen.tolist() == [[1.0, 0.0, 3.0, 0.0], [5.0, 0.0, 7.0, 0.0]]
    assert observation.all()


def test_states_are_those_of_whole_episodes(monkeypatch):
    from occ_constraints_pkg.features.feature_map import load_feature_map
    from occ_constraints_pkg.worlds.safety_gym import PointGoal1

    monkeypatch.setattr(PointGoal1, 'max_episode_steps', 5)
    values, costly = drive_states(
        'PointGoal1', lambda rows: np.zeros((len(rows), 2)), load_feature_map('PointGoal1'), 3, 0
    )
    assert values.shape == (3, 6, 20)
    assert costly.shape == (3, 6)
    nearest = values[..., 4:].max(axis=-1)
    np.testing.assert_array_equal(costly, nearest >= np.float32(1.0 - 0.2 / 3.0))


@pytest.mark.parametrize(
    ('options', 'sentence'),
    [
        ('--world Moon', "no world 'Moon' with a known truth"),
        ('--samples 10', 'samples is 10'),
        ('--draws 1', 'draws is 1'),
    ],
)
def test_bad_requests_are_told(run_experiment, options, sentence):
    code, _, err = run_experiment(f'truth {options}')
    assert (code, sentence in err) == (2, True)
