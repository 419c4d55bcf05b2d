# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Launch files, read as text: PyPI has no `launch`. Where it is, `tests/launching` runs them."""

import ast
from pathlib import Path

import pytest
from ruamel.yaml import YAML

PACKAGE = Path(__file__).resolve().parents[2] / 'src' / 'occ_constraints_pkg'
FOLDER = PACKAGE / 'launch'
FILES = sorted(path.name for path in FOLDER.iterdir() if path.is_file())


def calls(name, function):
    """The calls of a function in a launch file, each as its literal arguments, by place or name."""
    tree = ast.parse((FOLDER / name).read_text(encoding='utf-8'))
    found = []
    for call in ast.walk(tree):
        if isinstance(call, ast.Call) and ast.unparse(call.func) == function:
            given = [*enumerate(call.args), *((entry.arg, entry.value) for entry in call.keywords)]
            found.append(
                {key: value.value for key, value in given if isinstance(value, ast.Constant)}
            )
    return found


def test_the_four_launch_files_are_there():
    assert FILES == [
        'monitor.launch.py',
        'record_and_learn.launch.py',
        'simulation.launch.py',
        'training.launch.py',
    ]


@pytest.mark.parametrize('name', FILES)
def test_every_argument_is_described_and_used(name):
    declared = calls(name, 'Argument')
    assert declared
    text = (FOLDER / name).read_text(encoding='utf-8')
    for argument in declared:
        assert argument[1].endswith('.')
        assert text.count(f"'{argument[0]}'") >= 2, f'{name}: {argument[0]} is not used'


@pytest.mark.parametrize('name', FILES)
def test_nodes_and_their_parameters_exist(name, nodes):
    started = [call[0] for call in calls(name, 'node')]
    assert started
    assert set(started) <= set(nodes)
    parameters = YAML(typ='safe').load(PACKAGE / 'config' / 'params.yaml')
    for argument in calls(name, 'Argument'):
        if 'parameter' in argument:
            node, _, parameter = argument['parameter'].partition('.')
            assert parameter in parameters[f'/**/{node}']['ros__parameters']
