# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The options of ``occ record`` and ``occ play`` are the parameters of the nodes."""

import json

import pytest
from occ_constraints_pkg.cli import main

from occ_constraints_pkg import nodes


@pytest.fixture
def started(monkeypatch):
    """Return the nodes that were started, with the parameters that differ from nothing."""
    calls = []

    def run(name, arguments):
        pairs = (item.split(':=', 1) for item in arguments[2::2])
        calls.append((name, {key: json.loads(value) for key, value in pairs}))
        return 0

    monkeypatch.setattr(nodes, 'run', run)
    return calls


def test_record(started):
    line = (
        'record odom scan -o bag -e ^/left --exclude-topic a --exclude-topic b '
        '-b 1000 -d 2.5 --compression lz4 --use-sim-time'
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
