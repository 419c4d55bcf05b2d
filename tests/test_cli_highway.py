# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
import json

import pytest

pytest.importorskip('matplotlib')


def test_a_drive_on_the_highway_is_drawn(occ, tmp_path):
    code, out, _ = occ('drive highway --driver random --seed 2999 -o drive.png --json')
    assert code == 0
    numbers = json.loads(out)
    assert 0 < numbers['steps'] <= 200
    assert numbers['cost'] in (0.0, 1.0)
    assert (tmp_path / 'drive.png').stat().st_size > 1000


def test_a_scenario_or_driver_that_is_not_there_is_refused(occ):
    code, _, err = occ('drive highway_restricted --driver random --seed 52')
    assert code == 2
    assert 'world highway_restricted has no scenario 52; allowed are 0 to 51' in err
    code, _, err = occ('drive highway_restricted --driver straight')
    assert code == 2
    assert "no scripted driver 'straight'" in err


def test_a_wrong_cost_limit_is_refused(occ):
    pytest.importorskip('torch')
    code, _, err = occ('experiment highway --cost-limit much')
    assert code == 2
    assert "got 'much'; allowed is a number or 'demonstrations'" in err
