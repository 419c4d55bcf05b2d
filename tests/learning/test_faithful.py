# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The article's settings, from Python and from the command line."""

from pathlib import Path

import pytest
from occ_constraints_pkg.cli import main
from occ_constraints_pkg.learning.settings import OCTreeSettings
from occ_constraints_pkg.rules.constraints_file import load_constraints

BAG = Path(__file__).parents[2] / 'bags' / 'simple_nav_expert'


def learned(tmp_path, *options):
    """Return the learner's parameters in the file that ``occ learn`` writes."""
    output = tmp_path / 'constraints.yaml'
    code = main(['learn', str(BAG), '-m', 'simple_nav', '-o', str(output), *options])
    assert code == 0
    return load_constraints(output).learner


def test_the_preset_is_the_article_and_can_be_changed():
    preset = OCTreeSettings.article()
    assert (preset.clip, preset.gamma, preset.alpha, preset.beta) == ('density', 0.05, 0.5, 0.02)
    assert (preset.nu, preset.max_depth, preset.min_split) == (0.1, None, 0.0)
    changed = OCTreeSettings.article(alpha=0.8, nu=None, max_depth=3)
    assert (changed.alpha, changed.nu, changed.max_depth, changed.gamma) == (0.8, None, 3, 0.05)


def test_faithful_learns_with_the_preset(tmp_path):
    used = learned(tmp_path, '--faithful')
    for name in ('clip', 'gamma', 'alpha', 'beta', 'nu', 'max_depth', 'min_split'):
        assert used[name] == getattr(OCTreeSettings.article(), name), name
    assert used['full_conditions'] is True


def test_options_change_the_preset_and_depth_replaces_nu(tmp_path):
    used = learned(tmp_path, '--faithful', '--depth', '2', '--gamma', '0.01', '--alpha', '0.7')
    assert (used['max_depth'], used['nu']) == (2, None)
    assert (used['gamma'], used['alpha'], used['beta']) == (0.01, 0.7, 0.02)


def test_a_named_nu_stays_beside_a_depth(tmp_path):
    options = ('--depth', '2', '--nu', '0.2', '--beta', '0.01', '--min-split', '0.05')
    used = learned(tmp_path, '--faithful', *options)
    assert (used['max_depth'], used['nu'], used['beta']) == (2, 0.2, 0.01)
    assert used['min_split'] == 0.05


def test_a_named_default_counts_as_given(tmp_path):
    assert learned(tmp_path, '--faithful', '--alpha', '0.0')['alpha'] == 0.0


@pytest.mark.parametrize('options', [['--clip', 'mass'], ['--contamination', '0.1']])
def test_options_of_mass_clipping_are_refused(tmp_path, capsys, options):
    output = str(tmp_path / 'constraints.yaml')
    assert main(['learn', str(BAG), '-m', 'simple_nav', '-o', output, '--faithful', *options]) == 2
    assert '--faithful clips by density' in capsys.readouterr().err


def test_without_it_the_defaults_stay(tmp_path):
    used = learned(tmp_path)
    assert (used['clip'], used['nu'], used['alpha']) == ('mass', None, 0.0)
