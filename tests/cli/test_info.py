# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
import json
import re

import pytest
from mcap.writer import Writer

SECOND = 10**9


@pytest.fixture
def bag(messages, write_bag):
    entries = []
    for tick in range(20):
        time = (tick + (tick > 9) * 3) * SECOND // 10
        entries.append(('/odom', messages.odometry(stamp_ns=time + SECOND), time + 2 * SECOND))
        entries.append(('/cmd_vel', messages.twist(), time + 2 * SECOND))
    return write_bag(entries)


def test_a_recording_at_a_glance(run_occ, bag):
    code, out, _ = run_occ(f'info {bag}')
    assert code == 0
    first, _, command, odometry = out.splitlines()
    assert '40 messages on 2 topics in 2.2 s from 1970-01-01 00:00:02 UTC on; 1 file' in first
    assert odometry.split()[:5] == ['/odom', 'nav_msgs/msg/Odometry', '20', '8.64', 'Hz']
    assert '0.4 s at 0.9 s' in odometry
    assert odometry.endswith('1 s  13 numbers, 2 arrays')
    assert 'no stamps  6 numbers' in command


def test_the_same_for_programs(run_occ, bag):
    code, out, _ = run_occ(f'info {bag} --json')
    assert code == 0
    document = json.loads(out)
    command, odometry = document['topics']
    assert odometry['messages'] == 20
    assert odometry['largest_gap_s'] == pytest.approx(0.4)
    assert odometry['clock']['lag_s'] == pytest.approx(1.0)
    assert odometry['is_learnable']
    assert command['clock'] is None
    assert document['warnings'] == []


def test_what_cannot_be_read_is_told_with_its_reason(run_occ, tmp_path):
    path = tmp_path / 'a.mcap'
    with path.open('wb') as stream:
        writer = Writer(stream)
        writer.start('ros2')
        for topic, msgtype, encoding, data in (
            ('/json', 'a', 'json', b'{}'),
            ('/unknown', 'lab_msgs/msg/A', 'cdr', b'\0\1\0\0' + bytes(8)),
            ('/other', 'std_msgs/msg/Float64', 'cdr', b'\0\7\0\0' + bytes(8)),
            ('/text', 'std_msgs/msg/String', 'cdr', b'\0\1\0\0\2\0\0\0a\0'),
            ('/fine', 'std_msgs/msg/Float64', 'cdr', b'\0\1\0\0' + bytes(8)),
        ):
            schema = writer.register_schema(msgtype, 'ros2msg', b'')
            channel = writer.register_channel(topic, encoding, schema)
            writer.add_message(channel, SECOND, data, SECOND)
        writer.finish()
    code, out, err = run_occ(f'info {path}')
    assert code == 0
    assert err.startswith('warning: all messages have the log time 1000000000 ns')
    lines = {line.split()[0]: line for line in out.splitlines()[2:7]}
    assert lines['/fine'].endswith('1 number')
    assert lines['/text'].endswith('nothing: no numbers')
    for reason in (
        "/json: .* serialized as 'json'",
        '/unknown: .* neither complete in the bag',
        r'/other: .* encoded in XCDR2 \(plain\)',
    ):
        assert re.search(f'^{reason}', out, re.MULTILINE)


def test_no_recording(run_occ):
    code, out, err = run_occ('info nowhere')
    assert (code, out) == (2, '')
    assert 'there is no recording at nowhere' in err
