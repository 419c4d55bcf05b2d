# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""What the monitor doubts of its sensors, in the words of ``occ features check``."""

import numpy as np
import pytest

pytest.importorskip('rclpy', reason="needs the extra 'ros'")

from occ_constraints_pkg.features.extractor import FeatureExtractor
from occ_constraints_pkg.features.feature_map import FeatureMap
from occ_constraints_pkg.nodes.monitor.sensor_doubts import SensorDoubts

SECOND = 10**9
MAP = {
    'schema_version': 1,
    'pace': 'odom',
    'max_age': 5.0,
    'features': [
        {'name': 'speed', 'topic': 'odom', 'field': 'twist.twist.linear.x', 'unit': 'm/s'},
        {
            'name': 'clearance',
            'topic': 'scan',
            'field': 'ranges',
            'sectors': 2,
            'reduce': 'min',
            'missing': 'max_range',
            'unit': 'm',
            'bounds': [0, 10],
        },
    ],
}


def looked(messages, speeds, scans):
    """Return what is doubted after each second, of one speed and one scan in each."""
    feature_map = FeatureMap.from_document(MAP, 'map')
    extractor, doubts = FeatureExtractor(feature_map), SensorDoubts(feature_map, 10)
    told, newest = [], {}
    for step, (speed, ranges) in enumerate(zip(speeds, scans, strict=True)):
        now = (step + 1) * SECOND
        newest = {
            'scan': messages.scan(ranges, stamp_ns=now, step=np.pi / 4),
            'odom': messages.odometry(stamp_ns=now, x=speed),
        }
        for topic, message in newest.items():
            extractor.push(topic, message, now)
        told.append(list(doubts.look(*extractor.newest(), newest)))
    return told


def moving(count):
    return [np.full(8, 2.0) + step / 100 + np.arange(8) / 10 for step in range(count)]


def test_a_frozen_value_is_told_after_a_while(messages):
    told = looked(messages, [0.1, 0.2] + [0.3] * 12 + [0.4, 0.5], moving(16))
    assert not any(told[:11])
    assert told[11] == ['speed is 0.3 in all 10 samples: it may be frozen']
    assert told[13] == ['speed is 0.3 in all 12 samples: it may be frozen']
    assert not any(told[14:])


def test_rest_is_not_frozen(messages):
    assert not any(looked(messages, [0.0] * 20, moving(20)))


def test_a_still_member_of_a_family(messages):
    scans = [np.array([0.18] * 2 + [2.0 + step / 100] * 6) for step in range(20)]
    told = looked(messages, np.arange(20) / 100, scans)
    assert not any(told[:9])
    (sentence,) = told[-1]
    assert sentence.startswith('clearance_')
    assert 'stays at 0.18 while others of its family change' in sentence
    # All of them together are a robot that stands still.
    assert not any(looked(messages, np.arange(20) / 100, [np.full(8, 1.0)] * 20))


def test_codes_among_ranges(messages):
    scans = [*moving(3), *([np.array([65.533, *ranges[1:]]) for ranges in moving(5)])]
    told = looked(messages, np.arange(8) / 100, scans)
    assert not any(told[:3])
    assert told[3] == [
        '3.1% of the ranges of scan that are numbers are above its range_max: they may be codes, '
        'not distances; range_limits says which count'
    ]
