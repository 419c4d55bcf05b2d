# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""``occ check`` on a made-up robot: text, JSON and picture tell of the same intervals."""

import json

import numpy as np
import pytest
from occ_constraints_pkg.cli import main
from occ_constraints_pkg.documents import parse_yaml
from occ_constraints_pkg.features.feature_map import FeatureMap
from occ_constraints_pkg.rules import Literal, Rule, RuleSet
from occ_constraints_pkg.rules.constraints_file import Constraints
from synthetic_bags import ROVER_MAP, write_rover


@pytest.fixture(scope='module')
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp('rover')
    write_rover(folder / 'long')
    write_rover(folder / 'short', seconds=4.0, seed=1)
    feature_map = FeatureMap.from_document(parse_yaml(ROVER_MAP, 'map'), 'map')
    space = feature_map.space
    rules = (
        Rule('Rfast', (Literal(space.index('v'), '>', 0.4),)),
        Rule('Rnear', (Literal(space.index('closest'), '<', 1.5), Literal(1, '>', 0.1))),
        Rule('Rnever', (Literal(space.index('v'), '<', -9.0),)),
    )
    rule_set = RuleSet(space, rules, np.tile([0.0, 2.0], (len(space), 1)))
    Constraints(rule_set, feature_map.to_document()).save(folder / 'rules.yaml')
    return folder


@pytest.fixture
def occ(folder, monkeypatch, capsys):
    monkeypatch.chdir(folder)

    def run(line):
        capsys.readouterr()
        return main(line.split()), capsys.readouterr().out

    return run


def test_json_tells_intervals_in_bag_time(occ):
    code, out = occ('check long -c rules.yaml --json')
    told = json.loads(out)
    assert code == 1
    assert (told['unit'], told['sources']) == ('s', ['long'])
    assert sum(told['shares_of_time'].values()) == pytest.approx(1.0)
    assert min(told['shares_of_time'].values()) > 0.0
    assert {item['rule'] for item in told['violations']} == {'Rfast', 'Rnear'}
    for item in told['violations']:
        assert 0.0 <= item['start'] <= item['worst']['time'] <= item['end'] <= 12.5
        assert item['duration'] == item['end'] - item['start']
        assert 0.0 < item['active'] <= item['duration'] + 1e-9
        assert item['first_stamp_ns'] <= item['worst']['stamp_ns'] <= item['last_stamp_ns']
        assert item['worst']['margin'] <= 0.0
    fast = next(item for item in told['violations'] if item['rule'] == 'Rfast')
    assert fast['worst']['values']['v'] > 0.4
    assert fast['worst']['margin'] == (0.4 - fast['worst']['values']['v']) / 2.0
    # Odometry pauses for a second and may be 0.4 s old; commands end after eight seconds.
    assert [item['features'] for item in told['unknown']][-1] == ['command', 'lag']
    assert any('v' in item['features'] for item in told['unknown'])


def test_text_tells_the_same(occ):
    told = json.loads(occ('check long -c rules.yaml --json')[1])
    code, out = occ('check long -c rules.yaml')
    assert code == 1
    assert f'{told["shares_of_time"]["SAFE"]:.2%} SAFE' in out
    for item in told['violations']:
        assert f'{item["start"]:.3f} to' in out
        assert item['text'] in out
        assert f'margin {item["worst"]["margin"]:.4g}' in out
    assert 'Rnever' not in out
    assert 'command unusable in' in out


def test_a_longer_bridge_and_a_shorter_timeout_change_what_counts(occ):
    counts = {
        bridge: len(
            json.loads(occ(f'check long -c rules.yaml --json --bridge {bridge}')[1])['violations']
        )
        for bridge in (0, 60)
    }
    assert counts[60] == 2 <= counts[0]
    told = json.loads(occ('check long -c rules.yaml --json --timeout 0.1')[1])
    assert told['silence'] > 0.4 * told['duration']
