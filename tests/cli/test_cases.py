# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Recordings made after bug reports of other people's tools: each is read, or its fault is told."""

import pytest

SCAN = """\
schema_version: 1
pace: scan
max_age: 0.5
features:
- {name: clear, topic: scan, field: ranges, reduce: min, missing: max_range, unit: m}
- {name: at, topic: scan, field: ranges, sectors: 8, reduce: min, missing: max_range, unit: m}
"""


@pytest.mark.parametrize(
    ('bag', 'name'),
    [
        ('pj851.mcap', 'm_cmd'),
        ('wstr1.mcap', 'm_wx'),
        ('humble_range', 'rng'),
        ('zero_len.mcap', 'm_odom'),
        ('meta_empty_file', 'm_odom'),
        ('arm.mcap', 'm_arm'),
    ],
)
def test_what_is_read(run_occ, cases, bag, name):
    code, out, _ = run_occ(f'features check {cases / bag} {cases / name}.yaml')
    assert code == 0
    assert ': 200 rows in 10.0 s' in out
    assert '100.0% can be judged' in out


def test_what_a_person_writes_for_px4(run_occ, cases):
    _, out, _ = run_occ(f'features check {cases}/px4_flight1.mcap {cases}/px4_hand.yaml')
    pitch = next(line for line in out.splitlines() if line.startswith('qx')).split()
    assert [pitch[2], pitch[4], pitch[5]] == ['-0.15', '0.15', '0.0%']


@pytest.mark.parametrize(
    ('bag', 'name', 'reason'),
    [
        ('cdr_le.mcap', 'm_odom', "serialized as 'cdr_le'; allowed is 'cdr'"),
        ('no_nul.mcap', 'm_imu', "the text 'imulink' in it does not end in a zero byte"),
        ('xcdr2.mcap', 'm_imu', 'is encoded in XCDR2 (plain); allowed is plain CDR'),
    ],
)
def test_what_is_refused_by_name(run_occ, cases, bag, name, reason):
    code, _, err = run_occ(f'features check {cases / bag} {cases / name}.yaml')
    assert code == 2
    assert reason in err
    code, out, _ = run_occ(f'info {cases / bag}')
    assert code == 0
    assert reason in out


def test_messages_without_bytes_are_counted(run_occ, cases):
    _, _, err = run_occ(f'features check {cases}/zero_len.mcap {cases}/m_odom.yaml')
    assert "3 messages without any bytes on '/odom', which are left out" in err
    _, _, err = run_occ(f'features check {cases}/meta_empty_file {cases}/m_odom.yaml')
    assert 'metadata.yaml is empty' in err


@pytest.mark.parametrize(
    ('bag', 'code', 'words'),
    [
        ('scan_blind_code', 1, '100.0% of the ranges of /scan that are numbers are above'),
        ('scan_degrees', 2, 'allowed are radians'),
        ('scan_inc0', 2, 'angle_increment 0'),
        ('scan_tiny', 1, 'of the ranges of /scan that are numbers are below its range_min'),
        ('scan_self', 1, 'at_rear_left stays at 0.18 while others of its family change'),
    ],
)
def test_scanners_that_lie(run_occ, cases, tmp_path, bag, code, words):
    (tmp_path / 'scan.yaml').write_text(SCAN)
    found, out, err = run_occ(f'features check {cases / bag}.mcap {tmp_path}/scan.yaml')
    assert found == code
    assert words in err
    if bag == 'scan_blind_code':
        assert '0.0% can be judged' in out


def test_a_sensor_with_a_clock_of_its_own(run_occ, cases):
    _, _, err = run_occ(f'info {cases}/sensor_clock.mcap')
    assert '1.7e+09 s behind those of /odom: they are of two clocks' in err


def test_durations_where_log_times_say_nothing(run_occ, cases):
    code, out, err = run_occ(f'check {cases}/log0_bad.mcap -c {cases}/good.yaml')
    assert code == 1
    assert '6.050 to     7.500 s   1.450 s  R873b6' in out
    assert 'times are those of their header stamps' in err
