# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
import os
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.traffic.convert import import_trajectories, read_trajectories
from occ_constraints_pkg.traffic.recorded import FEATURES
from synthetic_traffic import CARS, FRAME_RATE, Car, highd_texts, told, write_highd


def rows_of(trajectories, vehicle):
    """Return the rows of a vehicle by the name of their feature."""
    values = trajectories.values[trajectories.vehicle == vehicle]
    return dict(zip(trajectories.names, values.T, strict=True))


def test_both_carriageways(tmp_path):
    trajectories = read_trajectories('highd', write_highd(tmp_path))
    assert trajectories.names == FEATURES
    assert len(trajectories.beginnings) == len(CARS)
    assert trajectories.warnings == ()
    # Of the upper carriageway, towards -x: the third picture, the first with vehicle 3.
    first = {name: column[2] for name, column in rows_of(trajectories, 1).items()}
    assert first == pytest.approx(
        {
            'v_x': 30.0, 'v_y': 0.0, 'p_rel0': 25.76, 'p_rel1': 500.0, 'p_rel2': 500.0,
            'p_rel3': 500.0, 'p_rel4': 32.0, 'p_rel5': 500.0, 'd_left': 6.0, 'd_right': 2.0,
        }
    )  # fmt: skip
    assert rows_of(trajectories, 2)['p_rel1'][2] == pytest.approx(32.0)
    assert rows_of(trajectories, 3)['p_rel5'][0] == pytest.approx(25.76)
    # Of the lower one, towards +x, with a neighbour beside it on the left, a bit ahead.
    fourth = {name: column[0] for name, column in rows_of(trajectories, 4).items()}
    assert fourth == pytest.approx(
        {
            'v_x': 28.0, 'v_y': 0.5, 'p_rel0': 500.0, 'p_rel1': 500.0, 'p_rel2': 21.0,
            'p_rel3': 0.0, 'p_rel4': 40.0, 'p_rel5': 500.0, 'd_left': 6.0, 'd_right': 6.0,
        }
    )  # fmt: skip
    assert rows_of(trajectories, 5)['p_rel2'][0] == 0.0
    assert rows_of(trajectories, 5)['p_rel5'][0] == pytest.approx(37.0)
    np.testing.assert_allclose(
        np.diff(trajectories.time[trajectories.vehicle == 3]), 1 / FRAME_RATE
    )


def test_the_other_carriageway_is_the_same_turned_round(tmp_path):
    upper = [replace(car, drift=0.4) for car in CARS if car.direction == 1]
    lower = [replace(car, direction=2) for car in upper]
    one, other = (
        read_trajectories('highd', write_highd(tmp_path / name, highd_texts(cars)))
        for name, cars in (('upper', upper), ('lower', lower))
    )
    # The lower carriageway has a lane of 4 m more on its left.
    wider = np.array([0.0] * 8 + [4.0, 0.0])
    np.testing.assert_allclose(other.values, one.values + wider, atol=1e-3)


MALFORMED = {
    'missing column': (
        'tracks', ',precedingId,', ',leadingId,',
        r"01_tracks.csv, line 1: there is no column 'precedingId'; did you mean",
    ),
    'missing column of the meta file': (
        'tracksMeta', 'drivingDirection', 'way',
        r"01_tracksMeta.csv, line 1: there is no column 'drivingDirection'",
    ),
    'no number': (
        'tracks', '\n2,1,', '\n2,one,',
        r"01_tracks.csv, line 3, column 'id': got 'one'; allowed is a number",
    ),
    'no whole number': (
        'tracks', '\n2,1,', '\n2,1.5,',
        r"01_tracks.csv, line 3, column 'id': got 1.5; allowed is a whole number",
    ),
    'empty cell': (
        'tracks', '\n2,1,', '\n2,,',
        r"01_tracks.csv, line 3, column 'id': got nothing; allowed is a number of at most",
    ),
    'unknown vehicle': (
        'tracks', '\n2,1,', '\n2,77,',
        r"line 3, column 'id': got 77; allowed are the vehicles of 01_tracksMeta.csv",
    ),
    'unknown neighbour': (
        'tracks', ',0,2,0,0,0,0,0,0,0,2\n', ',0,99,0,0,0,0,0,0,0,2\n',
        r"line 2, column 'precedingId': got 99; allowed are 0 and the vehicles of the same frame",
    ),
    'direction': (
        'tracksMeta', 'Car,1,', 'Car,3,',
        r"01_tracksMeta.csv, line 2, column 'drivingDirection': got 3; allowed are 1 and 2",
    ),
    'vehicle twice': (
        'tracksMeta', '\n2,', '\n1,', r"01_tracksMeta.csv, line 3, column 'id': got 1 a second",
    ),
    'frame twice': (
        'tracks', '\n3,1,', '\n2,1,',
        r"01_tracks.csv, line [34], column 'frame': got 2; allowed is one after the other",
    ),
    'overlapping lanes': (
        'recordingMeta', '8.50;12.50;16.50', '8.50;16.50;12.50',
        r"01_recordingMeta.csv, line 2, column 'upperLaneMarkings': got .* lanes that overlap",
    ),
    'overlapping carriageways': (
        'recordingMeta', '8.50;12.50;16.50', '18.50;22.50;26.50',
        r"line 2, column 'lowerLaneMarkings': begins at 22 m, so that its lanes overlap",
    ),
    'lanes in feet': (
        'recordingMeta', '8.50;12.50;16.50', '27.9;41;54.1',
        r"line 2, column 'upperLaneMarkings': the lane is 13.1 m wide; allowed are 2 to 8 m",
    ),
    'no markings': (
        'recordingMeta', '8.50;12.50;16.50', 'none', r"'upperLaneMarkings': got 'none'; allowed",
    ),
    'frame rate': (
        'recordingMeta', '1,25,', '1,0,', r"line 2, column 'frameRate': got 0; allowed are pict",
    ),
    'wrong frame rate': (
        'recordingMeta', '1,25,', '1,10,',
        r"line 2, column 'xVelocity': vehicle 1 has speeds that are 2.5 times what",
    ),
    'recording is empty': (
        'recordingMeta', '\n1,25,2,-1.00,9.2017,Tue,08:38,0.48,100.0,3.0,7,5,2,'
        '8.50;12.50;16.50,22.00;26.00;30.00;34.00', '', r'01_recordingMeta.csv has no rows',
    ),
}  # fmt: skip


