# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
import math

import numpy as np
import pytest
from occ_constraints_pkg.datasets.clocks import ClockReadings, clock_warnings
from occ_constraints_pkg.datasets.extraction import extract
from occ_constraints_pkg.datasets.source_doubts import source_doubts
from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.features.doubts import value_doubts
from occ_constraints_pkg.features.extractor import FeatureExtractor
from occ_constraints_pkg.features.feature_map import FeatureMap
from occ_constraints_pkg.features.sources import FeatureSource
from occ_constraints_pkg.rosbag.recording import Recording
from occ_constraints_pkg.rules.space import Feature, FeatureSpace

SECOND = 10**9
WAVE = np.sin(np.arange(100) / 5.0)


def told(*columns):
    """Return the doubts about ``(unit, family, values)`` columns."""
    features = [
        Feature(f'f{number}', unit, family=family)
        for number, (unit, family, _) in enumerate(columns)
    ]
    values = np.column_stack([np.broadcast_to(item, 100) for *_, item in columns])
    return list(value_doubts(values.astype(np.float64), FeatureSpace(tuple(features))))


def test_nothing_is_told_of_what_is_usual():
    assert not told(('m', '', WAVE), ('rad', '', 3 * WAVE), ('rad/s', '', 5 * WAVE), ('1', '', 0.0))
    assert not list(value_doubts(np.ones((5, 1)), FeatureSpace((Feature('f', 'm'),))))


@pytest.mark.parametrize(
    ('column', 'sentence'),
    [
        (('m', '', 1.5), 'f0 is 1.5 in all 100 samples: it may be frozen'),
        (('rad/s', '', 45 * WAVE), 'f0 goes up to 45 rad/s: it may be in degrees per second'),
        (('rad', '', 90 * WAVE), 'f0 goes up to 90 rad: it may be in degrees'),
        (('rad', '', np.where(WAVE > 0, np.nan, 90 * WAVE)), 'f0 goes up to 90 rad'),
    ],
)
def test_values_that_are_not_what_they_should_be(column, sentence):
    (found,) = told(column)
    assert sentence in found


def test_a_member_of_a_family_that_stands_still():
    family = [('m', 'clear', 2 + WAVE), ('m', 'clear', 0.18 + WAVE / 1e4), ('m', 'clear', 3 - WAVE)]
    (found,) = told(*family)
    assert found.startswith('f1 stays at 0.18 while others of its family change')
    assert not told(*(('m', 'clear', 1.0),) * 3)


def warnings(**clocks):
    return list(
        clock_warnings(
            {
                topic: ClockReadings.of(
                    np.array(stamps, dtype=np.int64), np.array(times, dtype=np.int64)
                )
                for topic, (stamps, times) in clocks.items()
            }
        )
    )


def test_clocks():
    seconds = np.arange(1, 11) * SECOND
    assert not warnings(
        a=(seconds, seconds + 7), b=(seconds - 5, seconds), c=(seconds * 0, seconds)
    )
    (found,) = warnings(a=(seconds, seconds), b=(seconds, seconds + 100 * SECOND))
    assert 'the stamps of b are 100 s behind those of a' in found
    assert 'age_by: arrival' in found
    back = seconds[[0, 1, 2, 1, 4, 5, 6, 7, 8, 9]]
    assert 'go back 1 times' in warnings(a=(back, seconds))[0]
    leap = seconds + np.where(seconds > 5 * SECOND, 400 * 86_400 * SECOND, 0)
    assert any('leap ahead by 400 days' in item for item in warnings(a=(leap, seconds)))
    assert 'logged in bursts' in warnings(a=(seconds, seconds // (5 * SECOND)))[-1]
    assert 'its clock stands still' in warnings(a=(seconds // (5 * SECOND) + 1, seconds))[0]


def scans(messages, write_bag, ranges, **options):
    return write_bag(
        [
            ('/scan', messages.scan(ranges, stamp_ns=(tick + 1) * SECOND, **options), tick * SECOND)
            for tick in range(5)
        ]
    )


SCAN = FeatureMap(
    'scan', 0.5, (FeatureSource('d', 'scan', 'ranges', reduce='min', missing='max_range'),)
)


def test_ranges_that_are_codes(messages, write_bag):
    bag = scans(messages, write_bag, [65.533, 0.001, 2.0, math.inf])
    above, below = source_doubts(Recording(bag), SCAN)
    assert '33.3% of the ranges of /scan that are numbers are above its range_max' in above
    assert '33.3% of the ranges of /scan that are numbers are below its range_min' in below


def test_extraction_tells_why_a_feature_is_missing(messages, write_bag):
    entries = []
    for tick in range(8):
        time = 1000 * SECOND + tick * SECOND
        entries.append(('/odom', messages.odometry(stamp_ns=time), time))
        entries.append(('/scan', messages.scan([1.0], stamp_ns=(tick + 1) * SECOND), time))
    features = (*SCAN.features, FeatureSource('x', 'odom', 'twist.twist.linear.x'))
    data = extract([write_bag(entries)], FeatureMap('scan', 0.5, features))
    assert np.isnan(data.values[:, 1]).all()
    assert any('are of two clocks' in item for item in data.warnings)


def test_a_leap_of_the_clock_is_told(messages, write_bag):
    year = 365 * 86_400 * SECOND
    entries = [
        ('/scan', messages.scan([1.0], stamp_ns=tick * SECOND + (tick > 2) * year), tick * SECOND)
        for tick in range(1, 6)
    ]
    (warning,) = extract([write_bag(entries)], SCAN).warnings
    assert 'the stamps leap ahead by 365 days after 1 s' in warning


@pytest.mark.parametrize(
    ('first', 'step', 'sentence'),
    [
        (-180.0, 5.0, 'within one turn or little more; these look like degrees'),
        (0.0, 1.0, 'these look like degrees'),
        (0.0, 0.0, 'angle_increment 0, which all point the same way'),
    ],
)
def test_angles_that_are_none(messages, first, step, sentence):
    wanted = FeatureMap(
        'scan', 0.5, (FeatureSource('d', 'scan', 'ranges', reduce='min', degrees=(-10.0, 10.0)),)
    )
    scan = messages.scan(np.ones(72), first=first, step=step)
    with pytest.raises(OccError, match=sentence):
        FeatureExtractor(wanted).push('scan', scan, 0)
