# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Launch files, read as text: PyPI has no `launch` to run them with."""

import ast
from pathlib import Path

import pytest

FOLDER = Path(__file__).resolve().parents[2] / 'src' / 'occ_constraints_pkg' / 'launch'
FILES = sorted(path.name for path in FOLDER.iterdir() if path.is_file())


def calls(name: str, function: str) -> list[ast.Call]:
    """The calls of a function in a launch file, by the last part of the function's name."""
    tree = ast.parse((FOLDER / name).read_text())
    return [
        node
        for node in ast.walk(tree)
        if isinstance(node, ast.Call) and ast.unparse(node.func).rpartition('.')[2] == function
    ]


def keyword(call: ast.Call, name: str) -> str | None:
    """The literal text given for a keyword of a call."""
    for entry in call.keywords:
        if entry.arg == name and isinstance(entry.value, ast.Constant):
            return entry.value.value
    return None


def test_the_four_launch_files_are_there():
    assert FILES == [
        'monitor.launch.py',
        'record_and_learn.launch.py',
        'simulation.launch.py',
        'training.launch.py',
    ]


@pytest.mark.parametrize('name', FILES)
def test_defines_generate_launch_description(name):
    tree = ast.parse((FOLDER / name).read_text())
    functions = {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}
    assert 'generate_launch_description' in functions


@pytest.mark.parametrize('name', FILES)
def test_every_argument_has_a_description_and_is_used(name):
    declared = calls(name, 'DeclareLaunchArgument')
    assert declared
    text = (FOLDER / name).read_text()
    for call in declared:
        argument = call.args[0].value
        assert keyword(call, 'description'), f'{name}: {argument}'
        assert text.count(f"'{argument}'") >= 2, f'{name}: {argument} is declared and not used'


@pytest.mark.parametrize('name', FILES)
def test_every_configuration_is_declared(name):
    declared = {call.args[0].value for call in calls(name, 'DeclareLaunchArgument')}
    used = {
        call.args[0].value
        for call in calls(name, 'LaunchConfiguration')
        if isinstance(call.args[0], ast.Constant)
    }
    assert used <= declared


@pytest.mark.parametrize('name', FILES)
def test_started_nodes_exist_and_bear_the_name_their_parameters_are_filed_under(name, nodes):
    for call in calls(name, 'Node'):
        assert keyword(call, 'executable') in nodes
        assert keyword(call, 'name') == keyword(call, 'executable')


def test_the_monitor_takes_what_jazzy_users_expect():
    declared = {call.args[0].value for call in calls('monitor.launch.py', 'DeclareLaunchArgument')}
    assert declared >= {
        'namespace',
        'use_sim_time',
        'params_file',
        'constraints_file',
        'log_level',
    }


def test_the_monitor_brings_a_gate_for_a_robot():
    started = {keyword(call, 'executable') for call in calls('monitor.launch.py', 'Node')}
    assert started == {'monitor', 'gate'}
    declared = {call.args[0].value for call in calls('monitor.launch.py', 'DeclareLaunchArgument')}
    assert declared >= {'gate', 'stamped', 'cmd_vel_in', 'cmd_vel'}