@pytest.mark.parametrize('fault', MALFORMED)
def test_faults_are_told_in_one_sentence(fault, tmp_path):
    name, old, new, sentence = MALFORMED[fault]
    texts = highd_texts()
    assert old in texts[name]
    texts[name] = texts[name].replace(old, new, 1)
    path = write_highd(tmp_path / 'in', texts)
    with pytest.raises(OccError, match=sentence) as caught:
        import_trajectories('highd', path, tmp_path / 'bag')
    assert '\n' not in str(caught.value)
    assert os.listdir(tmp_path) == ['in']


def scaled(column, factor):
    """Return the text of the tracks with one column times a factor."""
    header, *lines = highd_texts()['tracks'].splitlines()
    place = header.split(',').index(column)
    rows = [line.split(',') for line in lines]
    for row in rows:
        row[place] = f'{float(row[place]) * factor:.3f}'
    return '\n'.join([header, *(','.join(row) for row in rows), ''])


@pytest.mark.parametrize(
    ('column', 'factor', 'sentence'),
    [
        ('xVelocity', 3.6, r"line 2, column 'xVelocity': vehicle 1 has speeds that are 3.6 times"),
        ('xVelocity', -1.0, r"line 2, column 'xVelocity': has the sign of the other direction"),
        ('width', 100.0, r"line 2, column 'width': got 400; allowed are 0.5 to 40 m"),
        ('y', 3.28, r"column 'y': got .*; allowed are places near the carriageway"),
    ],
)
def test_a_wrong_unit_is_found(tmp_path, column, factor, sentence):
    path = write_highd(tmp_path, highd_texts() | {'tracks': scaled(column, factor)})
    with pytest.raises(OccError, match=sentence):
        read_trajectories('highd', path)


def test_files_of_a_recording_must_be_there(tmp_path):
    path = write_highd(tmp_path)
    with pytest.raises(OccError, match=r'01_tracksMeta.csv is no file of tracks; allowed is'):
        read_trajectories('highd', path.with_name('01_tracksMeta.csv'))
    path.with_name('01_recordingMeta.csv').unlink()
    with pytest.raises(OccError, match=r'cannot read \S+01_recordingMeta.csv: No such file'):
        read_trajectories('highd', path)


@pytest.mark.parametrize('kept', [0.0, 0.3, 0.7, 0.99])
def test_a_truncated_file_is_refused(tmp_path, kept):
    text = highd_texts()['tracks']
    path = write_highd(tmp_path, highd_texts() | {'tracks': text[: int(kept * len(text))]})
    with pytest.raises(OccError, match=r'01_tracks\S* (line|has)|column'):
        read_trajectories('highd', path)


def test_rows_without_vehicles(tmp_path):
    texts = highd_texts()
    header = texts['tracks'].partition('\n')[0] + '\n'
    path = write_highd(tmp_path, texts | {'tracks': header})
    with pytest.raises(OccError, match=r'01_tracks.csv has no rows; allowed are one or more'):
        read_trajectories('highd', path)


def test_blank_lines_do_not_shift_the_line_that_is_named(tmp_path):
    lines = highd_texts()['tracks'].splitlines()
    lines.insert(1, '')
    lines[4] = lines[4].replace('3,1,', '3,1.5,', 1)
    path = write_highd(tmp_path, highd_texts() | {'tracks': '\n'.join(lines)})
    with pytest.raises(OccError, match=r"line 5, column 'id': got 1.5"):
        read_trajectories('highd', path)


@settings(deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    st.sampled_from(['tracks', 'tracksMeta', 'recordingMeta']),
    st.floats(0.0, 1.0),
    st.integers(0, 6),
    st.one_of(
        st.sampled_from([b'', b',', b'\n', b';', b'"', b'-', b'nan', b'1e999', b'\x00', b'\xff']),
        st.binary(max_size=4),
    ),
)
def test_damaged_files_are_read_or_refused(tmp_path, name, place, removed, inserted):
    cars = [Car(1, 1, 0.0, 2.0, 30.0, frames=(1, 3)), Car(2, 2, 9.0, 2.0, 30.0, frames=(1, 3))]
    path = write_highd(tmp_path, highd_texts(cars))
    file = path.with_name(f'01_{name}.csv')
    data = file.read_bytes()
    cut = int(place * len(data))
    file.write_bytes(data[:cut] + inserted + data[cut + removed :])
    sentence, trajectories = told(read_trajectories, 'highd', path)
    if trajectories is None:
        assert '\n' not in sentence
        assert '01_' in sentence
    else:
        assert np.isfinite(trajectories.values).all()
        assert (trajectories.values[:, 2:8] >= 0.0).all()
        assert (trajectories.values[:, 2:8] <= 500.0).all()
