# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Suggested on one drive and learned from it, a map knows the next drive, and every fault."""

import re

import numpy as np
import pytest
from occ_constraints_pkg.rosbag.recording import Recording
from occ_constraints_pkg.suggestion.suggest import suggest

from experiments.any_robot import TOLERATED, suggested_maps, try_kind
from experiments.robot_kinds import ROBOTS, write_robot

# The others take longer together than a test may.
QUICK = ('px4', 'car', 'racecar', 'boat')
KINDS = [pytest.param(kind, marks=() if kind in QUICK else pytest.mark.slow) for kind in ROBOTS]


@pytest.mark.parametrize('kind', KINDS)
def test_the_next_drive_and_faults(tmp_path, kind):
    found = try_kind(tmp_path, kind, (1, 2, 3), 120.0)
    assert found['maps'] == (2 if kind == 'two_robots' else 1)
    assert np.mean(found['flagged']) <= TOLERATED, found
    assert max(found['unknown']) <= TOLERATED
    assert set(found['told'].values()) == {1.0}, found['told']


def test_no_clock_counter_or_code_is_used(tmp_path):
    """Of no robot; and each thing left out has its reason."""
    never = re.compile(
        r'timestamp|uptime|sequence|seq|tick|crc|counter|_id\b|mode|state_nav|latitude|longitude'
        r'|setpoint|cycle|energy|charge_drawn|displacement|distance_traveled|covariance'
    )
    for kind in ('px4', 'racecar', 'auv', 'boat'):
        bag = write_robot(tmp_path, kind, 1, seconds=30.0)
        (feature_map,) = suggested_maps(bag)
        assert not [item for item in feature_map.features if never.search(str(item.field))]
        assert all(reason for _, reason in suggest(Recording(bag)).unused)


def test_too_short_a_drive_is_told(tmp_path):
    """How far a quantity goes is not known after a few movements, and is after many."""
    short, long = (
        ' '.join(suggest(Recording(write_robot(tmp_path, 'arm', 1, seconds=length))).warnings)
        for length in (10.0, 300.0)
    )
    assert 'go to and fro too seldom to know how far: record longer' in short
    assert 'too seldom' not in long
