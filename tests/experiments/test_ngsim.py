# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
import json
import os
from pathlib import Path

import pytest
from occ_constraints_pkg.errors import OccError

from experiments import ngsim
from experiments.ngsim import run_ngsim


@pytest.fixture
def folder():
    default = Path(__file__).parents[3] / 'shared' / 'data'
    folder = Path(os.environ.get('OCC_TEST_DATA', default)) / 'driving'
    if not folder.is_dir():
        pytest.skip(f'no test data at {folder}; set OCC_TEST_DATA')
    return folder


def test_recordings_are_needed(tmp_path):
    with pytest.raises(OccError, match=r'there is no \S+/ngsim_us101/\*.xml; allowed are one'):
        run_ngsim(tmp_path / 'out', folder=tmp_path)
    assert not (tmp_path / 'out').exists()


def test_drivers_held_back_are_hardly_flagged(folder, tmp_path, monkeypatch):
    # Splitting trees take most of the time, and nothing is claimed of them.
    monkeypatch.setattr(ngsim, 'ALPHAS', (0.0,))
    steps = []
    result = run_ngsim(tmp_path, folder=folder, seeds=3, progress=lambda *pair: steps.append(pair))
    assert json.loads((tmp_path / 'ngsim.json').read_text()) == result
    # Of US-101 three splits, eight recordings and all; of I-80, which is one, three and all.
    assert steps[-1] == (16, 16)
    us101, i80 = result['highways']['US-101'], result['highways']['I-80']
    assert (us101['vehicles'], us101['repeated_vehicles'], us101['rows']) == (196, 2, 11146)
    assert us101['splits']['alpha 0']['largest'] <= ngsim.TOLERATED
    assert (i80['vehicles'], i80['repeated_vehicles']) == (200, 0)
    assert i80['splits']['alpha 0']['mean'] <= ngsim.TOLERATED
    said = [row['traffic'] for row in us101['rules']]
    assert any(text.startswith('faster than') for text in said)
    assert any('road edge' in text for text in said)
    text = (tmp_path / 'ngsim.md').read_text()
    assert '196 vehicles, 11146 rows of 0.1 s, feature map `highway`; 2 vehicles' in text
    assert '| alpha 0 |' in text
