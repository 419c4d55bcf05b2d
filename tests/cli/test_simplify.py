# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""``occ simplify``, and what ``occ learn`` says of the rules before and after."""

import json

import numpy as np
from occ_constraints_pkg.rules.constraints_file import load_constraints
from synthetic_bags import write_drive

TEXT = """\
schema_version: 1
features:
- {name: clearance, unit: m, bounds: [0, null], demonstrated: [0.3, 3.5]}
- {name: speed, unit: m/s, demonstrated: [0.0, 2.0]}
rules:
- id: slow_near_walls
  literals:
  - {feature: clearance, operator: <, bound: 0.5}
  - {feature: clearance, operator: '>=', bound: 0}
  - {feature: speed, operator: '>', bound: 1.0}
- id: slow_farther_out
  literals:
  - {feature: clearance, operator: '>=', bound: 0.5}
  - {feature: clearance, operator: <, bound: 0.8}
  - {feature: speed, operator: '>', bound: 1.0}
- id: agreed
  literals: [{feature: speed, operator: '>', bound: 1.8}]
  note: with the works council
- id: older
  literals: [{feature: speed, operator: '>', bound: 1.9}]
  enabled: false
  evaluated: 7
- id: crawl
  literals:
  - {feature: speed, operator: '>', bound: 2.0}
  - {feature: clearance, operator: <, bound: 0.1}
"""


def test_a_hand_written_file_is_simplified(occ, tmp_path):
    (tmp_path / 'mine.yaml').write_text(TEXT)
    code, out, err = occ('simplify mine.yaml -o short.yaml --json')
    assert (code, err) == (0, '')
    assert json.loads(out) == {
        'output': 'short.yaml',
        'rules_before': 4,
        'literals_before': 9,
        'rules': 2,
        'literals': 3,
        'changed': {'slow_near_walls': ['slow_near_walls', 'slow_farther_out']},
        'removed': ['crawl'],
        'kept': ['agreed'],
    }
    old, new = (load_constraints(tmp_path / name).rule_set for name in ('mine.yaml', 'short.yaml'))
    assert [rule.id for rule in new.rules] == ['agreed', 'older', 'slow_near_walls']
    assert new.rules[:2] == old.rules[2:4]
    assert new.rules[2].words(new.space) == 'clearance below 0.8 m and speed above 1 m/s'
    points = np.random.default_rng(0).uniform([0.0, 0.0], [1.0, 2.5], (500, 2)).round(1)
    np.testing.assert_array_equal(new.judge(points).verdict, old.judge(points).verdict)

    code, out, _ = occ('simplify mine.yaml')
    assert code == 0
    assert 'slow_near_walls stands for slow_near_walls, slow_farther_out' in out
    assert '4 rules with 9 literals before, 2 with 3 after; written to mine.yaml' in out
    assert (tmp_path / 'mine.yaml').read_text() == (tmp_path / 'short.yaml').read_text()


def test_learning_tells_both_sizes_and_a_simplified_file_is_not_edited(occ, tmp_path):
    write_drive(tmp_path / 'careful')
    line = 'learn careful -m simple_nav --alpha 0.5 --depth 5'
    code, out, err = occ(f'{line} --json')
    numbers = json.loads(out)
    assert (code, err) == (0, '')
    learned = load_constraints('constraints.yaml')
    assert numbers['rules'] == len(learned.rule_set.rules) <= numbers['extracted_rules']
    assert numbers['literals'] < numbers['extracted_literals']
    _, out, _ = occ(line)
    assert (
        f'Simplified from {numbers["extracted_rules"]} rules with '
        f'{numbers["extracted_literals"]} literals to {numbers["rules"]} with '
        f'{numbers["literals"]}'
    ) in out

    assert occ(f'{line} --full-conditions -o full.yaml')[0] == 0
    full = load_constraints('full.yaml')
    assert len(full.rule_set.rules) == numbers['extracted_rules']
    code, out, _ = occ('simplify full.yaml --json')
    assert (code, json.loads(out)['rules']) == (0, numbers['rules'])
    short = load_constraints('full.yaml')
    assert not short.is_edited
    assert short.rule_set.fingerprint != full.rule_set.fingerprint
    points = np.random.default_rng(0).random((2000, 2))
    np.testing.assert_array_equal(
        short.rule_set.judge(points).verdict, learned.rule_set.judge(points).verdict
    )


def test_counted_rules_are_simplified_on_request(occ, tmp_path):
    (tmp_path / 'mine.yaml').write_text(TEXT.replace('- id: crawl', '- id: crawl\n  evaluated: 5'))
    assert json.loads(occ('simplify mine.yaml -o a.yaml --json')[1])['kept'] == ['agreed', 'crawl']
    result = json.loads(occ('simplify mine.yaml -o a.yaml --counted --json')[1])
    assert (result['kept'], result['removed']) == (['agreed'], ['crawl'])


def test_mistakes_are_told_in_one_sentence(occ):
    code, out, err = occ('simplify nowhere.yaml')
    assert (code, out, err.count('\n')) == (2, '', 1)
    assert 'cannot read nowhere.yaml' in err
