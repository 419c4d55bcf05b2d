# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The exported C judges as Python does, compiled by whatever compiler is there."""

import shutil
import subprocess

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from occ_constraints_pkg.cli import main
from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.rules import Feature, FeatureSpace, Literal, Rule, RuleSet, Verdict
from occ_constraints_pkg.rules.constraints_file import Constraints
from occ_constraints_pkg.rules.export_c import export_c
from occ_constraints_pkg.rules.rule import OPERATORS
from strategies import FINITE, rule_sets

COMPILER = shutil.which('cc')
needs_compiler = pytest.mark.skipif(COMPILER is None, reason='needs a C compiler')

# Reads rows of doubles, writes verdict, rule and margin of each as doubles.
PROGRAM = """
#include "rules.h"
#include <stdio.h>
int main(void) {
  double row[OCC_FEATURES];
  while (fread(row, sizeof row, 1, stdin) == 1) {
    occ_judgement now = occ_judge(row);
    double out[3] = {now.verdict, now.rule, now.margin};
    fwrite(out, sizeof out, 1, stdout);
  }
  return 0;
}
"""


def judge_in_c(rule_set, rows, folder):
    (folder / 'rules.h').write_text(export_c(rule_set))
    (folder / 'main.c').write_text(PROGRAM)
    strict = ['-std=c99', '-O2', '-Wall', '-Wextra', '-Wno-unused-variable', '-pedantic', '-Werror']
    subprocess.run([COMPILER, *strict, 'main.c', '-o', 'judge'], cwd=folder, check=True)
    data = np.ascontiguousarray(rows, dtype=np.float64).tobytes()
    done = subprocess.run([folder / 'judge'], input=data, capture_output=True, check=True)
    return np.frombuffer(done.stdout).reshape(-1, 3)


def assert_same(rule_set, rows, folder):
    got, expected = judge_in_c(rule_set, rows, folder), rule_set.judge(rows)
    np.testing.assert_array_equal(got[:, 0], expected.verdict)
    np.testing.assert_array_equal(got[:, 1], expected.rule)
    np.testing.assert_array_equal(got[:, 2], expected.margin)


def hard_rows(rng, rule_set, count):
    """Random values, values on bounds and one double beside them, and values that are none."""
    bounds = [item.bound for rule in rule_set.rules for item in rule.literals]
    bounds += [*rule_set.space.lows, *rule_set.space.highs, 0.0, -0.0]
    special = np.array([*bounds, np.nan, np.inf, -np.inf, 1e308, -1e308, 5e-324])
    with np.errstate(over='ignore'):
        beside = [np.nextafter(special, np.inf), np.nextafter(special, -np.inf)]
    special = np.concatenate([special, *beside])
    rows = rng.uniform(-2.5, 2.5, (count, len(rule_set.space)))
    place = rng.random(rows.shape) < 0.4
    finite = special[np.isfinite(special)]
    rows[place] = rng.choice(finite, np.count_nonzero(place))
    place = rng.random(rows.shape) < 0.01
    rows[place] = rng.choice(special, np.count_nonzero(place))
    return rows


def large_rule_set():
    rng = np.random.default_rng(3)
    features = tuple(Feature(f'x{i}', 'm', *((-2.0, 2.0) if i % 3 else ())) for i in range(8))
    rules = tuple(
        Rule(
            f'R{number}',
            tuple(
                Literal(int(rng.integers(8)), OPERATORS[rng.integers(4)], rng.integers(-8, 9) / 4)
                for _ in range(rng.integers(4, 7))
            ),
            enabled=number % 5 > 0,
        )
        for number in range(30)
    )
    kept = tuple(rule for rule in rules if not rule.is_contradictory)
    return RuleSet(FeatureSpace(features), kept, np.tile([-1.0, 1.5], (8, 1)))


@needs_compiler
def test_a_million_random_and_boundary_points(tmp_path):
    rule_set = large_rule_set()
    rows = hard_rows(np.random.default_rng(0), rule_set, 1_000_000)
    verdicts = rule_set.judge(rows[:10_000]).verdict
    assert set(verdicts) == {Verdict.SAFE, Verdict.VIOLATED, Verdict.UNKNOWN}
    assert_same(rule_set, rows, tmp_path)


@needs_compiler
@settings(
    max_examples=10, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(rule_sets(bounds=FINITE | st.integers(-8, 8).map(float)), st.integers(0, 2**32 - 1))
def test_any_rule_set(tmp_path, rule_set, seed):
    assert_same(rule_set, hard_rows(np.random.default_rng(seed), rule_set, 300), tmp_path)


@needs_compiler
def test_names_and_texts_cannot_break_out_of_their_strings(tmp_path):
    nasty = 'a"; */ int x; ??/ \\ é\n'
    space = FeatureSpace((Feature('x', nasty),))
    rule_set = RuleSet(space, (Rule(nasty, (Literal(0, '>', 0.5),)),), np.array([[0.0, 1.0]]))
    assert_same(rule_set, np.array([[0.25], [0.75]]), tmp_path)


@pytest.mark.parametrize('prefix', ['', '1a', 'Occ', 'a-b', 'a b'])
def test_a_prefix_that_is_no_name_is_refused(prefix):
    with pytest.raises(OccError, match='allowed are lower-case letters'):
        export_c(large_rule_set(), prefix)


def test_the_command_writes_a_file_or_stdout(tmp_path, capsys):
    file, header = tmp_path / 'rules.yaml', tmp_path / 'rules.h'
    rule_set = large_rule_set()
    Constraints(rule_set).save(file)
    assert main(['export', 'c', str(file)]) == 0
    assert capsys.readouterr().out == export_c(rule_set)
    assert main(['export', 'c', str(file), '-o', str(header), '--prefix', 'left']) == 0
    assert header.read_text() == export_c(rule_set, 'left')
    assert main(['export', 'c', str(tmp_path / 'none.yaml')]) == 2
