# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""``occ compare``: two sets of recordings or two rule files, as text, as JSON and as exit code."""

import json
import shutil

import numpy as np
import pytest
from synthetic_bags import ROVER_MAP, write_rover

RULES = """\
schema_version: 2
features:
- {name: v, unit: m/s, demonstrated: [0.0, 0.5]}
- {name: closest, unit: m, demonstrated: [0.5, 3.0]}
feature_map:
  schema_version: 1
  pace: /scan
  max_age: 0.4
  features:
  - {name: v, topic: /odom, field: twist.twist.linear.x, unit: m/s}
  - {name: closest, topic: /scan, field: 'ranges[:]', unit: m, reduce: min, missing: max_range}
rules:
- id: fast
  literals: [{feature: v, operator: '>', bound: 0.45}]
- id: near
  literals: [{feature: closest, operator: <, bound: 0.9}]
"""


@pytest.fixture(scope='module')
def folder(tmp_path_factory):
    """Return a folder with recordings before and after, and rule files."""
    folder = tmp_path_factory.mktemp('compare')
    for name in ('before', 'after'):
        (folder / name).mkdir()
        write_rover(folder / name / 'drive_2', seconds=8.0)
    write_rover(folder / 'before' / 'drive_10', seconds=12.0, seed=1)
    write_rover(folder / 'after' / 'drive_10', seconds=12.0, seed=1, ahead=3.0)
    shutil.copytree(folder / 'before', folder / 'less')
    shutil.rmtree(folder / 'less' / 'drive_10')
    (folder / 'rules.yaml').write_text(RULES)
    (folder / 'lower.yaml').write_text(
        RULES.replace('bound: 0.45', 'bound: 0.3').replace('id: fast', 'id: too_fast')
    )
    (folder / 'nothing.yaml').write_text(
        RULES.replace('- id: fast', '- id: fast\n  enabled: false').replace(
            '- id: near', '- id: near\n  enabled: false'
        )
    )
    (folder / 'map.yaml').write_text(ROVER_MAP)
    (folder / 'empty').mkdir()
    (folder / 'list.yaml').write_text(
        'schema_version: 1\nrecordings:\n- {path: before/drive_2}\n- {path: before/drive_10}\n'
    )
    np.savez(folder / 'table.npz', features=np.ones((5, 2)), names=['v', 'closest'])
    return folder


@pytest.fixture
def occ(folder, run_occ, monkeypatch):
    monkeypatch.chdir(folder)
    return run_occ


def test_the_same_recordings_are_not_worse(occ):
    code, out, err = occ('compare -c rules.yaml before before')
    assert (code, err) == (0, '')
    assert out.startswith('not worse: before against before; violations: ')
    assert ' same\n2 recordings without a change\n' in out


def test_a_manifest_is_a_side_and_natural_order_is_kept(occ):
    code, out, _ = occ('compare -c rules.yaml list.yaml before --json')
    document = json.loads(out)
    assert (code, document['worse']) == (0, False)
    assert [item['name'] for item in document['recordings']] == ['drive_2', 'drive_10']


def test_a_log_clock_that_is_ahead_changes_nothing(occ):
    code, out, _ = occ('compare -c rules.yaml before after')
    assert code == 0, out


def test_a_missing_recording_is_a_finding_on_either_side(occ):
    for sides in ('before less', 'less before'):
        code, out, _ = occ(f'compare -c rules.yaml {sides}')
        assert code == 1
        assert 'drive_10: worse\n  missing    there is no such recording in less' in out


def test_two_rule_files_are_matched_by_meaning(occ):
    code, out, err = occ('compare rules.yaml lower.yaml before --json')
    assert (code, err) == (1, '')
    document = json.loads(out)
    assert document['counts']['longer'] > 0
    changes = [change for item in document['recordings'] for change in item['changes']]
    longer = next(change for change in changes if change['kind'] == 'longer')
    assert longer['same_rule']
    assert {entry['rule'] for entry in longer['before']} == {'fast'}
    assert {entry['rule'] for entry in longer['after']} == {'too_fast'}
    # The other way round, less is flagged.
    assert occ('compare lower.yaml rules.yaml before')[0] == 0


def test_rules_that_cannot_judge_are_worse(occ):
    code, out, err = occ('compare rules.yaml nothing.yaml before')
    assert code == 1
    assert 'enables no rule' in err
    assert 'UNKNOWN' in out


def test_text_tells_where_and_by_how_much(occ):
    _, out, _ = occ('compare rules.yaml lower.yaml before/drive_2')
    assert 'drive_2: worse\n' in out
    assert 'too_fast v above 0.3 m/s: ' in out
    assert 'worst at ' in out


def test_tables(occ):
    assert occ('compare -c rules.yaml table.npz table.npz')[0] == 0


MISTAKES = {
    'compare before after': 'allowed are -c CONSTRAINTS with two recordings',
    'compare before after more': 'without -c, the first two arguments are constraints files',
    'compare rules.yaml before after': 'without -c, the first two arguments are constraints files',
    'compare -c rules.yaml before': "Missing argument 'B'",
    'compare -c rules.yaml before after more': 'got -c and 3 recordings',
    'compare -c nowhere.yaml before after': 'cannot read nowhere.yaml',
    'compare -c map.yaml before after': 'map.yaml',
    'compare -c rules.yaml nowhere after': 'there is no recording at nowhere',
    'compare -c rules.yaml before nowhere': 'there is no recording at nowhere',
    'compare -c rules.yaml before empty': 'empty is no recording, and holds neither',
    'compare -c rules.yaml before rules.yaml': 'rules.yaml is not a recording, nor a manifest',
    'compare -c rules.yaml before table.npz': 'recordings and tables',
    'compare rules.yaml lower.yaml nowhere': 'there is no recording at nowhere',
    'compare rules.yaml lower.yaml before --by-order': '--by-order has no effect without -c',
    'compare rules.yaml table.npz before': 'table.npz',
    'compare -c rules.yaml before after --tolerance -1': '--tolerance',
    'compare -c rules.yaml before after --tolerance nan': 'allowed is a finite number',
}


@pytest.mark.parametrize('line', MISTAKES)
def test_mistakes_are_told_in_one_sentence(occ, line):
    code, out, err = occ(line)
    assert (code, out) == (2, '')
    assert err.startswith('error: ')
    assert MISTAKES[line] in err
    assert len(err.splitlines()) == 1
