# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
import json
from pathlib import Path

import pytest
from occ_constraints_pkg.errors import OccError

from experiments.warnings import run_warnings

BAGS = Path(__file__).parents[2] / 'bags'


def test_violations_of_a_simulated_drive_are_warned_of(tmp_path):
    result = run_warnings(tmp_path, bags=BAGS, names=['PointGoal1'])
    assert json.loads((tmp_path / 'warnings.json').read_text()) == result
    for entry in result['sets']['PointGoal1']['violating']:
        assert entry['warned'] == entry['onsets'] > 10
        assert entry['median_seconds'] > 1.0
        assert entry['false'] < entry['warnings']
    assert '| PointGoal1, safe |' in (tmp_path / 'warnings.md').read_text()


def test_recordings_that_are_not_there(tmp_path):
    with pytest.raises(OccError, match='holds 0 recordings'):
        run_warnings(tmp_path, folder=tmp_path, names=['tb3'])
