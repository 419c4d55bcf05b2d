# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Recordings of a robot in a namespace: one feature map serves all robots, as it does live."""

import json

import pytest
from occ_constraints_pkg.features.feature_map import FeatureMap, load_feature_map
from occ_constraints_pkg.rules.constraints_file import load_constraints
from synthetic_bags import write_drive


@pytest.fixture
def bags(tmp_path, monkeypatch):
    """Go to a folder with the same drive recorded of `/r1/observation` and of `/observation`."""
    monkeypatch.chdir(tmp_path)
    for folder in ('of_r1', 'plain'):
        (tmp_path / folder).mkdir()
    write_drive(tmp_path / 'of_r1' / 'drive', robots=3, steps=40, topic='/r1/observation')
    write_drive(tmp_path / 'plain' / 'drive', robots=3, steps=40)


@pytest.mark.parametrize('namespace', ['r1', '/r1', '/r1/'])
def test_learn_and_check_find_the_relative_topics_of_a_robot(bags, run_occ, namespace):
    assert run_occ('learn plain/drive -m simple_nav -o plain.yaml')[0] == 0
    learned = run_occ(f'learn of_r1/drive -m simple_nav -o r1.yaml --namespace {namespace}')
    assert learned[0] == 0, learned[2]
    plain, other = load_constraints('plain.yaml'), load_constraints('r1.yaml')
    assert plain.rule_set.fingerprint == other.rule_set.fingerprint
    # The rules stay those of any robot.
    assert other.feature_map == plain.feature_map
    code, text, _ = run_occ(f'check of_r1/drive -c r1.yaml --namespace {namespace} --json')
    assert json.loads(text) == json.loads(run_occ('check plain/drive -c plain.yaml --json')[1])
    assert code in (0, 1)


def test_compare_depths_reads_it_too(bags, run_occ):
    code, _, error = run_occ(
        'learn of_r1/drive -m simple_nav --compare-depths --namespace r1 -o out'
    )
    assert code == 0, error


def test_without_the_option_the_topic_is_missing(bags, run_occ):
    for line in (
        'learn of_r1/drive -m simple_nav',
        'learn plain/drive -m simple_nav --namespace r1',
    ):
        code, _, error = run_occ(f'{line} -o rules.yaml')
        assert code == 2
        assert 'has no topic' in error


def test_only_relative_topics_of_a_map_move():
    document = load_feature_map('simple_nav').to_document()
    document['pace'] = document['features'][0]['topic'] = '/observation'
    document['features'][1] |= {'minus': {'topic': 'observation', 'column': 'x'}}
    moved = FeatureMap.from_document(document, 'map').in_namespace('r1/front')
    assert moved.pace == '/observation'
    assert [topic for item in moved.features for topic in (item.topic,)] == [
        '/observation',
        '/r1/front/observation',
    ]
    assert moved.features[1].minus.topic == '/r1/front/observation'
