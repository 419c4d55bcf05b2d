# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
import os

import numpy as np
import pytest
from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.traffic.convert import import_trajectories, read_trajectories

RADIUS, EARTH = 400.0, 6.37e6


@pytest.fixture
def segment(tmp_path):
    """Return a folder with a car that drives 20 m/s on a circle to the left.

    Its radar sees one vehicle ahead on its path, which drives as fast, and two on other lanes.
    """
    times = 100.0 + np.arange(0.0, 5.0, 0.05)
    angle = 20.0 / RADIUS * (times - times[0])
    # At latitude and longitude 0: x is up, y is east, z is north.
    north, east = RADIUS * np.sin(angle), -RADIUS * (1.0 - np.cos(angle))
    positions = np.stack([np.full(len(times), EARTH), east, north], axis=1)
    velocities = np.gradient(positions, times, axis=0)
    radar = []
    for time in times[::2]:
        for address, ahead, lane in ((1, 50.0, 0.0), (2, 30.0, 3.6), (3, 20.0, -3.6)):
            left = ahead**2 / RADIUS / 2.0 + lane
            radar.append([time, ahead, left, 0.0, np.nan, np.nan, address, 0.0])
    radar = np.array(radar)
    arrays = {
        'global_pose/frame_times': times,
        'global_pose/frame_gps_times': np.stack([np.full(len(times), 2012.0), times], axis=1),
        'global_pose/frame_positions': positions,
        'global_pose/frame_velocities': velocities,
        'processed_log/CAN/speed/t': times + 0.001,
        'processed_log/CAN/speed/value': np.full((len(times), 1), 20.0),
        'processed_log/CAN/radar/t': radar[:, 0],
        'processed_log/CAN/radar/value': radar[:, 1:],
    }
    for name, array in arrays.items():
        save(tmp_path / 'segment' / name, array)
    return tmp_path / 'segment'


def save(path, array):
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open('wb') as stream:
        np.save(stream, array)


def change(path, alter):
    save(path, alter(np.load(path)))


def test_speed_and_the_gap_to_whom_is_on_the_path(segment):
    trajectories = read_trajectories('comma2k19', segment)
    assert trajectories.names == ('v_x', 'p_rel4')
    # Without those before the first speed.
    assert len(trajectories.time) == 99
    np.testing.assert_allclose(trajectories.values[:, 0], 20.0)
    np.testing.assert_allclose(trajectories.values[20:80, 1], 50.0)
    # 2018-07-29, 18 leap seconds after GPS time began to differ, and 100.05 s.
    assert trajectories.start_ns / 1e9 == pytest.approx(1532822400 + 100.05 - 18)


def test_nobody_ahead(segment):
    change(segment / 'processed_log/CAN/radar/t', lambda t: t[:0])
    change(segment / 'processed_log/CAN/radar/value', lambda value: value[:0])
    assert set(read_trajectories('comma2k19', segment).values[:, 1]) == {500.0}


FAULTS = {
    'shape': (
        'speed/value', lambda a: a[:, 0],
        r'speed/value has the shape \(100,\); allowed is \(100, 1\)',
    ),
    'lengths differ': (
        'radar/t', lambda a: a[1:], r'radar/value has the shape \(150, 7\); allowed is \(149, 7\)',
    ),
    'empty': ('speed/t', lambda a: a[:0], r'speed/t has the shape \(0,\); allowed is \(rows\)'),
    'text': ('speed/t', lambda a: a.astype(str), r'speed/t is no array of numbers'),
    'pickle': ('speed/t', lambda a: a.astype(object), r'speed/t is damaged or no array of numbers'),
    'not finite': (
        'radar/value', lambda a: np.where(np.arange(7) == 1, np.nan, a),
        r'radar/value, row 0, column 1: got nan; allowed is a number',
    ),
    'time goes back': ('speed/t', lambda a: a[::-1], r'speed/t, row 1: the time does not grow'),
    'another time': ('speed/t', lambda a: a + 900.0, r'camera and speed were not recorded at the'),
    'radar of another time': (
        'radar/t', lambda a: a - 900.0, r'camera and radar were not recorded at the same time',
    ),
    'km/h': ('speed/value', lambda a: a * 3.6, r'speed/value: .* has speeds that are 3.6 times'),
}  # fmt: skip


@pytest.mark.parametrize('fault', FAULTS)
def test_faults_are_told_in_one_sentence(segment, tmp_path, fault):
    name, alter, sentence = FAULTS[fault]
    change(segment / 'processed_log/CAN' / name, alter)
    with pytest.raises(OccError, match=sentence) as caught:
        import_trajectories('comma2k19', segment, tmp_path / 'bag')
    assert '\n' not in str(caught.value)
    assert os.listdir(tmp_path) == ['segment']


@pytest.mark.parametrize('data', [b'', b'\x93NUMPY', b'PK\x03\x04', b'1 2 3'])
def test_damaged_arrays(segment, data):
    path = segment / 'processed_log/CAN/radar/t'
    whole = path.read_bytes()
    for content in (data, whole[:-100], whole[:60]):
        path.write_bytes(content)
        with pytest.raises(OccError, match=r'radar/t'):
            read_trajectories('comma2k19', segment)


def test_parts_are_needed(segment):
    with pytest.raises(OccError, match='is no directory; allowed is the directory of a segment'):
        read_trajectories('comma2k19', segment / 'nothing')
    with pytest.raises(OccError, match='comma2k19 shows one car, so there are no gaps to keep'):
        read_trajectories('comma2k19', segment, keep_gaps=True)
    (segment / 'global_pose/frame_times').unlink()
    with pytest.raises(OccError, match=r'cannot read \S+frame_times: No such file'):
        read_trajectories('comma2k19', segment)


def test_a_real_car(driving):
    trajectories = read_trajectories('comma2k19', driving / 'comma2k19')
    assert trajectories.values.shape == (1199, 2)
    assert trajectories.values[:, 0].min() == pytest.approx(8.0, abs=0.1)
    # It follows another car all the time.
    assert 23.0 < trajectories.values[:, 1].min() < trajectories.values[:, 1].max() < 80.0
    assert trajectories.start_ns == 1533226488447008000
