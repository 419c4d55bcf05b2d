# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Text of others is shown on a terminal and in a log, never obeyed."""

import os
import subprocess
import sys
import unicodedata
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from occ_constraints_pkg.cli import main
from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.learning.learn import learn
from occ_constraints_pkg.rules.constraints_file import load_constraints
from occ_constraints_pkg.rules.space import Feature, FeatureSpace
from occ_constraints_pkg.terminal import printable

EVIL = 'a\n\x1b]0;title\x07\x1b[2Jb\r\x9b31m\u202egnp\u2028c\u2066'
BIDI = {'LRE', 'RLE', 'LRO', 'RLO', 'PDF', 'LRI', 'RLI', 'FSI', 'PDI'}


def is_harmless(text: str, allowed: str = '') -> bool:
    return all(
        character in allowed
        or not (
            unicodedata.category(character) in ('Cc', 'Cs', 'Zl', 'Zp')
            or unicodedata.bidirectional(character) in BIDI
        )
        for character in text
    )


@given(st.text(st.characters()))
def test_nothing_that_a_terminal_obeys_is_left(text):
    assert is_harmless(printable(text))
    assert is_harmless(printable(text, keep_lines=True), '\n\t')
    printable(text).encode()


@given(st.text(st.characters(categories=['L', 'N', 'P', 'S', 'Zs'])))
def test_ordinary_text_of_any_language_stays_as_it_is(text):
    assert printable(text) == text


def test_an_error_is_one_line():
    assert str(OccError(f'no topic {EVIL}')) == f'no topic {printable(EVIL)}'
    assert '\n' not in f'{OccError(EVIL)}'


@pytest.fixture
def evil_rules(tmp_path):
    """Return the path of rules in which every text is hostile."""
    space = FeatureSpace((Feature(f'v{EVIL}', f'm{EVIL}'), Feature('d', 'm')))
    values = np.random.default_rng(0).normal(size=(400, 2))
    learned = learn(values, np.arange(400) // 40, space, rng=np.random.default_rng(0))
    path = tmp_path / 'evil.yaml'
    rules = tuple(replace(rule, note=EVIL) for rule in learned.rule_set.rules)
    replace(learned, rule_set=replace(learned.rule_set, rules=rules)).save(path)
    table = tmp_path / 'rows.npz'
    np.savez(table, features=10.0 * values, names=[f'v{EVIL}', 'd'])
    return path, table


def test_no_command_prints_what_a_terminal_obeys(evil_rules, tmp_path, capsys):
    rules, table = map(str, evil_rules)
    rule = load_constraints(rules).rule_set.rules[0]
    assert rule.note == EVIL
    lines = {}
    for arguments in (
        ['show', rules],
        ['show', '--traffic', rules],
        ['show', '--json', rules],
        ['show', '--why', rule.id, rules],
        ['show', '--why', EVIL, rules],
        ['show', f'{tmp_path}/{EVIL}.yaml'],
        ['check', table, '-c', rules],
        ['check', table, '-c', rules, '--json'],
        ['check', f'{tmp_path}/{EVIL}', '-c', rules],
        ['learn', table, '-o', f'{tmp_path}/{EVIL.replace("/", "")}.yaml'],
        ['learn', f'{tmp_path}/{EVIL}', '-m', EVIL],
        ['simplify', rules, '-o', f'{tmp_path}/{EVIL.replace("/", "")}2.yaml'],
        ['export', 'c', rules],
        [EVIL],
        ['show', f'--{EVIL}'],
    ):
        code = main(arguments)
        out, err = capsys.readouterr()
        assert code in (0, 1, 2)
        assert is_harmless(out, '\n\t'), (arguments, out)
        assert is_harmless(err, '\n'), (arguments, err)
        assert all(line.startswith(('error: ', 'warning: ')) for line in err.splitlines()), err
        lines[arguments[0]] = out
    assert not any(line.startswith(('b', 'c')) for line in lines['simplify'].splitlines())


def test_a_log_has_one_line_for_a_message():
    pytest.importorskip('rclpy', reason="needs the extra 'ros'")
    code = f"""
import rclpy
from occ_constraints_pkg.ros.node import OccNode
rclpy.init()
node = OccNode('talker')
for number in range(3):
    node.get_logger().error({EVIL!r}, throttle_duration_sec=60.0)
    node.get_logger().error(f'number {{number}}', throttle_duration_sec=60.0)
    node.get_logger().info(f'each {{number}}')
"""
    done = subprocess.run(
        [sys.executable, '-c', code],
        capture_output=True,
        text=True,
        timeout=60,
        env={**os.environ, 'RCUTILS_COLORIZED_OUTPUT': '0'},
    )
    said = [line.rpartition(']: ')[2] for line in (done.stdout + done.stderr).splitlines()]
    # Throttling goes by the place of the call, as it does without the escaping.
    assert sorted(said) == sorted([printable(EVIL), 'number 0', 'each 0', 'each 1', 'each 2'])
