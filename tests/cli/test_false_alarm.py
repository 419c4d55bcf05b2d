# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""``occ learn --false-alarm`` from end to end."""

import json

import numpy as np
import pytest
from occ_constraints_pkg.rules.constraints_file import load_constraints


@pytest.fixture
def tables(tmp_path, monkeypatch):
    """Go to a folder with tables: 20 episodes of free movement, and 9 that went to the limit."""
    monkeypatch.chdir(tmp_path)
    rng = np.random.default_rng(0)
    columns = ['episode', 'x', 'y']
    for name, count, values in (
        ('drives', 20, rng.normal(size=(200, 2))),
        ('far', 9, 4.0 + rng.random((90, 2))),
    ):
        table = np.column_stack([np.repeat(np.arange(count), 10), values])
        np.savetxt(f'{name}.csv', table, delimiter=',', header=','.join(columns), comments='')


def test_the_guarantee_is_printed_recorded_and_shown(tables, run_occ):
    code, text, _ = run_occ('learn drives.csv -o rules.yaml --false-alarm 0.1')
    assert code == 0
    guarantee = next(line for line in text.splitlines() if line.startswith('False alarms: '))
    assert 'probability at most 0.1 (bound 0.1 from 9 safe episodes' in guarantee
    assert guarantee in run_occ('show rules.yaml')[1]
    shown = json.loads(run_occ('show rules.yaml --json')[1])
    assert shown['calibration'] == load_constraints('rules.yaml').learner['calibration']
    assert shown['calibration']['episodes'] == 9
    told = json.loads(run_occ('learn drives.csv -o rules.yaml --false-alarm 0.1 --json')[1])
    assert told['calibration'] == shown['calibration']


def test_safe_episodes_from_elsewhere_move_the_bounds(tables, run_occ):
    code, text, _ = run_occ(
        'learn drives.csv -o rules.yaml --false-alarm 0.1 --calibrate-on far.csv'
    )
    assert code == 0
    assert '9 of the episodes raised one before and 0 after' in text
    assert run_occ('check far.csv -c rules.yaml')[0] == 0
    bags = load_constraints('rules.yaml').provenance['bags']
    assert [bag['name'] for bag in bags] == ['drives.csv', 'far.csv']


@pytest.mark.parametrize(
    ('options', 'sentence'),
    [
        ('--false-alarm 0.05', 'of the 20 episodes given 10 can be held out'),
        ('--false-alarm 1.5', 'false_alarm is 1.5; allowed is a number above 0 and below 1'),
        ('--calibrate-on far.csv', 'calibrate_on is given without false_alarm'),
    ],
)
def test_what_cannot_be_guaranteed_is_told_in_one_sentence(tables, run_occ, options, sentence):
    code, text, error = run_occ(f'learn drives.csv -o rules.yaml {options}')
    assert (code, text) == (2, '')
    assert sentence in error
    assert len(error.strip().splitlines()) == 1
