# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""``occ diff``: two constraints files, as text, as JSON and as an exit code."""

import json

import numpy as np
from occ_constraints_pkg.rules import Verdict
from occ_constraints_pkg.rules.constraints_file import load_constraints

TEXT = """\
schema_version: 2
features:
- {name: clearance, unit: m, bounds: [0, null], demonstrated: [0.3, 3.3]}
- {name: speed, unit: m/s, demonstrated: [0.0, 2.0]}
rules:
- id: keep_clear
  literals: [{feature: clearance, operator: <, bound: 0.3}]
- id: slow_near_walls
  literals:
  - {feature: clearance, operator: <, bound: 0.8}
  - {feature: speed, operator: '>', bound: 1.0}
"""


def write(folder, name, text=TEXT):
    (folder / name).write_text(text)
    return load_constraints(folder / name).rule_set


def test_a_file_that_was_simplified_and_rewritten_is_the_same(occ, tmp_path):
    write(tmp_path, 'a.yaml', TEXT.replace('bound: 0.3', 'bound: 0.9', 1))
    assert occ('simplify a.yaml -o b.yaml')[0] == 0
    code, out, err = occ('diff a.yaml b.yaml')
    assert (code, err) == (0, '')
    assert out.startswith('same verdicts for every input within bounds\n')
    code, out, _ = occ('diff a.yaml b.yaml --json')
    assert (code, json.loads(out)['same']) == (0, True)


def test_a_moved_bound(occ, tmp_path):
    first = write(tmp_path, 'a.yaml')
    second = write(tmp_path, 'b.yaml', TEXT.replace('bound: 0.8', 'bound: 0.7'))
    code, out, err = occ('diff a.yaml b.yaml')
    assert (code, err) == (1, '')
    assert out == (
        'different verdicts:\n'
        '  slow_near_walls only A flags clearance from 0.7 to 0.8 m and speed above 1 m/s\n'
        '            such as clearance = 0.75, speed = 1.5: VIOLATED by A, SAFE by B\n'
        '\n'
        'rules from A to B:\n'
        '  slow_near_walls clearance < 0.8 -> 0.7 m (-0.1 m, -3.33% of the demonstrated range), '
        'flags less\n'
    )
    code, out, _ = occ('diff a.yaml b.yaml --json')
    document = json.loads(out)
    assert (code, document['same'], document['verdicts']) == (1, False, 'different')
    ((item,), others) = document['only_a'], document['only_b']
    assert others == []
    point = np.array([[item['point'][name] for name in first.space.names]])
    assert first.verdicts(point) == Verdict.VIOLATED
    assert second.verdicts(point) == Verdict.SAFE
    assert document['rules'][0]['kind'] == 'moved'


def test_names_of_files_cannot_forge_lines(occ, tmp_path):
    write(tmp_path, 'a.yaml')
    write(tmp_path, 'b.yaml', TEXT + '  note: "one\\ntwo \\e[2J"\n')
    code, out, _ = occ('diff a.yaml b.yaml')
    assert code == 0
    assert '\x1b' not in out
    assert len(out.splitlines()) == 4


def test_mistakes_are_told_in_one_sentence(occ, tmp_path):
    write(tmp_path, 'a.yaml')
    (tmp_path / 'b.yaml').write_text('rules: 3\n')
    for line in ('diff a.yaml', 'diff a.yaml none.yaml', 'diff a.yaml b.yaml'):
        code, out, err = occ(line)
        assert (code, out) == (2, '')
        assert err.startswith('error: ')
        assert len(err.splitlines()) == 1
