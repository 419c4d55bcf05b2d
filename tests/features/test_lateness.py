# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Lateness: a backlog is late; another clock, a recording and a simulation are not."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from occ_constraints_pkg.datasets.extraction import extract, rows_of
from occ_constraints_pkg.documents import parse_yaml
from occ_constraints_pkg.features.extractor import FeatureExtractor
from occ_constraints_pkg.features.feature_map import FeatureMap
from occ_constraints_pkg.features.lateness import Lateness
from occ_constraints_pkg.rosbag.recording import Recording
from synthetic_bags import ROVER_MAP, write_rover

SECOND = 10**9
NOW = 1_750_000_000 * SECOND
LIMIT = SECOND
DAY = 86_400.0


def lags(times, *, live=True, offset=0.0, rate=1.0, delay=lambda _: 0.0, under_way=lambda _: 0.0):
    """Return the lags in s of messages that are published at these times, in s.

    Args:
        times: when each would be published if nothing delayed it.
        live: whether it is known when it was published.
        offset: of the system's clock from that of the stamps.
        rate: how fast the latter runs.
        delay: time to delay in s until it is published.
        under_way: likewise from there to the arrival.
    """
    lateness, found = Lateness(LIMIT), []
    for time in times:
        stamp = NOW + round((time * rate - offset) * SECOND)
        published = NOW + round((time + delay(time)) * SECOND)
        arrival = published + round(under_way(time) * SECOND)
        sent = (published, arrival - NOW) if live else (arrival,)
        found.append(lateness.lag_ns(stamp, *sent) / SECOND)
    return np.array(found)


TEN = np.arange(0.0, 10.0, 0.1)


@pytest.mark.parametrize('live', [True, False])
@pytest.mark.parametrize('offset', [-0.5, 0.0, 5.0, 40.0, 3600.0])
def test_a_backlog_is_late_whatever_the_clocks(live, offset):
    if live and offset == 5.0:
        pytest.skip('then all of it is late, see below')
    found = lags(TEN, live=live, offset=offset, delay=lambda time: 5.0 if time > 4.0 else 0.0)
    assert (found[TEN <= 4.0] < 0.1).all()
    assert found[TEN > 4.0] == pytest.approx(5.0, abs=0.6)
    # One that grows is late as soon as it is longer than allowed, and until it is gone.
    found = lags(
        TEN, live=live, offset=offset, delay=lambda time: np.clip(time - 3.0, 0, 2) * (time < 8)
    )
    assert ((found > 1.0) == ((TEN > 4.05) & (TEN < 8.0))).all()


def test_what_is_old_when_it_is_published_is_late_from_the_first_on():
    assert lags(TEN, offset=10.0) == pytest.approx(10.0)
    assert lags(TEN, offset=0.4) == pytest.approx(0.4)
    # Without a source time it may as well be the clock.
    assert lags(TEN, offset=10.0, live=False) == pytest.approx(0.0, abs=1e-3)


def test_what_is_long_under_way_is_late_with_a_stamp_or_without():
    under_way = {'under_way': lambda time: 2.0 if time > 4.0 else 0.3}
    for offset in (0.0, 3600.0, 2 * DAY, -3 * DAY):
        assert ((lags(TEN, offset=offset, **under_way) > 1.0) == (TEN > 4.0)).all()
    lateness = Lateness(LIMIT)
    assert lateness.lag_ns(None, NOW, 7) == 0
    assert lateness.lag_ns(None, NOW + SECOND, 7 + 4 * SECOND) == pytest.approx(3 * SECOND, abs=4e6)


@given(
    offset=st.floats(16.0, 1e9) | st.floats(-1e9, 0.0),
    jitter=st.lists(st.floats(0.0, 0.4), min_size=50, max_size=100),
    live=st.booleans(),
)
def test_another_clock_is_never_late(offset, jitter, live):
    times = np.arange(len(jitter)) * 0.1
    found = lags(times, live=live, offset=offset, delay=dict(zip(times, jitter, strict=True)).get)
    assert (found <= 0.41).all()


