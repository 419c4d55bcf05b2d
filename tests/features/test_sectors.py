# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Sectors of a scan, by angle."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.features.extractor import FeatureExtractor
from occ_constraints_pkg.features.feature_map import FeatureMap
from occ_constraints_pkg.features.reductions import sector_beams
from occ_constraints_pkg.features.sources import Reading

TURN = 2.0 * math.pi


def sectors(message, count, **keys):
    document = {
        'schema_version': 1,
        'pace': 'scan',
        'max_age': 1.0,
        'features': [
            {'name': 'd', 'topic': 'scan', 'field': 'ranges', 'sectors': count, 'reduce': 'min'}
            | keys
        ],
    }
    feature_map = FeatureMap.from_document(document, 'map')
    values = FeatureExtractor(feature_map).push('scan', message, 1).values[0]
    return dict(zip((name[2:] for name in feature_map.names), values.tolist(), strict=True))


@pytest.mark.parametrize('beams', [8, 21, 360, 361, 1440])
@pytest.mark.parametrize('first', [0.0, -math.pi, 1.0])
@pytest.mark.parametrize('direction', [1, -1])
def test_a_return_is_found_in_its_direction(messages, beams, first, direction):
    step = direction * TURN / beams
    for angle, name in ((0.0, 'front'), (math.pi / 2, 'left'), (-math.pi / 2, 'right')):
        ranges = np.full(beams, 3.0)
        angles = first + step * np.arange(beams)
        away = np.abs((angles - angle + math.pi) % TURN - math.pi)
        ranges[away.argmin()] = 0.5
        found = sectors(messages.scan(ranges, first=first, step=step), 4)
        assert min(found, key=found.get) == name
        assert sorted(found.values()) == [0.5, 3.0, 3.0, 3.0]


@given(
    st.integers(2, 72),
    st.integers(100, 1500),
    st.floats(-10.0, 10.0),
    st.sampled_from([1.0, -1.0]),
)
def test_each_beam_is_in_exactly_one_sector(count, beams, first, direction):
    width = 360.0 / count
    members = [
        sector_beams(
            'd',
            Reading('scan', 'ranges', degrees=(low, low + width)),
            (float(np.float32(first)), float(np.float32(direction * TURN / beams))),
            beams,
        )
        for low in (width * (place - 0.5) for place in range(count))
    ]
    assert sorted(np.concatenate(members)) == list(range(beams))


def test_what_was_not_measured(messages):
    inf, nan = math.inf, math.nan
    # Four beams: front, left, rear, right.
    scan = messages.scan([inf, nan, 0.0, 2.0], step=TURN / 4)
    np.testing.assert_equal(
        sectors(scan, 4, missing='max_range'), {'front': 4, 'left': 4, 'rear': 4, 'right': 2}
    )
    np.testing.assert_equal(
        sectors(scan, 4, missing='drop'), {'front': nan, 'left': nan, 'rear': nan, 'right': 2}
    )
    np.testing.assert_equal(sectors(scan, 4), {'front': inf, 'left': nan, 'rear': 0, 'right': 2})
    close = messages.scan([-inf, nan, 0.0, 2.0], step=TURN / 4)
    for missing in ('unknown', 'max_range', 'drop'):
        assert sectors(close, 4, missing=missing)['front'] == -inf


def test_blindness_is_judged_by_the_whole_scan(messages):
    """A sector without a return is open as long as another one has returns."""
    blind = messages.scan([0.0, 0.0, math.nan, 0.0], step=TURN / 4)
    assert all(map(math.isnan, sectors(blind, 4, missing='max_range').values()))
    assert all(map(math.isnan, sectors(messages.scan([]), 4).values()))


def test_drop_leaves_out_beams_of_every_reduction(messages):
    scan = messages.scan([math.inf, 3.0, math.nan, 0.0, 4.0, 1.0], step=TURN / 6)
    for reduce, expected in (('min', 1.0), ('max', 4.0), ('mean', 8 / 3), ('norm', 26**0.5)):
        found = sectors(scan, 2, reduce=reduce, missing='drop', degrees=[-30, 690 - 360])
        assert found == pytest.approx({'60': 3.0, '240': {'mean': 2.5, 'norm': 17**0.5}.get(
            reduce, expected)})  # fmt: skip


def test_a_sector_where_the_scan_does_not_look(messages):
    half = messages.scan(np.ones(180), first=-math.pi / 2, step=math.pi / 180)
    with pytest.raises(OccError, match=r"'d_rear' .* from 135 to 225 .* go from -90 to 89 degrees"):
        sectors(half, 4)
    assert set(sectors(half, 4, degrees=[-90, 90])) == {'292', '338', '22', '68'}


def test_what_has_no_angles(messages):
    with pytest.raises(OccError, match='angle_increment nan; allowed are radians'):
        sectors(messages.scan([1.0, 2.0], step=math.nan), 4)
    document = {
        'schema_version': 1,
        'pace': 'imu',
        'max_age': 1.0,
        'features': [
            {
                'name': 'd',
                'topic': 'imu',
                'field': 'orientation_covariance',
                'degrees': [0, 90],
                'reduce': 'min',
            }
        ],
    }
    extractor = FeatureExtractor(FeatureMap.from_document(document, 'map'))
    with pytest.raises(OccError, match="asks for a sector, but .*Imu has no fields 'angle_min'"):
        extractor.push('imu', messages.imu(messages.quaternion(0.0, 0.0, 0.0, 1.0)), 1)


def test_a_value_too_close_is_kept_where_nothing_else_was_measured(messages):
    """-Inf is never dropped, though it is what stands for nothing in a maximum."""
    scan = messages.scan([-math.inf, math.nan, 0.0, 2.0], step=TURN / 4)
    found = sectors(scan, 4, missing='drop', reduce='max')
    np.testing.assert_equal(found, {'front': -math.inf, 'left': np.nan, 'rear': np.nan, 'right': 2})
