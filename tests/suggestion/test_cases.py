# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Recordings made after reports on other people's tools: what is suggested, learned and checked."""

import json
import re

import pytest


def suggested(occ, bag, *more):
    """Return the names of the features that are suggested, the map, and what was warned of."""
    code, out, _ = occ(' '.join(['features suggest', str(bag), *map(str, more), '--json']))
    document = json.loads(out)
    names = [item['name'] for item in document['features']]
    assert code == (0 if names else 1)
    return names, document['map'], '\n'.join(document['warnings'])


def flagged(occ, first, second):
    """Suggest and learn from one recording, check another; return the shares and what was told."""
    occ(f'features suggest {first} -o map.yaml')
    assert occ(f'learn {first} -m map.yaml -o rules.yaml')[0] == 0
    _, out, err = occ(f'check {second} -c rules.yaml --json')
    document = json.loads(out) if out else {'shares': {}, 'violated_rules': []}
    return document['shares'], [item['text'] for item in document['violated_rules']], err


def test_the_robots_own_mast_sets_no_bound(occ, cases):
    names, text, told = suggested(occ, cases / 'scan_self.mcap')
    assert 'exclude_degrees: [[-133, -122], [117, 128]]' in text
    assert 'the scanner sees the robot itself there' in told
    assert len(names) == 8
    shares, rules, _ = flagged(occ, cases / 'scan_self.mcap', cases / 'scan_self_crash.mcap')
    assert shares['VIOLATED'] > 0.1
    assert any(text.startswith('any clearance below') for text in rules)


def test_ranges_beyond_the_largest_are_none(occ, cases):
    names, text, told = suggested(occ, cases / 'scan_blind_code.mcap')
    assert names == []
    assert '100% of the ranges of /scan lie above its range_max' in told
    assert 'clearance is not used: missing in 100% of the rows' in text


def test_angles_in_degrees_are_told(occ, cases):
    _, _, told = suggested(occ, cases / 'scan_degrees.mcap')
    assert 'as if its angles were in degrees' in told
    _, _, err = flagged(occ, cases / 'scan_train.mcap', cases / 'scan_degrees.mcap')
    assert 'allowed are radians' in err


def test_a_code_is_no_distance(occ, cases):
    _, text, told = suggested(occ, cases / 'scan_tiny.mcap')
    assert 'the range 0.001 m again and again' in told
    assert 'range_limits: [0.002, 10.0]' in text
    assert 'clip: [0, 1.0]' in text


def test_a_scan_without_directions_is_told_and_used(occ, cases):
    names, _, told = suggested(occ, cases / 'scan_inc0.mcap')
    assert names == ['clearance']
    assert 'angle_increment 0' in told


def test_constants_of_a_type_are_no_features(occ, cases):
    names, _, _ = suggested(occ, cases / 'constants.mcap')
    assert names == ['motor_temperature', 'motor_current']
    shares, _, _ = flagged(occ, cases / 'constants.mcap', cases / 'constants2.mcap')
    assert shares['VIOLATED'] == 0.0


def test_a_second_flight(occ, cases):
    names, text, _ = suggested(occ, cases / 'px4_flight1.mcap')
    assert {'altitude', 'tilt', 'speed', 'vertical_speed', 'battery_status_v1_voltage_v'} <= set(
        names
    )
    assert not [name for name in names if re.search('timestamp|counter|flag', name)]
    assert 'timestamp, timestamp_sample: a time, which no two recordings share' in text
    shares, _, _ = flagged(occ, cases / 'px4_flight1.mcap', cases / 'px4_flight2.mcap')
    assert shares['VIOLATED'] <= 0.02
    both = suggested(occ, cases / 'px4_flight1.mcap', cases / 'px4_flight2.mcap')
    assert both[0] == names


@pytest.mark.parametrize(
    ('bag', 'expected', 'never'),
    [
        (
            'arm',
            {'position_elbow', 'velocity_elbow', 'effort_elbow', 'ft_sensor_force'},
            'position_wrist_1$',
        ),
        ('float', {'cross_track_error'}, 'command'),
        (
            'go2',
            {'tilt', 'speed', 'lowstate_motor_state_0_tau_est', 'lowstate_power_v'},
            '_mode$|tick',
        ),
        (
            'create3',
            {'bump', 'cliff', 'stall', 'battery_voltage', 'wheel_status_current_ma_left'},
            'pwm',
        ),
        (
            'mavros',
            {'speed', 'tilt', 'height', 'battery_voltage', 'global_fix'},
            'command|latitude',
        ),
    ],
)
def test_what_robots_measure(occ, cases, bag, expected, never):
    names, _, _ = suggested(occ, cases / f'{bag}.mcap')
    assert expected <= set(names)
    assert not [name for name in names if re.search(never, name)]


def test_what_never_changes_is_named_with_its_reason(occ, cases):
    _, text, _ = suggested(occ, cases / 'go2.mcap')
    assert re.search(r'foot_force\[\.\.\.\][^:]*: a whole number that never changes', text)


def test_two_clocks_are_told(occ, cases):
    names, text, told = suggested(occ, cases / 'sensor_clock.mcap')
    assert {'speed', 'turn_rate', 'clearance_front'} <= set(names)
    assert 'the two have clocks of their own' in told
    assert 'age_by: arrival' in text


@pytest.mark.parametrize(
    ('bag', 'reason'),
    [
        ('cdr_le', "encoded as 'cdr_le'"),
        ('no_nul', 'does not end in a zero byte'),
        ('xcdr2', 'XCDR2'),
    ],
)
def test_the_true_reason_of_a_topic(occ, cases, bag, reason):
    names, text, _ = suggested(occ, cases / f'{bag}.mcap')
    assert names == []
    assert reason in ' '.join(line.lstrip('# ') for line in text.splitlines())


def test_an_included_definition_is_read(occ, cases):
    names, _, _ = suggested(occ, cases / 'pj851.mcap')
    assert names == ['cmd_steering_tire_angle', 'cmd_steering_tire_rotation_rate']
