# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
import math

import numpy as np
import pytest
from occ_constraints_pkg.datasets.extraction import extract
from occ_constraints_pkg.features.extractor import FeatureExtractor
from occ_constraints_pkg.features.feature_map import FeatureMap
from occ_constraints_pkg.features.sources import FeatureSource, Reading

SECOND = 10**9
NAN = math.nan


def one(**keys):
    keys = {'topic': 'odom', 'field': 'twist.twist.linear.x'} | keys
    return FeatureMap('odom', 0.5, (FeatureSource('f', **keys),))


def rates(messages, steps, feature_map=None):
    """Push ``(stamp in s, value)`` and return the feature of each row."""
    extractor = FeatureExtractor(feature_map or one(transform='rate'))
    found = []
    for stamp, value in steps:
        message = messages.odometry(stamp_ns=round(stamp * SECOND), x=value)
        found.append(extractor.push('odom', message, 7).values[0, 0])
    return found


@pytest.mark.parametrize(
    ('steps', 'expected'),
    [
        ([('abs',)], [3.0, NAN, -math.inf, 7.0]),
        ([('scale', 2.0), ('offset', 1.0)], [-5.0, NAN, -math.inf, 15.0]),
        ([('offset', 1.0), ('scale', 2.0)], [-4.0, NAN, -math.inf, 16.0]),
        # What is not finite is a fault, which neither a clip nor rounding may hide.
        ([('clip', -1.0, 5.0)], [-1.0, NAN, -math.inf, 5.0]),
        ([('clip', -math.inf, 5.0)], [-3.0, NAN, -math.inf, 5.0]),
        ([('round', 2.0)], [-4.0, NAN, -math.inf, 8.0]),
    ],
)
def test_steps_without_memory(messages, steps, expected):
    found = rates(
        messages,
        [(1, -3.0), (2, NAN), (3, -math.inf), (4, 7.0)],
        one(transform=tuple(steps)),
    )
    expected = [math.inf if steps == [('abs',)] and x == -math.inf else x for x in expected]
    np.testing.assert_equal(found, expected)


def test_rounding_knows_no_negative_zero(messages):
    value = rates(messages, [(1, -0.001)], one(transform=(('round', 0.01),)))[0]
    assert math.copysign(1.0, value) == 1.0


def test_rate_from_start_to_gap(messages):
    steps = [(1.0, 0.0), (1.5, 1.0), (1.75, 1.0), (2.5, 5.0), (2.75, 6.0)]
    # First row; change over half a second; no change; a gap of more than 0.5 s; change again.
    np.testing.assert_equal(rates(messages, steps), [NAN, 2.0, 0.0, NAN, 4.0])


def test_rate_when_the_clock_goes_back(messages):
    np.testing.assert_equal(
        rates(messages, [(9.0, 0.0), (9.5, 1.0), (1.0, 2.0), (1.25, 3.0)]), [NAN, 2.0, NAN, 4.0]
    )


def test_rate_under_the_same_stamp(messages):
    steps = [(1.0, 0.0), (1.5, 1.0), (1.5, 1.0), (1.5, 2.0), (2.0, 3.0)]
    # The same again keeps its rate; other values under the same stamp have none.
    np.testing.assert_equal(rates(messages, steps), [NAN, 2.0, 2.0, NAN, 2.0])


def test_rate_after_a_missing_value(messages):
    np.testing.assert_equal(
        rates(messages, [(1.0, 0.0), (1.25, NAN), (1.5, 1.0), (1.75, 2.0)]), [NAN, NAN, NAN, 4.0]
    )


def test_rate_of_an_angle_takes_the_short_way(messages):
    feature_map = one(field='pose.pose.orientation', transform=('rate',), reduce='yaw')
    extractor = FeatureExtractor(feature_map)
    found = []
    for stamp, yaw in ((1.0, 3.1), (1.5, -3.1), (2.0, 3.1)):
        orientation = messages.quaternion(0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2))
        message = messages.odometry(stamp_ns=round(stamp * SECOND), orientation=orientation)
        found.append(extractor.push('odom', message, 7).values[0, 0])
    turn = 2 * (2 * math.pi - 6.2)
    assert found[1:] == pytest.approx([turn, -turn])


def test_rate_of_a_held_value_goes_by_its_own_stamps(messages):
    feature_map = FeatureMap(
        'scan', 1.0, (FeatureSource('f', 'odom', 'twist.twist.linear.x', transform='rate'),)
    )
    extractor = FeatureExtractor(feature_map)

    def row(stamp):
        scan = messages.scan([1.0], stamp_ns=round(stamp * SECOND))
        return extractor.push('scan', scan, 0).values[0, 0]

    def odometry(stamp, x):
        extractor.push('odom', messages.odometry(stamp_ns=round(stamp * SECOND), x=x), 0)

    found = [row(1.0)]
    odometry(1.1, 0.0)
    found.append(row(1.2))
    odometry(1.3, 9.0)
    odometry(1.6, 1.0)
    found.append(row(1.7))
    # Nothing new came: the rate is held with its value, until that is too old.
    found.append(row(2.5))
    found.append(row(2.7))
    np.testing.assert_equal(found, [NAN, NAN, 2.0, 2.0, NAN])


