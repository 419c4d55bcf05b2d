# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
import json

import numpy as np
import pytest
from click.testing import CliRunner
from occ_constraints_pkg.errors import ConfigurationError

from experiments.commands import cli
from experiments.planted import PROBLEMS, run_one, run_planted, table
from experiments.planted_methods import METHODS
from experiments.planted_problems import MADE_UP

NULLS = {'A6', 'N1', 'N2', 'N3'}


@pytest.mark.parametrize('name', PROBLEMS)
def test_a_problem_is_whole_and_its_seed_determines_it(name):
    problem, again = (PROBLEMS[name]('1e3', 7) for _ in range(2))
    features = len(problem.names)
    assert problem.values.shape == (len(problem.episodes), features)
    assert len(problem.values) >= 1_000
    assert problem.fresh.shape[1] == problem.states.shape[1] == features
    assert np.isfinite(problem.values).all()
    np.testing.assert_array_equal(problem.values, again.values)
    np.testing.assert_array_equal(problem.states, again.states)
    assert problem.is_null == (name in NULLS)
    if not problem.is_null:
        assert 0.02 < problem.violated.mean() < 0.9


@pytest.mark.parametrize('name', sorted(set(MADE_UP) - NULLS - {'A7'}))
def test_seeds_differ(name):
    assert not np.array_equal(PROBLEMS[name]('1e3', 1).values, PROBLEMS[name]('1e3', 2).values)


def test_planted_rules_are_found_and_nothing_is_found_in_a_null():
    found = run_one('B1', '1e4', 101, 'ours')
    assert found['f1'] > 0.95
    assert found['conditional'] == 4
    assert found['conditional_flagged'] < 0.001
    null = run_one('A6', '1e4', 101, 'ours')
    assert null['f1'] is None
    assert null['conditional'] == 0


@pytest.mark.parametrize('method', METHODS)
def test_every_method_runs(method):
    line = run_one('A3', '1e3', 101, method)
    assert 0 <= line['f1'] <= 1
    assert 0 <= line['flagged'] <= 1


def test_a_stopped_run_goes_on(tmp_path):
    chosen = {'problems': ['A3'], 'sizes': ['1e3'], 'methods': ['ours', 'box']}
    first = run_planted(tmp_path, seeds=[101], **chosen)['lines']
    file = tmp_path / 'planted.json'
    document = json.loads(file.read_text())
    document['lines']['A3, 1e3, 101, ours']['f1'] = 0.123
    file.write_text(json.dumps(document))
    calls = []
    both = run_planted(
        tmp_path, seeds=[101, 102], progress=lambda *call: calls.append(call), **chosen
    )['lines']
    assert calls == [(3, 4), (4, 4)]
    assert both['A3, 1e3, 101, ours']['f1'] == 0.123
    assert set(first) < set(both)
    assert '| A3 | 1e3 | box | 2 |' in (tmp_path / 'planted.md').read_text()


def test_a_null_has_no_score_in_the_table():
    line = run_one('A6', '1e3', 101, 'box')
    assert '| A6 | 1e3 | box | 1 | - | - | - | - |' in table({'one': line})


def test_names_that_are_not_known_are_told(tmp_path):
    with pytest.raises(ConfigurationError, match="there is no problem 'A99'; allowed are A1, A2"):
        run_planted(tmp_path, problems=['A99'])


def test_on_the_command_line(tmp_path):
    named = ['--problem', 'A3', '--size', '1e3', '--seed', '101', '--method', 'box', '-o']
    done = CliRunner().invoke(cli, ['planted', *named, str(tmp_path)])
    assert done.exit_code == 0, done.output
    assert '| A3 | 1e3 | box | 1 |' in done.output
