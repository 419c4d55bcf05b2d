# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
import json
import os
from pathlib import Path

import pytest
from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.rules.gating import GateSettings

from experiments.debouncing import run_debouncing

ROBOTS = Path(os.environ.get('OCC_TEST_DATA', '../shared/data')) / 'robots'


@pytest.mark.skipif(not ROBOTS.is_dir(), reason=f'no test data at {ROBOTS}; set OCC_TEST_DATA')
def test_the_default_stops_for_rare_violations_without_more_false_stops(tmp_path):
    result = run_debouncing(tmp_path, folder=ROBOTS)
    assert json.loads((tmp_path / 'debouncing.json').read_text()) == result
    settings, found = GateSettings(), result['candidates']
    default = found[f'{settings.trigger_count} of {settings.trigger_window}']
    assert default['false_stops'] <= found['2 of 3']['false_stops']
    assert default['seconds_to_stop'] < found['2 of 3']['seconds_to_stop']
    for pattern, limit in (('VSS', 4), ('VSSSSSSSSS', 11)):
        assert default[pattern]['stops_at'] == limit
        assert default[pattern]['share_stopped'] == 1.0


def test_recordings_that_are_not_there(tmp_path):
    with pytest.raises(OccError, match='holds 0 recordings'):
        run_debouncing(tmp_path, folder=tmp_path)
