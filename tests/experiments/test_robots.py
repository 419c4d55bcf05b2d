# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
import json
import os
from pathlib import Path

import pytest
from occ_constraints_pkg.errors import OccError

from experiments.robots import run_robots


@pytest.fixture
def folder():
    default = Path(__file__).parents[3] / 'shared' / 'data'
    folder = Path(os.environ.get('OCC_TEST_DATA', default)) / 'robots'
    if not folder.is_dir():
        pytest.skip(f'no test data at {folder}; set OCC_TEST_DATA')
    return folder


def test_too_few_recordings(tmp_path):
    with pytest.raises(OccError, match=r'holds 0 recordings safe_tb3_\*; allowed are three'):
        run_robots(tmp_path / 'out', folder=tmp_path)


def test_safe_robots_are_hardly_flagged_and_contact_is(folder, tmp_path):
    result = run_robots(tmp_path, folder=folder, kinds=['tb3'])
    assert json.loads((tmp_path / 'robots.json').read_text()) == result
    part = result['kinds']['tb3']['all features']
    bags = {bag['bag']: bag for bag in part['held_back']}
    # One drives at 0.4 m/s, where none of the others is faster than 0.3.
    leaving = bags.pop('safe_tb3_patrikpordi')
    assert leaving['leaves']
    assert leaving['rules'][0]['rule'] == 'speed above 0.3 m/s'
    assert len(bags) == 5
    for bag in bags.values():
        assert bag['flagged'] <= 0.05, bag
    assert len(part['contact']) == 2
    for bag in part['contact']:
        assert bag['flagged'] > 0.5, bag
        assert bag['rules'][0]['rule'].startswith('any clearance ')


def test_each_bump_is_flagged(folder, tmp_path):
    result = run_robots(tmp_path, folder=folder, kinds=['neato'])
    bags = result['kinds']['neato']['all features']['bump']
    assert [len(bag['intervals']) for bag in bags] == [1, 1]
    for bag in bags:
        assert bag['intervals'][0]['flagged'] == 1.0
    assert (tmp_path / 'robots_neato.yaml').read_text().startswith('# Suggested from')
    assert '| bump_neato_zcoakley_fsm |' in (tmp_path / 'robots.md').read_text()
