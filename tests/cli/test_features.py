# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""From a recording to rules with nothing but ``occ``."""

import json
import math

import numpy as np
import pytest
from occ_constraints_pkg.cli import main
from occ_constraints_pkg.rosbag.writer import BagWriter
from synthetic_bags import START_NS, STORE, write_drive


def run(capsys, *arguments):
    code = main([str(item) for item in arguments])
    captured = capsys.readouterr()
    return code, captured.out, captured.err


@pytest.fixture
def bag(tmp_path):
    """A robot that turns round between walls."""
    types = STORE.types
    with BagWriter(tmp_path / 'drive') as writer:
        for step in range(100):
            now = START_NS + step * 10**8
            time = types['builtin_interfaces/msg/Time'](*divmod(now, 10**9))
            header = types['std_msgs/msg/Header'](time, 'laser')
            ranges = 1.0 + np.sin(np.arange(60) / 5 + step / 9) / 2
            scan = types['sensor_msgs/msg/LaserScan'](
                header, 0.0, 6.2, math.tau / 60, 0.0, 0.0, 0.1, 4.0,
                ranges.astype(np.float32), np.array([], dtype=np.float32),
            )  # fmt: skip
            vector = types['geometry_msgs/msg/Vector3']
            twist = types['geometry_msgs/msg/TwistStamped'](
                header,
                types['geometry_msgs/msg/Twist'](
                    vector(0.2 + step % 7 / 50, 0.0, 0.0), vector(0.0, 0.0, 0.0)
                ),
            )
            for topic, message in (('/scan', scan), ('/cmd_vel', twist)):
                data = bytes(STORE.serialize_cdr(message, message.__msgtype__))
                writer.write(topic, message.__msgtype__, data, now)
    return tmp_path / 'drive'


def test_suggest_then_learn_then_check(capsys, bag, tmp_path):
    target = tmp_path / 'map.yaml'
    code, out, err = run(capsys, 'features', 'suggest', bag, '-o', target)
    assert (code, err) == (0, '')
    assert out == f'9 features; written to {target}\n'
    code, out, _ = run(capsys, 'features', 'check', bag, target)
    assert code == 0
    assert out.splitlines()[0].endswith('triggered by scan; 99.0% can be judged')
    rules = tmp_path / 'rules.yaml'
    assert run(capsys, 'learn', bag, '-m', target, '-o', rules)[0] == 0
    code, out, _ = run(capsys, 'check', bag, '-c', rules)
    # The first row has no command yet.
    assert '1 interval UNKNOWN: commanded_speed unusable' in out
    assert 'commanded_speed' not in out.partition('rules violated')[2]


def test_suggest_prints_the_map_alone(capsys, bag):
    code, out, _ = run(capsys, 'features', 'suggest', bag)
    assert code == 0
    assert out.startswith('# Suggested from drive: 100 rows')
    assert '\nschema_version: 1\n' in out


def test_json(capsys, bag, tmp_path):
    target = tmp_path / 'map.yaml'
    code, out, _ = run(capsys, 'features', 'suggest', bag, '-o', target, '--json')
    document = json.loads(out)
    assert code == 0
    assert document['map'] == target.read_text()
    assert document['not_used'][0]['reason'].startswith('constant at 0')
    code, out, _ = run(capsys, 'features', 'check', bag, target, '--json')
    document = json.loads(out)
    assert document['features'][0]['name'] == 'clearance_front'
    assert document['rows'] == 100


def test_a_map_that_yields_too_little(capsys, bag, tmp_path):
    target = tmp_path / 'map.yaml'
    target.write_text(
        'schema_version: 1\npace: scan\nmax_age: 1\nfeatures:\n'
        '- {name: d, topic: scan, field: ranges, reduce: min, bounds: [0, 0.4]}\n'
        '- {name: still, topic: scan, field: range_max}\n'
    )
    code, out, _ = run(capsys, 'features', 'check', bag, target)
    assert code == 1
    assert 'outside the bounds [0, 0.4]' in out
    assert 'never changes' in out


def test_mistakes(capsys, bag, tmp_path):
    target = tmp_path / 'map.yaml'
    target.write_text('mine')
    code, _, err = run(capsys, 'features', 'suggest', bag, '-o', target)
    assert (code, target.read_text()) == (2, 'mine')
    assert 'exists already' in err
    code, _, err = run(capsys, 'features', 'check', bag, target)
    assert code == 2
    code, _, err = run(capsys, 'features', 'suggest', tmp_path / 'nothing')
    assert (code, err.count('\n')) == (2, 1)


def test_a_table_of_robots(capsys, tmp_path):
    bag = write_drive(tmp_path / 'drive', robots=3, steps=30)
    code, out, _ = run(capsys, 'features', 'suggest', bag)
    assert code == 0
    assert 'column: x' in out
    code, out, _ = run(capsys, 'features', 'check', bag, 'simple_nav')
    assert code == 0
    assert '90 rows' in out


def test_help_names_an_example(capsys):
    for command in ('suggest', 'check'):
        code, out, _ = run(capsys, 'features', command, '--help')
        assert code == 0
        assert 'Example: occ features' in out
