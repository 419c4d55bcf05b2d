# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Arguments of the launch files: mistakes start nothing, and what is not given hides nothing."""

import re
from pathlib import Path

import pytest

DOCS = Path(__file__).resolve().parents[2] / 'docs' / 'nodes.md'
RECORD = ('bag:=bag', 'feature_map:=simple_nav', 'constraints_file:=rules.yaml')


@pytest.mark.parametrize(
    ('file', 'arguments', 'sentence'),
    [
        ('monitor', ['gate:=yes'], 'Argument "gate" provided value "yes" is not valid'),
        ('monitor', ['gate:=true', 'stamped:=maybe'], 'Argument "stamped" provided value "maybe"'),
        ('monitor', ['use_sim_time:=maybe'], 'Argument "use_sim_time" provided value "maybe"'),
        ('monitor', ['respawn:=1'], 'Argument "respawn" provided value "1" is not valid'),
        ('monitor', ['params_file:=none.yaml'], 'params_file none.yaml cannot be read'),
        ('simulation', ['num_robots:=many'], "'num_robots': got 'many'; allowed is a whole number"),
        ('simulation', ['seed:=-1'], "'seed': got '-1'; allowed is a whole number from 0"),
        (
            'record_and_learn',
            [*RECORD, 'duration:=abc'],
            "'duration': got 'abc'; allowed is a number above 0",
        ),
        (
            'record_and_learn',
            [*RECORD, 'duration:=-1'],
            "'duration': got '-1'; allowed is a number above 0",
        ),
        (
            'record_and_learn',
            [*RECORD[::2], 'feature_map:=nosuch'],
            "there is no feature map 'nosuch'",
        ),
        (
            'record_and_learn',
            [*RECORD[:2], 'constraints_file:=none/rules.yaml'],
            'to write the constraints file to',
        ),
        ('record_and_learn', RECORD[:2], "missing required argument 'constraints_file'"),
        (
            'record_and_learn',
            ['bag:=', *RECORD[1:]],
            "launch argument 'bag': got ''; allowed is what is not empty",
        ),
        (
            'training',
            ['constraints_file:=rules.yaml', 'output:=out', 'resume:=on'],
            'Argument "resume" provided value "on" is not valid',
        ),
        (
            'training',
            ['constraints_file:=rules.yaml', 'output:=out', 'cost_limit:=nan'],
            "'cost_limit': got 'nan'; allowed is a number",
        ),
    ],
)
def test_a_mistake_starts_nothing(start, file, arguments, sentence):
    launch = start(file, *arguments)
    assert launch.join() == 1
    assert sentence in launch.text
    assert 'process started' not in launch.text


def test_a_bag_that_is_there_is_not_learned_from(start, tmp_path):
    (tmp_path / 'bag').mkdir()
    launch = start('record_and_learn', *RECORD)
    assert launch.join() == 1
    assert 'bag exists already; allowed is a new folder' in launch.text
    assert 'process started' not in launch.text


def test_the_home_directory_may_be_written_short(start):
    launch = start('monitor', 'params_file:=~/none.yaml')
    assert launch.join() == 1
    assert f'params_file {Path.home()}/none.yaml cannot be read' in launch.text


@pytest.fixture
def params_file(tmp_path):
    path = tmp_path / 'params.yaml'
    path.write_text(
        """
/**/monitor: {ros__parameters: {timeout: 7.5, use_sim_time: false}}
/**/gate: {ros__parameters: {stamped: true}}
/**/sim: {ros__parameters: {world: simple_nav, num_robots: 3, seed: 5}}
/**: {ros__parameters: {policy: straight}}
"""
    )
    return f'params_file:={path}'


def test_what_is_not_given_leaves_the_parameter_file_alone(start, params_file, parameter):
    start('monitor', params_file, 'gate:=true')
    assert parameter('gate', 'stamped') is True
    assert parameter('monitor', 'timeout') == 7.5
    start('simulation', params_file)
    assert [parameter('sim', name) for name in ('world', 'num_robots', 'seed')] == [
        'simple_nav',
        3,
        5,
    ]
    assert parameter('policy', 'policy') == 'straight'


def test_what_is_given_goes_before_the_parameter_file(start, params_file, parameter):
    launch = start(
        'monitor', params_file, 'gate:=true', 'stamped:=False', 'use_sim_time:=true', 'gtae:=true'
    )
    assert parameter('gate', 'stamped') is False
    assert parameter('monitor', 'use_sim_time') is True
    assert "there is no launch argument 'gtae'; did you mean 'gate'?" in launch.text
    launch.interrupt()
    assert launch.join() == 0


def test_defaults_hold_without_a_parameter_file(start, parameter):
    start('simulation', 'world:=simple_nav')
    assert parameter('policy', 'policy') == 'expert'
    assert parameter('sim', 'num_robots') == 1


@pytest.mark.parametrize(('kind', 'module'), [('xml', 'launch_xml'), ('yaml', 'launch_yaml')])
def test_the_includes_of_the_docs_run(start, parameter, observer, tmp_path, kind, module):
    pytest.importorskip(module)
    blocks = re.findall(rf'```{kind}\n(.*?)```', DOCS.read_text(encoding='utf-8'), re.DOTALL)
    (text,) = (block for block in blocks if 'monitor.launch.py' in block)
    path = tmp_path / f'robot.launch.{kind}'
    path.write_text(text)
    start(path)
    # What the including file sets for all its nodes reaches ours.
    assert parameter('/robot1/monitor', 'use_sim_time') is True
    observer.spin_until(lambda: observer.node.count_subscribers('/robot1/cmd_vel_nav') == 1)


def test_with_simulated_time_the_sim_makes_it_and_the_others_live_by_it(start, parameter, observer):
    start('simulation', 'world:=simple_nav', 'use_sim_time:=true')
    assert parameter('policy', 'use_sim_time') is True
    assert parameter('sim', 'publish_clock') is True
    observer.spin_until(lambda: observer.node.count_publishers('/clock') == 1)
    assert parameter('sim', 'use_sim_time') is False
