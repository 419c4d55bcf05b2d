# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""``occ import``, and what the other commands make of its bags."""

import json
import os

import pytest
from synthetic_traffic import Car, commonroad_text, highd_texts, write_highd, write_ngsim

# A column of cars on each carriageway, long enough to learn from.
TRAFFIC = [
    Car(number, 1 + number % 2, -30.0 * number, 2.0 + number % 3, 25.0 + number, frames=(1, 30))
    for number in range(1, 9)
]


@pytest.fixture
def occ(tmp_path, run_occ, monkeypatch):
    """Return a function that runs ``occ`` in a folder with recordings of each kind."""
    monkeypatch.chdir(tmp_path)
    write_highd(tmp_path, highd_texts(TRAFFIC))
    write_ngsim(tmp_path / 'made.shf')
    (tmp_path / 'made.xml').write_text(commonroad_text())
    return run_occ


@pytest.mark.parametrize(
    ('name', 'source', 'drives', 'rows'),
    [
        ('highd', '01_tracks.csv', 8, 240),
        ('ngsim-sqlite', 'made.shf', 4, 240),
        ('commonroad', 'made.xml', 3, 15),
    ],
)
def test_from_a_recording_to_rules(occ, name, source, drives, rows):
    code, out, err = occ(f'import {name} {source} -o bag')
    assert (code, err) == (0, '')
    assert out.startswith(f'bag: {drives} drives, {rows} rows, ')
    assert 'Learn from it with: occ learn bag -m highway' in out
    code, out, _ = occ('learn bag -m highway --contamination 0.01 -o rules.yaml')
    assert code == 0
    assert 'd_left' in out
    code, out, _ = occ('check bag -c rules.yaml')
    assert code in (0, 1)
    assert f'{rows} samples' in out
    assert '0.00% UNKNOWN' in out
    code, out, _ = occ('show rules.yaml')
    assert code == 0
    _, out, _ = occ('features check bag highway')
    assert '100.0% can be judged' in out


def test_json(occ):
    code, out, _ = occ('import commonroad made.xml -o bag --json')
    assert code == 0
    found = json.loads(out)
    assert found['drives'] == 3
    assert found['rows'] == 15
    assert found['seconds'] == pytest.approx(1.2)
    assert found['feature_map'] == 'highway'
    assert found['warnings'] == []


def test_vehicles_at_one_place(occ, tmp_path):
    write_ngsim(tmp_path / 'shifted.shf', 'UPDATE Trajectory SET position_x = position_x - 30 '
                'WHERE vehicle_id = 2')  # fmt: skip
    code, out, err = occ('import ngsim-sqlite shifted.shf -o bag')
    assert code == 0
    assert err.startswith('warning: shifted.shf: in 50% of the rows')
    assert 'occ learn bag -m highway_road' in out
    code, _, _ = occ('learn bag -m highway_road -o rules.yaml')
    assert code == 0
    code, out, _ = occ('import ngsim-sqlite shifted.shf -o kept --keep-gaps')
    assert code == 0
    assert 'occ learn kept -m highway\n' in out


@pytest.mark.parametrize(
    ('line', 'sentence'),
    [
        ('import highd made.xml -o bag', 'made.xml is no file of tracks'),
        ('import commonroad 01_tracks.csv -o bag', '01_tracks.csv, line 1: it is not valid XML'),
        ('import ngsim-sqlite made.xml -o bag', 'made.xml is no SQLite database'),
        ('import comma2k19 made.xml -o bag', 'made.xml is no directory'),
        ('import commonroad nothing.xml -o bag', 'cannot read nothing.xml: No such file'),
        ('import commonroad made.xml -o there', 'there exists already'),
        ('import highd 01_tracks.csv -o bag --keep', 'No such option'),
        ('import gpx made.xml -o bag', "'gpx' is not one of"),
        ('import commonroad made.xml', "Missing option '-o'"),
    ],
)  # fmt: skip
def test_mistakes(occ, tmp_path, line, sentence):
    (tmp_path / 'there').mkdir()
    before = sorted(os.listdir(tmp_path))
    code, out, err = occ(line)
    assert (code, out) == (2, '')
    assert err.startswith('error: ')
    assert sentence in err
    assert err.count('\n') == 1
    assert sorted(os.listdir(tmp_path)) == before


@pytest.mark.parametrize('option', ['--warn', '--warning-window', '--timeout', '--bridge'])
@pytest.mark.parametrize('number', ['nan', 'inf'])
def test_times_that_are_none_are_refused(occ, option, number):
    code, out, err = occ(f'check bag -c rules.yaml {option} {number}')
    assert (code, out) == (2, '')
    assert f"got '{number}'; allowed is a finite number" in err
