# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""``occ score``, and tables instead of bags in ``occ learn``, ``check`` and ``score``."""

import json

import numpy as np
import pytest
from occ_constraints_pkg.cli import main
from occ_constraints_pkg.rules.constraints_file import load_constraints
from synthetic_bags import write_drive

SETTINGS = '--clip density --alpha 0.5 --depth 2'


@pytest.fixture(scope='module')
def files(tmp_path_factory):
    """Return a folder with bags and rules of simple_nav, and tables of a unit square."""
    folder = tmp_path_factory.mktemp('files')
    write_drive(folder / 'careful')
    write_drive(folder / 'careless', driver='straight', robots=5, steps=60)
    line = f'learn {folder / "careful"} -m simple_nav {SETTINGS} -o {folder / "rules.yaml"}'
    assert main(line.split()) == 0
    rng = np.random.default_rng(0)
    np.savez(folder / 'demo.npz', features=rng.random((6, 200, 2)), names=['x', 'y'])
    np.savez(folder / 'bare.npz', features=rng.random((300, 2)))
    points = rng.uniform(-0.5, 1.5, (500, 2))
    costly = ((points < 0) | (points > 1)).any(axis=1)
    rows = np.column_stack([points[:, ::-1], costly, np.ones(500)])
    header = 'y,x,cost,battery'
    np.savetxt(folder / 'truth.csv', rows, '%.17g', delimiter=',', header=header, comments='')
    (folder / 'plain.csv').write_text('x,y\n0.5,0.5\n')
    (folder / 'narrow.csv').write_text('x\n0.5\n')
    (folder / 'bad.csv').write_text('x,y\n0.5,0.5\n0.5,o.5\n')
    (folder / 'calm.csv').write_text('x,y,cost\n0.5,0.5,0\n')
    return folder


@pytest.fixture
def occ(files, run_occ, monkeypatch):
    """Return a function that runs ``occ`` in that folder: exit code, stdout, stderr."""
    monkeypatch.chdir(files)
    return run_occ


def test_scoring_a_bag(occ):
    code, out, err = occ('score rules.yaml careless --json')
    assert (code, err) == (0, '')
    result = json.loads(out)
    assert result['samples'] == 300
    assert 0 < result['flagged_costly'] <= min(result['flagged'], result['costly'])
    assert result['precision'] == pytest.approx(result['flagged_costly'] / result['flagged'])
    assert result['recall'] == pytest.approx(result['flagged_costly'] / result['costly'])
    assert sum(rule['first'] for rule in result['rules']) == result['flagged']
    assert (result['unknown_share'], result['unscored']) == (0.0, 0)
    checked = json.loads(occ('check careless -c rules.yaml --json')[1])
    firsts = {rule['id']: rule['first'] for rule in result['rules'] if rule['first']}
    assert {item['id']: item['violated'] for item in checked['violated_rules']} == firsts

    code, out, _ = occ('score rules.yaml careless')
    assert code == 0
    for name in ('precision', 'recall', 'f1', 'iou'):
        assert f'{result[name]:.3f}' in out
    assert all(name in out for name in firsts)


def test_a_wanted_f1_decides_the_exit_code(occ):
    f1 = json.loads(occ('score rules.yaml careless --json')[1])['f1']
    assert occ(f'score rules.yaml careless --min-f1 {f1}')[0] == 0
    assert occ(f'score rules.yaml careless --min-f1 {f1 + 0.01}')[0] == 1


def test_from_a_table_to_a_score(occ, files):
    code, out, err = occ('learn demo.npz -o square.yaml --json')
    assert (code, err) == (0, '')
    assert json.loads(out)['held_out_episodes'] == 1
    learned = load_constraints(files / 'square.yaml')
    assert learned.feature_map is None
    assert learned.rule_set.space.names == ('x', 'y')
    source = learned.provenance['bags'][0]
    assert (source['name'], source['rows'], len(source['sha256'])) == ('demo.npz', 1200, 64)

    code, out, _ = occ('score square.yaml truth.csv --min-f1 0.95 --json')
    result = json.loads(out)
    assert (code, result['samples'], len(result['rules'])) == (0, 500, 4)
    assert result['recall'] == 1.0
    code, out, _ = occ('check truth.csv plain.csv -c square.yaml --json')
    assert (code, json.loads(out)['samples']) == (1, 501)
    assert occ('check plain.csv -c square.yaml')[0] == 0
    code, out, _ = occ('score square.yaml truth.csv plain.csv')
    assert code == 0
    assert 'not scored: 1 samples' in out


def test_names_are_made_up_where_there_are_none(occ, files):
    assert occ('learn bare.npz -o bare.yaml')[0] == 0
    assert load_constraints(files / 'bare.yaml').rule_set.space.names == ('x0', 'x1')
    assert occ('check bare.npz -c bare.yaml')[0] in (0, 1)


def test_rules_of_recordings_judge_tables(occ):
    code, out, _ = occ('check plain.csv -c rules.yaml --json')
    assert code in (0, 1)
    assert json.loads(out)['shares']['UNKNOWN'] == 0.0


def test_without_flagged_and_costly_samples_ratios_are_undefined(occ):
    assert occ('learn demo.npz -o square.yaml')[0] == 0
    code, out, _ = occ('score square.yaml calm.csv --json')
    assert (code, json.loads(out)['f1']) == (0, None)
    code, out, _ = occ('score square.yaml calm.csv --min-f1 0.1')
    assert code == 1
    assert 'precision undefined' in out


MISTAKES = {
    'learn careful': 'needs a feature map',
    'learn demo.npz careful -m simple_nav': 'the table demo.npz and the recording careful',
    'learn nowhere.npz': 'cannot read nowhere.npz',
    'learn bad.csv': "bad.csv, line 3, column 'y': got 'o.5'",
    'learn narrow.csv -m simple_nav': "narrow.csv has no column 'y'; its columns are x",
    'check narrow.csv -c rules.yaml': "narrow.csv has no column 'y'; its columns are x",
    'check plain.csv careful -c rules.yaml': 'the table plain.csv and the recording careful',
    'score rules.yaml plain.csv': 'plain.csv: no true cost to score on; needed is',
    'score rules.yaml careless --min-f1 2': '2',
    'score nowhere.yaml careless': 'cannot read nowhere.yaml',
}


@pytest.mark.parametrize('line', MISTAKES)
def test_a_mistake_is_told(occ, files, line):
    before = {path: path.stat().st_mtime_ns for path in files.rglob('*')}
    code, out, err = occ(line)
    assert (code, out) == (2, '')
    assert MISTAKES[line] in err
    assert 'Traceback' not in err
    assert {path: path.stat().st_mtime_ns for path in files.rglob('*')} == before
