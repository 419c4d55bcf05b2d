# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
import math

import pytest
from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.features.feature_map import FeatureMap
from occ_constraints_pkg.features.sources import FeatureSource
from occ_constraints_pkg.rosbag.recording import Recording
from occ_constraints_pkg.suggestion.statistics import map_statistics
from occ_constraints_pkg.suggestion.text import describe_statistics, statistics_document

SECOND = 10**9
MAP = FeatureMap(
    'scan',
    0.3,
    (
        FeatureSource('d', 'scan', 'ranges', unit='m', low=0.0, high=3.0, reduce='min'),
        FeatureSource('v', 'odom', 'twist.twist.linear.x', unit='m/s'),
        FeatureSource('a', 'odom', 'twist.twist.linear.x', transform='rate'),
        FeatureSource('w', 'odom', 'twist.twist.angular.z'),
    ),
)


def write(messages, write_bag):
    """Ten scans in a second; odometry from the second to the fifth, one range too far."""
    entries = []
    for step in range(10):
        now = SECOND + step * SECOND // 10
        if 1 <= step < 5:
            message = messages.odometry(stamp_ns=now, x=0.1 * step, wz=0.25)
            entries.append(('/odom', message, now))
        distance = {2: 3.5, 3: math.inf}.get(step, 1.0 + step / 10)
        entries.append(('/scan', messages.scan([distance], stamp_ns=now), now + 1))
    return Recording(write_bag(entries))


def test_what_a_map_yields(messages, write_bag):
    calls = []
    seen = map_statistics(
        write(messages, write_bag), MAP, progress=lambda done, total: calls.append((done, total))
    )
    assert calls[-1] == (14, 14)
    assert (seen.rows, seen.clock_jumps, seen.has_problem) == (10, 0, True)
    assert seen.duration_s == pytest.approx(0.9)
    assert seen.usable == pytest.approx(0.4)
    d, v, a, w = seen.features
    assert (d.low, d.median, d.high) == pytest.approx((1.0, 1.55, 1.9))
    assert (d.missing, d.outside, d.stale) == (0.1, 0.1, 0.0)
    assert d.first_problem == '0.20 s: 3.5 is outside the bounds [0, 3]'
    # The odometry of 0.4 s is held until 0.7 s.
    assert (v.missing, v.stale) == pytest.approx((0.3, 0.3))
    assert v.first_problem == '0.00 s: no message on odom yet'
    assert (v.is_constant, v.is_problem) == (False, True)
    assert a.missing == pytest.approx(0.4)
    assert (a.low, a.high) == pytest.approx((1.0, 1.0))
    assert w.is_constant
    assert w.longest_still_s == pytest.approx(0.7)


def test_as_text_and_as_json(messages, write_bag):
    seen = map_statistics(write(messages, write_bag), MAP)
    text = describe_statistics(seen, 'bag', 'scan')
    assert text.startswith('bag: 10 rows in 0.9 s, triggered by scan; 40.0% can be judged')
    assert 'no message on odom yet' in text
    assert 'never changes' in text
    document = statistics_document(seen)
    assert [item['name'] for item in document['features']] == ['d', 'v', 'a', 'w']
    assert document['features'][0]['first_problem'].endswith('[0, 3]')
    assert document['features'][1]['is_problem']


def test_a_feature_that_never_comes(messages, write_bag):
    bag = Recording(write_bag([('/scan', messages.scan([math.nan], stamp_ns=5), 5)]))
    seen = map_statistics(bag, FeatureMap('scan', 1.0, MAP.features[:1]))
    assert seen.features[0].missing == 1.0
    assert seen.features[0].first_problem == '0.00 s: nothing was measured'
    assert statistics_document(seen)['features'][0]['median'] is None
    assert seen.has_problem


def test_time_that_goes_back(messages, write_bag):
    entries = [
        ('/scan', messages.scan([1.0 + step], stamp_ns=(9 - step) * SECOND), step)
        for step in range(3)
    ]
    seen = map_statistics(Recording(write_bag(entries)), FeatureMap('scan', 1.0, MAP.features[:1]))
    assert seen.clock_jumps == 2
    assert seen.has_problem
    assert 'stamps jump back 2 times' in describe_statistics(seen, 'bag', 'scan')


def test_rest_is_no_problem(messages, write_bag):
    """A bumper that never fired and a scene that is always open are as they should be."""
    entries = [
        ('/odom', messages.odometry(stamp_ns=step + 1, x=0.0, wz=3.0), step) for step in range(5)
    ]
    features = (
        FeatureSource('bump', 'odom', 'twist.twist.linear.x'),
        FeatureSource('open', 'odom', 'twist.twist.angular.z', high=3.0),
    )
    assert not map_statistics(
        Recording(write_bag(entries)), FeatureMap('odom', 1.0, features)
    ).has_problem


def test_no_row(messages, write_bag):
    recording = Recording(write_bag([('/odom', messages.odometry(), 1)]))
    with pytest.raises(OccError, match="no topic 'scan'"):
        map_statistics(recording, MAP)
