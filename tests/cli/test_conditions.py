# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Conditional rules, the default of ``occ learn``, from end to end."""

import json
from importlib import resources
from pathlib import Path

import numpy as np
import pytest
from occ_constraints_pkg.rules.constraints_file import load_constraints

import occ_constraints_pkg as occ_program

BAG = Path(__file__).parents[2] / 'bags' / 'simple_nav_expert'
MAP = resources.files('occ_constraints_pkg.features').joinpath('maps/simple_nav.yaml')


@pytest.fixture
def tables(tmp_path, monkeypatch):
    """Go to a folder with tables of 40 and of 5 drives: fast or near, never both."""
    monkeypatch.chdir(tmp_path)
    rng = np.random.default_rng(0)
    for name, count in (('drives', 40), ('few', 5)):
        speed, gap = (np.repeat(rng.random(count * 25), 4) for _ in range(2))
        speed[(gap < 0.5) & (speed > 0.5)] -= 0.5
        table = np.column_stack([np.repeat(np.arange(count), 100), speed, gap])
        header = 'episode,speed,gap'
        np.savetxt(f'{name}.csv', table, delimiter=',', header=header, comments='')


def conditional(constraints):
    return [rule for rule in constraints.rules if len(rule.literals) > 1]


def test_a_rule_on_two_features_is_found_shown_and_judged(tables, run_occ):
    code, text, _ = run_occ('learn drives.csv -o rules.yaml')
    assert code == 0
    (rule,) = conditional(load_constraints('rules.yaml'))
    assert rule.words(load_constraints('rules.yaml').space) in text
    assert {literal.feature for literal in rule.literals} == {0, 1}
    shown = json.loads(run_occ(f'show rules.yaml --why {rule.id} --json')[1])
    assert shown['expected'] > 0.1
    assert shown['seen'] < 0.01
    assert shown['evidence'] > 10
    told = run_occ(f'show rules.yaml --why {rule.id}')[1]
    assert (
        f'expected {shown["expected"]:.1%} of the time, seen {shown["seen"]:.2%}, '
        f'evidence {shown["evidence"]:.0f}\n'
    ) in told
    single = next(item for item in load_constraints('rules.yaml').rules if item != rule)
    assert 'expected' not in run_occ(f'show rules.yaml --why {single.id}')[1]
    Path('near.csv').write_text('speed,gap\n0.9,0.1\n0.9,0.9\n0.1,0.1\n')
    assert run_occ('check near.csv -c rules.yaml')[0] == 1
    assert f'1 x  {rule.id}' in run_occ('check near.csv -c rules.yaml')[1]


@pytest.mark.parametrize('options', ['--conditions none', '--faithful', '--alpha 0.5'])
def test_there_is_none_with_the_options_of_the_article(tables, run_occ, options):
    assert run_occ(f'learn drives.csv -o rules.yaml {options}')[0] == 0
    constraints = load_constraints('rules.yaml')
    assert 'conditional' not in constraints.learner
    assert constraints.safe_set == {}
    assert not any('expected' in item for item in constraints.evidence['rules'])


def test_what_is_kept_apart_is_not_combined(tables, run_occ):
    assert run_occ('learn drives.csv -o rules.yaml --apart gap,speed')[0] == 0
    constraints = load_constraints('rules.yaml')
    assert conditional(constraints) == []
    assert constraints.learner['conditional']['apart'] == [['gap', 'speed']]


def test_a_feature_map_may_name_what_is_kept_apart(tables, run_occ):
    text = MAP.read_text()
    Path('nav.yaml').write_text(text + 'apart: [[y, x]]\n')
    assert run_occ(f'learn {BAG} -m nav.yaml -o rules.yaml')[0] == 0
    constraints = load_constraints('rules.yaml')
    assert conditional(constraints) == []
    assert constraints.learner['conditional']['apart'] == [['y', 'x']]
    assert run_occ(f'learn {BAG} -m nav.yaml -o none.yaml --conditions none')[0] == 0
    Path('nav.yaml').write_text(text + 'apart: [[y, xx]]\n')
    code, _, error = run_occ(f'learn {BAG} -m nav.yaml -o rules.yaml --overwrite')
    assert code == 2
    assert "apart[0]: got 'xx'" in error


