# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The options of ``occ record`` and ``occ play`` are the parameters of the nodes."""

import json
import re

import pytest
from occ_constraints_pkg.cli import main

from occ_constraints_pkg import nodes


@pytest.fixture
def started(monkeypatch):
    """Return the nodes that were started, with the parameters that differ from nothing."""
    calls = []

    def run(name, arguments):
        pairs = list(zip(arguments[1::2], arguments[2::2], strict=True))
        parameters = (item.split(':=', 1) for flag, item in pairs if flag == '-p')
        calls.append(
            (
                name,
                {key: json.loads(value) for key, value in parameters},
                *(pair for pair in pairs if pair[0] != '-p'),
            )
        )
        return 0

    monkeypatch.setattr(nodes, 'run', run)
    return calls


def test_record(started):
    line = (
        'record odom scan -o bag -e ^/left --exclude-topic a --exclude-topic b '
        '-b 1000 -d 2.5 --duration 60 --compression lz4 --use-sim-time'
    )
    assert main(line.split()) == 0
    assert started == [
        (
            'recorder',
            {
                'topics': ['odom', 'scan'],
                'output': 'bag',
                'regex': '^/left',
                'exclude_topics': ['a', 'b'],
                'compression': 'lz4',
                'max_bag_size': 1000,
                'max_bag_duration': 2.5,
                'duration': 60.0,
                'use_sim_time': True,
            },
        )
    ]


def test_play(started):
    lines = (
        'play bag -r 2 -l --start-offset 3 --clock --exclude-regex ^/tf',
        'play bag --topic /scan --clock 100 -p --wait-for-subscribers 2',
    )
    assert [main(line.split()) for line in lines] == [0, 0]
    first, second = (values for _, values in started)
    assert first == {
        'bag': 'bag',
        'rate': 2.0,
        'loop': True,
        'start_offset': 3.0,
        'clock': 40.0,
        'exclude_regex': '^/tf',
        'start_paused': False,
        'wait_for_subscribers': 0,
    }
    assert (second['topics'], second['clock'], second['start_paused']) == (['/scan'], 100.0, True)


def test_without_options_the_defaults_of_the_nodes_hold(started):
    assert main(['play', 'bag']) == 0
    assert started[0][1]['clock'] == 0.0
    assert main(['record', '-o', 'bag']) == 0
    assert started[1][1]['max_bag_size'] == 0


def test_record_takes_the_options_of_ros2_bag(started):
    lines = (
        'record -a -o bag -s mcap',
        'record --topics /odom /scan --exclude-topics /a /b -o bag --compression-format lz4',
        'record --exclude-topics /a -o bag -e scan --node-name mine --log-level debug',
        'record /odom --topics /scan -o bag',
    )
    assert [main(line.split()) for line in lines] == [0] * 4
    everything, named, other, both = (call[1] for call in started)
    assert 'topics' not in everything
    assert (named['topics'], named['exclude_topics']) == (['/odom', '/scan'], ['/a', '/b'])
    assert named['compression'] == 'lz4'
    assert (other['exclude_topics'], other['regex']) == (['/a'], 'scan')
    assert started[2][2:] == (('-r', '__node:=mine'), ('--log-level', 'debug'))
    assert both['topics'] == ['/odom', '/scan']


def test_record_names_a_bag_by_the_time_as_ros2_bag_does(started):
    assert main(['record']) == 0
    assert re.fullmatch(r'rosbag2(_\d+)+-\d\d_\d\d_\d\d', started[0][1]['output'])


def test_play_takes_the_options_of_ros2_bag(started):
    line = (
        'play bag --topics /odom /scan -x ^/tf --exclude-topics /a /b '
        '--remap /odom:=/o /scan:=/s -m /c:=/d --clock --loop'
    )
    assert main(line.split()) == 0
    ((name, parameters, *others),) = started
    assert (name, parameters['topics']) == ('player', ['/odom', '/scan'])
    assert (parameters['exclude_topics'], parameters['exclude_regex']) == (['/a', '/b'], '^/tf')
    assert (parameters['clock'], parameters['loop']) == (40.0, True)
    assert others == [('-r', '/odom:=/o'), ('-r', '/scan:=/s'), ('-r', '/c:=/d')]