def test_rate_without_stamps_goes_by_rows(messages):
    feature_map = FeatureMap(
        'scan', 1.0, (FeatureSource('f', 'cmd', 'linear.x', transform='rate'),)
    )
    extractor = FeatureExtractor(feature_map)
    found = []
    for stamp, x in ((1.0, 0.0), (1.5, 1.0), (1.75, 1.0)):
        extractor.push('cmd', messages.twist(x=x), 0)
        scan = messages.scan([1.0], stamp_ns=round(stamp * SECOND))
        found.append(extractor.push('scan', scan, 0).values[0, 0])
    np.testing.assert_equal(found, [NAN, 2.0, 0.0])


def test_rate_of_a_table_starts_anew_with_each_episode(messages):
    feature_map = FeatureMap('t', 1.0, (FeatureSource('f', 't', column='a', transform='rate'),))
    extractor = FeatureExtractor(feature_map)

    def row(stamp, *rows):
        table = messages.table(['a', 'episode'], np.array(rows), stamp_ns=round(stamp * SECOND))
        return extractor.push('t', table, 0).values[:, 0].tolist()

    np.testing.assert_equal(row(1.0, [0.0, 0], [5.0, 0]), [NAN, NAN])
    np.testing.assert_equal(row(1.5, [1.0, 0], [0.0, 1]), [2.0, NAN])
    np.testing.assert_equal(row(2.0, [2.0, 0], [1.0, 1]), [2.0, 2.0])
    # Another number of robots.
    np.testing.assert_equal(row(2.5, [3.0, 0]), [NAN])


def test_difference_of_two_topics(messages):
    feature_map = FeatureMap(
        'odom',
        0.5,
        (
            FeatureSource(
                'slip',
                'cmd',
                'linear.x',
                minus=Reading('odom', 'twist.twist.linear.x'),
                transform='abs',
            ),
            FeatureSource(
                'off',
                'odom',
                'pose.pose.orientation',
                reduce='yaw',
                minus=Reading('imu', 'orientation', reduce='yaw'),
            ),
        ),
    )
    extractor = FeatureExtractor(feature_map)

    def heading(yaw):
        return messages.quaternion(0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2))

    def row(arrival):
        message = messages.odometry(x=0.5, orientation=heading(3.0))
        return extractor.push('odom', message, arrival).values[0]

    np.testing.assert_equal(row(0), [NAN, NAN])
    extractor.push('cmd', messages.twist(x=0.2), 0)
    extractor.push('imu', messages.imu(heading(-3.0)), 0)
    # Angles differ by the short way round.
    assert row(0) == pytest.approx([0.3, 6.0 - 2 * math.pi])
    np.testing.assert_equal(row(SECOND), [NAN, NAN])


def test_a_fixed_rate(messages):
    feature_map = FeatureMap(
        '',
        0.5,
        (
            FeatureSource('d', 'scan', 'ranges', reduce='min'),
            FeatureSource('v', 'odom', 'twist.twist.linear.x'),
            FeatureSource('c', 'cmd', 'linear.x'),
        ),
        rate=10.0,
    )
    extractor = FeatureExtractor(feature_map)

    def scan(stamp, d):
        message = messages.scan([d], stamp_ns=round(stamp * SECOND))
        return extractor.push('scan', message, 5 * SECOND)

    def odometry(stamp, v):
        return extractor.push('odom', messages.odometry(stamp_ns=round(stamp * SECOND), x=v), 0)

    # The first message in each tenth of a second gives a row.
    rows = scan(1.0, 3.0)
    assert rows.stamp_ns == SECOND
    np.testing.assert_equal(rows.values, [[3.0, NAN, NAN]])
    assert odometry(1.04, 0.1) is None
    assert scan(1.08, 2.0) is None
    assert odometry(1.11, 0.2).values.tolist()[0][:2] == [2.0, 0.2]
    # Stamps of two topics are not in order, and a message without one does not tell the time.
    assert scan(1.09, 1.0) is None
    assert extractor.push('cmd', messages.twist(x=0.7), 5 * SECOND) is None
    assert scan(1.2, 4.0).values.tolist() == [[4.0, 0.2, 0.7]]
    np.testing.assert_equal(odometry(2.0, 0.3).values[0, :2], [NAN, 0.3])
    # A clock that was set back: nothing of that row can be relied on, what follows can.
    rows = odometry(0.3, 0.4)
    assert rows.note == 'time went back by 1.7 s'
    assert np.isnan(rows.values).all()
    assert odometry(0.35, 0.5) is None
    np.testing.assert_equal(odometry(0.41, 0.6).values[0, :2], [NAN, 0.6])