@pytest.mark.parametrize('live', [True, False])
@pytest.mark.parametrize('rate', [0.01, 0.5, 0.73, 0.9, 1.0, 1.1, 10.0])
def test_simulations_and_old_recordings_run_at_any_rate_and_pause(live, rate):
    times = np.concatenate([TEN, TEN + 40.0, TEN + 50.1])
    stamps = np.concatenate([TEN, TEN + 10.0, TEN + 20.0]) * rate
    for offset in (2 * DAY, NOW / SECOND, -2 * DAY):
        lateness = Lateness(LIMIT)
        for time, stamp in zip(times, stamps, strict=True):
            published = NOW + round(time * SECOND)
            sent = (published, published) if live else (published,)
            assert lateness.lag_ns(NOW + round((stamp - offset) * SECOND), *sent) < 0.1 * SECOND


@pytest.mark.parametrize('rate', [0.25, 0.5, 0.9, 2.0])
def test_a_recording_of_today_that_is_played_at_another_rate_is_not_late(rate):
    assert (lags(np.arange(0.0, 60.0, 0.1), offset=600.0, rate=rate) < 0.3).all()


def test_a_clock_that_is_set_back_and_clocks_that_drift_apart_are_not_late():
    lateness = Lateness(LIMIT)
    for time in TEN:
        at = NOW + round(time * SECOND)
        stamp = at - (3 * SECOND if time > 4.0 else 0)
        assert lateness.lag_ns(stamp, at, at) < 0.1 * SECOND
    # Half a millisecond per second, for three hours.
    assert (lags(np.arange(0.0, 10_800.0, 1.0), offset=100.0, rate=0.9995) < 0.1).all()


def test_a_published_clock_that_is_set_back_is_no_delay():
    lateness = Lateness(LIMIT)
    for time in TEN:
        at = round(time * SECOND)
        published = NOW + at - (5 * SECOND if time > 4.0 else 0)
        assert lateness.lag_ns(published, published, at) == 0


@pytest.mark.parametrize('pace', ['/scan', '/cmd_vel', '{rate: 8}'])
@pytest.mark.parametrize('ahead', [0.0, 3600.0])
def test_a_recorded_backlog_gives_no_values_by_blocks_and_one_by_one(tmp_path, pace, ahead):
    bag = write_rover(tmp_path / 'rover', backlog=5.0, ahead=ahead)
    text = ROVER_MAP.replace('pace: /scan', f'pace: {pace}')
    feature_map = FeatureMap.from_document(parse_yaml(text, 'map'), 'map')
    data = extract([bag], feature_map, max_lag=1.0)
    extractor = FeatureExtractor(feature_map, 1.0)
    rows = [item for item in rows_of(Recording(bag), extractor) if not item.repeat]
    one_by_one = np.concatenate([item.values for item in rows])
    assert one_by_one.tobytes() == data.values.tobytes()
    is_late = np.array([item.note.endswith(' s late; allowed is 1 s, by max_lag') for item in rows])
    assert is_late[data.times_ns > 12.2 * SECOND].all()
    assert not is_late[data.times_ns < 11 * SECOND].any()
    assert np.isnan(data.values[is_late]).all()
    # But for these rows it is as if nobody had looked.
    anything = extract([bag], feature_map)
    assert anything.values[~is_late].tobytes() == data.values[~is_late].tobytes()
    assert np.isfinite(anything.values[is_late]).any()


def test_recordings_of_robots_and_simulations_are_never_late(robots):
    for bag in robots.iterdir():
        for pace in ('scan', 'odom', 'cmd_vel'):
            feature_map = FeatureMap.from_document(
                {
                    'schema_version': 1,
                    'pace': pace,
                    'max_age': 0.5,
                    'features': [
                        {'name': 'v', 'topic': 'odom', 'field': 'twist.twist.linear.x'},
                        {'name': 'c', 'topic': 'scan', 'field': 'ranges[:]', 'reduce': 'max'},
                    ],
                },
                'map',
            )
            # A thirtieth of what is allowed by default.
            values = extract([bag], feature_map, max_lag=0.03, provenance=False).values
            anything = extract([bag], feature_map, provenance=False).values
            assert values.tobytes() == anything.tobytes()
