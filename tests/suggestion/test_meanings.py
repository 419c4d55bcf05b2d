# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
import math

import numpy as np
import pytest
from occ_constraints_pkg.suggestion.inspection import Series, identifier
from occ_constraints_pkg.suggestion.meanings import is_command, meaning_of, slides, words_of

WAVE = np.sin(np.arange(100) / 7)
RISING = np.arange(100.0)


def meaning(path, topic='/state', msgtype='demo_msgs/msg/State', values=WAVE, **kind):
    return meaning_of(path, topic, msgtype, Series([values], **kind))


@pytest.mark.parametrize(
    ('path', 'role'),
    [
        ('voltage_v', 'voltage'),
        ('power_v', 'voltage'),
        ('bms.soc', 'charge'),
        ('currentMotor', 'current'),
        ('motor[3].tau_est', 'effort'),
        ('cross_track_error', 'error'),
        ('heading_error', 'error'),
        ('yaw_rate', 'turn rate'),
        ('heading_rate', 'turn rate'),
        ('climb_speed', 'vertical speed'),
        ('longitudinal_velocity', 'speed'),
        ('body_height', 'height'),
        ('water.depth', 'height'),
        ('obstacle_distance', 'distance'),
        ('steering_tire_angle', 'angle'),
        ('temperature_fet', 'temperature'),
        ('something', 'number'),
    ],
)
def test_roles(path, role):
    assert (meaning(path).role, meaning(path).reason) == (role, '')


@pytest.mark.parametrize(
    ('path', 'reason'),
    [
        ('timestamp_sample', 'a time'),
        ('uptime', 'a time'),
        ('reset_counter', 'a counter'),
        ('seq', 'a counter'),
        ('energy_drawn', 'a counter'),
        ('serial', 'an identifier'),
        ('velocity_variance', 'the uncertainty'),
        ('latitude', 'a coordinate'),
        ('utm_easting', 'a coordinate'),
        ('heading', 'a coordinate'),
    ],
)
def test_what_is_no_feature_by_its_name(path, reason):
    assert meaning(path).reason.startswith(reason)


def test_what_is_no_feature_by_its_values():
    assert meaning('charge_used', values=RISING).reason.startswith('only rises')
    assert meaning('level_m', values=-RISING).reason.startswith('only falls')
    # A battery falls too, and is watched for it.
    assert meaning('voltage', values=-RISING).role == 'voltage'
    assert 'whole number' in meaning('amount', values=np.full(100, 7.0), is_integer=True).reason
    assert 'code or mode' in meaning('nav_state', values=RISING % 3, is_integer=True).reason
    assert 'switch' in meaning('armed', values=RISING % 2, is_flag=True).reason
    assert meaning('armed', topic='/cliff_sensor', values=RISING % 2, is_flag=True).role == 'flag'
    assert meaning('bumper_left', values=np.zeros(100), is_integer=True).role == 'flag'


def test_a_bare_number_is_named_by_its_topic():
    assert meaning('data', topic='/boat/cross_track_error').role == 'error'
    assert meaning('data', topic='/robot/depth').role == 'height'
    assert meaning('data', topic='/rudder/command').is_command


def test_commands():
    assert is_command('/cmd_vel')
    assert is_command('/mavros/setpoint_velocity/cmd_vel')
    assert not is_command('/odom')
    assert not is_command('/velocity')


def test_a_series():
    gaps = Series([np.array([1.0, math.nan, 3.0])])
    assert (gaps.low, gaps.high, gaps.is_constant) == (1.0, 3.0, False)
    none = Series([np.array([math.nan])])
    assert none.is_constant
    # It has to rise in each recording.
    assert Series([RISING, RISING]).only_rises
    assert not Series([RISING, RISING[::-1]]).only_rises


def test_words_and_identifiers():
    assert words_of('imuState/foot_force[2]') == ['imu', 'state', 'foot', 'force', '2']
    assert identifier('left/arm.joint-1') == 'left_arm_joint_1'
    assert identifier('6th') == 'n6th'


def test_a_flag_is_named_by_the_whole_topic():
    found = meaning('data', topic='/bumper/front', values=RISING % 2, is_flag=True)
    assert found.role == 'flag'


def test_joints_that_slide():
    assert slides('mast_lift')
    assert slides('left_finger_joint')
    assert not slides('shoulder_lift_joint')
    assert not slides('elbow_joint')


def test_what_an_error_is_of():
    assert meaning('feedback.error.positions[joint_names=j1]').role == 'error'
    assert meaning('satellites', topic='/gnss').role == 'reception'
    assert 'direction' in meaning('data', topic='/compass_hdg').reason