def test_a_fixed_rate_without_any_stamp(messages):
    feature_map = FeatureMap('', 0.5, (FeatureSource('c', 'cmd', 'linear.x'),), rate=10.0)
    extractor = FeatureExtractor(feature_map)
    times = [0.0, 0.05, 0.1, 0.4]
    rows = [
        extractor.push('cmd', messages.twist(x=x), round(time * SECOND))
        for x, time in enumerate(times)
    ]
    assert [None if row is None else row.values[0, 0] for row in rows] == [0.0, None, 2.0, 3.0]


EVERYTHING = [
    {'topic': 'scan', 'field': 'ranges', 'sectors': 6, 'reduce': 'min', 'missing': 'max_range'},
    {'topic': 'scan', 'field': 'ranges', 'sectors': 3, 'reduce': 'max', 'missing': 'drop'},
    {'topic': 'scan', 'field': 'ranges', 'degrees': [-9, 99], 'reduce': 'mean', 'missing': 'drop'},
    {'topic': 'scan', 'field': 'ranges', 'degrees': [170, 350], 'reduce': 'mean'},
    {'topic': 'scan', 'field': 'ranges', 'degrees': [-90, 90], 'reduce': 'norm'},
    {'topic': 'scan', 'field': 'ranges[0:4]|min', 'missing': 'drop'},
    {'topic': 'scan', 'field': 'ranges[2]', 'missing': 'drop'},
    {'topic': 'odom', 'field': 'twist.twist.linear.x', 'transform': ['rate', {'round': 0.1}]},
    {'topic': 'odom', 'field': 'pose.pose.orientation|yaw|rate|abs'},
    {
        'topic': 'cmd',
        'field': 'linear.x',
        'minus': {'topic': 'odom', 'field': 'twist.twist.linear.x'},
        'transform': [{'clip': [-0.1, 0.1]}, 'rate'],
    },
    {'topic': 'odom', 'field': 'twist.twist.linear|norm', 'transform': [{'scale': 3.6}]},
]


@pytest.mark.parametrize('pace', ['scan', 'odom', {'rate': 7.0}])
@pytest.mark.parametrize('skip', [(), (7, 8, 9)])
def test_a_recording_gives_the_bits_of_live_topics(messages, write_bag, pace, skip):
    """By blocks, message by message and live: the same rows; the second without a rate."""
    rng = np.random.default_rng(3)
    entries, stamp = [], SECOND
    for number in range(400):
        stamp += int(rng.integers(1, SECOND // 20))
        if number == 250:
            stamp -= 5 * SECOND // 2
        kind = rng.integers(4)
        if kind == 0:
            ranges = rng.uniform(0.1, 4.0, 24)
            ranges[rng.random(24) < 0.5] = rng.choice([0.0, np.inf, np.nan, -np.inf])
            # The geometry changes on the way.
            scan = messages.scan(ranges, stamp_ns=stamp, step=0.27 if number < 200 else -0.27)
            entries.append(('/scan', scan, stamp))
        elif kind == 1:
            entries.append(('/cmd', messages.twist(x=rng.normal()), stamp))
        else:
            yaw = rng.uniform(-4, 4)
            orientation = messages.quaternion(0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2))
            # Now and then a stamp comes twice, with other values or the same.
            back = int(rng.integers(0, 2)) * int(rng.integers(0, SECOND // 30))
            x = round(rng.normal(), 1)
            message = messages.odometry(stamp_ns=stamp - back, x=x, orientation=orientation)
            entries.append(('/odom', message, stamp))
            if rng.random() < 0.1:
                entries.append(('/odom', message, stamp + 1))
    document = {
        'schema_version': 1,
        'pace': pace,
        'max_age': 0.2,
        'features': [
            {'name': f'f{place}', **keys}
            for place, keys in enumerate(EVERYTHING)
            if place not in skip
        ],
    }
    feature_map = FeatureMap.from_document(document, 'map')
    data = extract([write_bag(entries)], feature_map)
    extractor = FeatureExtractor(feature_map)
    # A recording yields its messages by the time of logging.
    rows = [extractor.push(*entry) for entry in sorted(entries, key=lambda entry: entry[2])]
    rows = [item for item in rows if item is not None and not item.repeat]
    live = np.concatenate([item.values for item in rows])
    assert data.stamps_ns.tolist() == [item.stamp_ns for item in rows]
    assert data.values.tobytes() == live.tobytes()
    assert (np.isfinite(live).mean(axis=0) > 0.05).all()