def test_few_drives_are_told_if_nothing_is_found(tables, run_occ):
    assert json.loads(run_occ('learn few.csv -o rules.yaml --json')[1])['warnings'] == []
    told = json.loads(run_occ('learn few.csv -o rules.yaml --conditions pairs --json')[1])
    assert told['warnings'][-1] == (
        'no conditional rule was found in 5 episodes; fewer than 20 hardly ever prove that a '
        'combination of values is avoided'
    )
    told = json.loads(run_occ('learn drives.csv -o rules.yaml --json')[1])
    assert told['warnings'] == []


def test_a_program_does_the_same(tables, run_occ):
    run_occ('learn drives.csv -o rules.yaml')
    learned = occ_program.learn('drives.csv')
    assert learned.rules == load_constraints('rules.yaml').rules
    apart = occ_program.learn('drives.csv', apart=[('speed', 'gap')])
    assert conditional(apart) == []
    assert conditional(occ_program.learn('drives.csv', conditions='none')) == []


def test_the_rule_of_the_paper_is_found_in_the_shipped_bag():
    constraints = occ_program.learn(BAG, 'simple_nav')
    (rule,) = conditional(constraints)
    left, above = rule.literals
    assert (left.feature, left.operator, above.feature, above.operator) == (0, '<', 1, '>')
    assert 0.65 < left.bound < 0.75
    assert 0.27 < above.bound < 0.32


@pytest.mark.parametrize(
    ('options', 'sentence'),
    [
        ('--conditions pairs --faithful', 'conditions are looked for within a box, got clip den'),
        ('--conditions pairs --alpha 0.5', 'got clip mass, alpha 0.5, full_conditions False'),
        ('--conditions pairs --full-conditions', 'or conditions none'),
        ('--conditions pairs --apart speed,x', "apart names 'x'; allowed are the features and"),
        ('--conditions pairs --apart speed', "apart names ('speed',); allowed are pairs of names"),
        ('--apart speed,x', "apart names 'x'; allowed are the features and"),
        ('--conditions none --apart speed,gap', 'apart has no effect with conditions none'),
        ('--apart speed,gap --alpha 0.5', 'got clip mass, alpha 0.5, full_conditions False'),
        ('--conditions quads', "'quads' is not one of 'none', 'pairs', 'triples'"),
    ],
)
def test_what_does_not_go_together_is_told_in_one_sentence(tables, run_occ, options, sentence):
    code, text, error = run_occ(f'learn drives.csv -o rules.yaml {options}')
    assert (code, text) == (2, '')
    assert sentence in error
    assert error.count('\n') == 1
    assert not Path('rules.yaml').exists()


def test_rules_are_drawn_with_the_demonstrations(tables, run_occ):
    pytest.importorskip('matplotlib')
    assert run_occ('learn drives.csv -o rules.yaml')[0] == 0
    code, text, _ = run_occ('show rules.yaml --plot ranges.png')
    assert (code, text) == run_occ('show rules.yaml')[:2]
    assert run_occ('show rules.yaml --plot all.png --demonstrations drives.csv')[0] == 0
    ranges, density = Path('ranges.png').read_bytes(), Path('all.png').read_bytes()
    assert ranges[1:4] == density[1:4] == b'PNG'
    assert ranges != density


@pytest.mark.parametrize(
    ('options', 'sentence'),
    [
        ('--demonstrations drives.csv', 'got --demonstrations without --plot'),
        ('--plot rules.pdf', 'allowed is a name that ends in .png'),
        ('--plot drives.png --demonstrations nowhere.csv', 'nowhere.csv'),
    ],
)
def test_what_cannot_be_drawn_is_told(tables, run_occ, options, sentence):
    assert run_occ('learn drives.csv -o rules.yaml --conditions none')[0] == 0
    code, _, told = run_occ(f'show rules.yaml {options}')
    assert code == 2
    assert sentence in told
