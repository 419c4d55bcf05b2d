# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The experiment on costly demonstrations, with drawn states in place of drives."""

import json

import numpy as np
import pytest
from occ_constraints_pkg.errors import ConfigurationError

pytest.importorskip('mujoco', reason='MuJoCo is not installed')
pytest.importorskip('matplotlib', reason='matplotlib is not installed')

from experiments import contamination

RADIUS, STEPS = 0.2, 301


def drawn_states(name, driver, feature_map, episodes, seed):
    """Free movement in the plane, but that the expert keeps a distance."""
    rng = np.random.default_rng(seed)
    distance = np.sqrt(rng.random((episodes, STEPS)) / 0.05) * RADIUS
    if seed == 51_000:
        distance = np.where(distance < RADIUS, RADIUS * 1.3, distance)
    values = rng.uniform(-1.0, 1.0, (episodes, STEPS, len(feature_map.features)))
    values[..., 4:] = 0.0
    values[..., 4] = 1.0 - np.minimum(distance, 3.0) / 3.0
    return values.astype(np.float32), distance < RADIUS


@pytest.fixture(scope='module')
def results(tmp_path_factory):
    folder = tmp_path_factory.mktemp('contamination')
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(contamination, 'drive_states', drawn_states)
        return folder, contamination.run_contamination(folder, names=['PointGoal1'], seeds=[1])


def test_demonstrations_get_as_costly_as_they_are_to_be(results):
    lines = results[1]['lines']
    assert list(lines) == [
        'PointGoal1, samples, 0.0, 1',
        *(
            f'PointGoal1, {kind}, {share}, 1'
            for kind in contamination.KINDS
            for share in contamination.SHARES[1:]
        ),
    ]
    for line in lines.values():
        if line['kind'] in ('samples', 'stretches'):
            assert line['costly'] == pytest.approx(line['share'], abs=0.001)
        # No share stated: the edge is found however many samples are costly.
        assert line['stated']['none']['f1'] > 0.9
    stated = lines['PointGoal1, episodes, 0.05, 1']['stated']
    assert stated['0.2']['recall'] < stated['0.5']['recall'] < stated['none']['recall']


def test_done_lines_are_kept_and_files_written(results, monkeypatch):
    folder, first = results
    monkeypatch.setattr(contamination, 'drive_states', lambda *_: pytest.fail('drove again'))
    again = contamination.run_contamination(folder, names=['PointGoal1'], seeds=[1])
    assert again['lines'] == first['lines']
    assert json.loads((folder / 'contamination.json').read_text())['lines'] == first['lines']
    page = (folder / 'contamination.md').read_text().splitlines()
    assert len(page) == 2 + len(first['lines'])


def test_passes_are_the_runs_of_costly_states():
    costly = np.array([[0, 1, 1, 0, 1], [1, 0, 0, 0, 0]], dtype=bool)
    assert contamination._passes(costly) == [(0, 1, 3), (0, 4, 5), (1, 0, 1)]


def test_an_unknown_world_is_refused(tmp_path):
    with pytest.raises(ConfigurationError, match='allowed are PointGoal1, CarGoal1'):
        contamination.run_contamination(tmp_path, names=['highway'])
