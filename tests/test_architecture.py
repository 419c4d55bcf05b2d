# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""What docs/architecture.md says of packages, arrows and functions is so."""

import ast
import re
from pathlib import Path

import pytest
from test_layers import ARROWS

import occ_constraints_pkg

PACKAGE = Path(occ_constraints_pkg.__file__).parent
PAGE = (Path(__file__).parents[1] / 'docs' / 'architecture.md').read_text(encoding='utf-8')
# A step of a walk-through: its number, function and file.
STEP = re.compile(r'^\| (\d+) \| `([\w.]+)` \| `([\w/]+\.py)` \|', re.MULTILINE)
WALKS = {
    title: STEP.findall(text)
    for title, text in re.findall(
        r'^## (One [^\n]+)\n(.*?)(?=^## |\Z)', PAGE, re.MULTILINE | re.DOTALL
    )
}


def functions_of(file):
    """Return the functions and methods that a module defines, methods after their class."""
    found = set()
    for node in ast.parse((PACKAGE / file).read_text(encoding='utf-8')).body:
        if isinstance(node, ast.FunctionDef):
            found.add(node.name)
        elif isinstance(node, ast.ClassDef):
            found |= {
                f'{node.name}.{item.name}'
                for item in node.body
                if isinstance(item, ast.FunctionDef)
            }
    return found


def reachable(arrows):
    """Return for each package all that it imports, directly or through others."""
    closed = {package: set(targets) for package, targets in arrows.items()}
    for _ in closed:
        for targets in closed.values():
            targets |= {far for near in targets for far in closed[near]}
    return closed


def test_the_table_lists_every_arrow():
    rows = re.findall(r'^\| `(\w+)` \|[^|]*\| ([^|]*) \|[^|]*\|$', PAGE, re.MULTILINE)
    listed = {package: set(re.findall(r'`(\w+)`', imports)) for package, imports in rows}
    assert listed == ARROWS


def test_the_diagram_has_the_arrows_that_do_not_follow_from_others():
    (diagram,) = re.findall(r'```mermaid\n(.*?)```', PAGE, re.DOTALL)
    drawn = {package: set() for package in ARROWS}
    for package, targets in re.findall(r'^ +(\w+) --> (.+)$', diagram, re.MULTILINE):
        drawn[package] |= set(targets.split(' & ')) - {'ground'}
    assert all(drawn[package] <= ARROWS[package] for package in ARROWS)
    assert reachable(drawn) == reachable(ARROWS)


@pytest.mark.parametrize('walk', list(WALKS))
def test_the_functions_of_a_walk_are_there(walk):
    steps = WALKS[walk]
    assert [int(number) for number, _, _ in steps] == list(range(1, len(steps) + 1))
    assert 5 <= len(steps) <= 12
    for _, function, file in steps:
        assert function in functions_of(file), f'{file} has no {function}'


def test_there_are_two_walks():
    assert list(WALKS) == ['One message, from topic to cost', 'One bag row, to a rule']


def test_each_step_is_used_by_an_earlier_file_or_is_a_callback():
    """Each function after the first is called, or handed on by its own class."""
    for steps in WALKS.values():
        before = ''
        for number, function, file in steps:
            text = (PACKAGE / file).read_text(encoding='utf-8')
            before += text
            used = re.search(rf'(?<!def )\b{function.rpartition(".")[2]}\b', before)
            assert number == '1' or used, f'nobody uses {function}'
