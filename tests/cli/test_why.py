# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""``occ show --why``: from a bound back to the message that it was learned from."""

import json
from datetime import datetime

import numpy as np
import pytest
from occ_constraints_pkg.features.table import Table
from occ_constraints_pkg.rosbag.recording import Recording
from occ_constraints_pkg.rules.constraints_file import load_constraints
from synthetic_bags import write_drive


def why(occ, rule, file='constraints.yaml'):
    code, out, err = occ(f'show --why {rule} {file} --json')
    assert (code, err) == (0, '')
    return json.loads(out)


def test_each_named_sample_is_found_again_in_its_bag(occ, tmp_path):
    for seed, name in enumerate(('monday', 'tuesday')):
        write_drive(tmp_path / name, robots=12, steps=60, seed=seed)
    assert occ('learn monday tuesday -m simple_nav --alpha 0.5 --depth 5')[0] == 0
    rules = load_constraints('constraints.yaml').rule_set.rules
    tables = {
        (name, raw.log_time_ns): Table.from_message(recording.decode(raw))
        for name in ('monday', 'tuesday')
        for recording in [Recording(name)]
        for raw in recording.messages([recording.find('observation')])
    }
    seen = set()
    for rule in rules:
        document = why(occ, rule.id)
        assert document['formula'] == ' and '.join(item['text'] for item in document['literals'])
        for literal in document['literals']:
            feature = literal['text'].split()[0]
            for sample in literal['closest']:
                table = tables[sample['source'], sample['time_ns']]
                assert table.column(feature)[sample['row']] == sample['value']
                assert sample['topic'] == 'observation'
                instant = datetime.fromisoformat(sample['time']).timestamp()
                assert instant == pytest.approx(sample['time_s'], abs=1e-5)
                seen.add(sample['source'])
    assert seen == {'monday', 'tuesday'}


def test_tables_give_file_and_row(occ):
    rng = np.random.default_rng(0)
    rows = rng.random((2, 300, 2))
    for name, features in zip(('one.npz', 'two.npz'), rows, strict=True):
        np.savez(name, features=features, names=['x', 'y'], episode=np.arange(300) // 100)
    assert occ('learn one.npz two.npz --contamination 0')[0] == 0
    for rule in load_constraints('constraints.yaml').rule_set.rules:
        [literal] = why(occ, rule.id)['literals']
        assert literal['near'] >= 1
        for sample in literal['closest']:
            features = rows[['one.npz', 'two.npz'].index(sample['source'])]
            feature = 'xy'.index(literal['text'].split()[0])
            assert features[sample['row'], feature] == sample['value']
        text = occ(f'show --why {rule.id} constraints.yaml')[1]
        best = literal['closest'][0]
        assert f'{best["value"]!r} in {best["source"]}, row {best["row"]}' in text
        assert 'no training sample lies beyond its bounds' in text
        assert f'demonstrated range: {literal["near"]} (episodes: {literal["episodes"]})' in text


def test_what_was_not_learned_has_no_evidence(occ, tmp_path):
    np.savez('drives.npz', features=np.random.default_rng(0).random((300, 1)), names=['x'])
    assert occ('learn drives.npz')[0] == 0
    learned = load_constraints('constraints.yaml')
    below, above = learned.rule_set.rules
    text = learned.dumps()
    moved = text.replace(f'bound: {above.literals[0].bound!r}', 'bound: 0.75')
    own = '- id: mine\n  literals: [{feature: x, operator: <, bound: 0.1}]\n'
    (tmp_path / 'edited.yaml').write_text(moved.replace('rules:\n', f'rules:\n{own}', 1))
    assert why(occ, below.id, 'edited.yaml')['missing'] is None
    missing = why(occ, above.id, 'edited.yaml')['missing']
    assert missing.endswith(f'when it read x > {above.literals[0].bound!r}')
    assert 'not learned' in why(occ, 'mine', 'edited.yaml')['missing']
    code, out, _ = occ('show --why mine edited.yaml')
    assert (code, 'no evidence: the rule was not learned' in out) == (0, True)

    (tmp_path / 'older.yaml').write_text(text.partition('\nevidence:')[0] + '\n')
    assert 'the file holds none' in why(occ, above.id, 'older.yaml')['missing']

    code, out, err = occ('show --why nothing constraints.yaml')
    assert (code, out, err.count('\n')) == (2, '', 1)
    assert "no rule 'nothing'" in err


def test_rules_for_cars_are_told_in_terms_of_traffic(occ):
    rows = np.random.default_rng(0).uniform(10.0, 20.0, (300, 2))
    np.savez('cars.npz', features=rows, names=['v_x', 'p_rel4'], units=['m/s', 'm'])
    assert occ('learn cars.npz --contamination 0')[0] == 0
    code, out, err = occ('show --traffic constraints.yaml')
    assert (code, err) == (0, '')
    assert '| rule | formula, the lines joined by ∨ | in traffic |' in out
    assert 'the vehicle ahead closer than 10' in out
    rules = json.loads(occ('show --traffic --json constraints.yaml')[1])['rules']
    assert {rule['traffic'].split()[0] for rule in rules} == {'slower', 'faster', 'the'}
    code, _, err = occ('show --traffic --why R1 constraints.yaml')
    assert code == 2
    assert 'both --why and --traffic' in err
