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
    for world in ('highway', 'highway_restricted'):
        code, _, err = occ(f'drive {world} --driver straight')
        assert code == 2
        assert f"world {world} has no driver 'straight'" in err
        assert 'allowed are random, expert and a policy file' in err


@pytest.mark.parametrize(
    ('line', 'sentence'),
    [
        ('drive highway --steps 5', '--steps is not for world highway; allowed is a whole'),
        ('drive simple_nav -c rules.yaml', '--constraints is not for world simple_nav'),
    ],
)
def test_an_option_without_effect_is_refused(occ, tmp_path, line, sentence):
    code, _, err = occ(f'{line} -o drive.png')
    assert code == 2
    assert sentence in err
    assert not (tmp_path / 'drive.png').exists()
