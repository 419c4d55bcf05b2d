# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
import os

import numpy as np
import pytest
from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.traffic.convert import import_trajectories, read_trajectories
from occ_constraints_pkg.traffic.recorded import FEATURES
from synthetic_traffic import write_ngsim


def test_features(tmp_path):
    trajectories = read_trajectories('ngsim-sqlite', write_ngsim(tmp_path / 'made.shf'))
    assert trajectories.names == FEATURES
    first = {
        number: trajectories.values[trajectories.vehicle == number][0] for number in (1, 2, 3, 4)
    }
    np.testing.assert_allclose(
        first[1], [10.0, 0.0, 500, 500, 500, 500, 26.0, 1.0, 2.0, 10.0], atol=1e-9
    )
    np.testing.assert_allclose(
        first[3], [10.0, 0.0, 1.0, 500, 21.0, 21.0, 500, 500, 6.0, 6.0], atol=1e-9
    )
    np.testing.assert_allclose(first[4][[3, 5]], [500, 21.0], atol=1e-9)
    np.testing.assert_allclose(trajectories.time[:5], np.arange(5) / 10)


def test_the_road_is_as_wide_as_its_lanes_at_each_place(tmp_path):
    # The third lane begins only after 60 m: before that, the second is the rightmost.
    path = write_ngsim(
        tmp_path / 'made.shf',
        'UPDATE Trajectory SET position_x = position_x + 80 WHERE vehicle_id = 4',
        'UPDATE Trajectory SET position_x = position_x + 60 WHERE vehicle_id = 2',
    )
    trajectories = read_trajectories('ngsim-sqlite', path)
    d_right = {n: trajectories.values[trajectories.vehicle == n][0, -1] for n in (3, 4)}
    assert d_right == {3: pytest.approx(2.0), 4: pytest.approx(2.0)}


def test_gaps_of_vehicles_at_one_place_are_left_out(tmp_path):
    path = write_ngsim(
        tmp_path / 'made.shf',
        'UPDATE Trajectory SET position_x = position_x - 30 WHERE vehicle_id = 2',
    )
    trajectories = read_trajectories('ngsim-sqlite', path)
    assert trajectories.names == ('v_x', 'v_y', 'd_left', 'd_right')
    assert 'in 50% of the rows a vehicle is at the place of another one' in trajectories.warnings[0]
    assert trajectories.warnings[0].endswith('the gaps p_rel0 to p_rel5 are left out')
    trajectories = read_trajectories('ngsim-sqlite', path, keep_gaps=True)
    assert trajectories.names == FEATURES
    assert trajectories.warnings[0].endswith('are kept as asked, but show nothing')


def test_one_lane_alone_is_told(tmp_path):
    path = write_ngsim(tmp_path / 'made.shf', 'DELETE FROM Trajectory WHERE lane_id <> 1')
    trajectories = read_trajectories('ngsim-sqlite', path)
    (warning,) = trajectories.warnings
    assert warning.startswith(f'{path}: all vehicles are on lane 1, so d_left and d_right are')
    # What the warning is about.
    assert (trajectories.values[:, [2, 4, 5, 7]] == 500).all()
    assert read_trajectories('ngsim-sqlite', write_ngsim(tmp_path / 'all.shf')).warnings == ()


def test_the_number_of_a_lane_may_be_any(tmp_path):
    path = write_ngsim(
        tmp_path / 'made.shf', 'UPDATE Trajectory SET lane_id = 1000000 WHERE lane_id = 3'
    )
    trajectories = read_trajectories('ngsim-sqlite', path)
    assert (trajectories.values[trajectories.vehicle == 4][:, [2, 3, 5, 6]] == 500).all()


MALFORMED = {
    'missing table': ('DROP TABLE Vehicle', r"made.shf has no table 'Vehicle'; its tables are"),
    'missing column': (
        'ALTER TABLE Trajectory RENAME COLUMN speed TO velocity',
        r"the table Trajectory has no column 'speed'; its columns are vehicle_id, sim_time",
    ),
    'text': (
        "UPDATE Trajectory SET speed = 'fast' WHERE vehicle_id = 2 AND sim_time = 0.3",
        r"row of vehicle_id 2, sim_time 0.3, column 'speed': got 'fast'; allowed is a number",
    ),
    'nothing': (
        'UPDATE Vehicle SET length = NULL WHERE id = 3',
        r"table Vehicle, row of id 3, column 'length': got nothing; allowed is a number",
    ),
    'infinite': (
        'UPDATE Trajectory SET position_x = 9e999 WHERE vehicle_id = 2',
        r"column 'position_x': got inf; allowed is a number of at most 1e\+09",
    ),
    'length': (
        'UPDATE Vehicle SET length = 0 WHERE id = 3',
        r"table Vehicle, row of id 3, column 'length': got 0 m; allowed are 0.5 to 40 m",
    ),
    'unknown vehicle': (
        'UPDATE Trajectory SET vehicle_id = 77 WHERE vehicle_id = 4',
        r"row of sim_time 0, column 'vehicle_id': got 77, which the table Vehicle does not have",
    ),
    'no vehicles': ('DELETE FROM Vehicle', r"column 'vehicle_id': got 1, which the table Vehicle"),
    'twice at once': (
        'UPDATE Trajectory SET sim_time = 0.2 WHERE vehicle_id = 2 AND sim_time = 0.3',
        r'table Trajectory has vehicle_id 2 twice at sim_time 0.2; allowed is one row',
    ),
    'no rows': ('DELETE FROM Trajectory', r'the table Trajectory has no rows; allowed are one'),
    'source': (
        "UPDATE Spec SET value = 'Waymo' WHERE key = 'source_type'",
        r"table Spec, key 'source_type': got 'Waymo'; allowed is 'NGSIM'",
    ),
    'heading': (
        "DELETE FROM Spec WHERE key = 'default_heading'",
        r"table Spec, key 'default_heading': got nothing; allowed is a finite number",
    ),
    'lanes in feet': (
        "UPDATE Spec SET value = 12 WHERE key = 'map_lane_width'",
        r"table Spec, key 'map_lane_width': the lane is 12 m wide; allowed are 2 to 8 m",
    ),
    'speed in feet': (
        'UPDATE Trajectory SET speed = speed * 3.28',
        r'column speed: vehicle 1, at 0 s, has speeds that are 3.28 times what positions and times',
    ),
    'heading in degrees': (
        'UPDATE Trajectory SET heading_rad = heading_rad * 57.3',
        r'column heading_rad: vehicle 1, at 0 s, heads elsewhere than its positions go',
    ),
    'lane': (
        'UPDATE Trajectory SET lane_id = 0 WHERE vehicle_id = 2 AND sim_time = 0.3',
        r"vehicle_id 2, sim_time 0.3, column 'lane_id': got 0; allowed are whole numbers from 1",
    ),
    'one lane for all': (
        'UPDATE Trajectory SET lane_id = 1',
        r"'lane_id': \d+% of the rows of lane 1 are more than 3 m beside its middle",
    ),
    'one lane for two': (
        'UPDATE Trajectory SET lane_id = 2 WHERE lane_id = 1',
        r"'lane_id': \d+% of the rows of lane 2 are more than 3 m beside its middle",
    ),
    'overlapping lanes': (
        'UPDATE Trajectory SET position_y = 9 WHERE lane_id = 2',
        r"column 'lane_id': lanes 1 and 2 overlap or are not numbered from the left",
    ),
}


@pytest.mark.parametrize('fault', MALFORMED)
def test_faults_are_told_in_one_sentence(fault, tmp_path):
    command, sentence = MALFORMED[fault]
    path = write_ngsim(tmp_path / 'made.shf', command)
    with pytest.raises(OccError, match=sentence) as caught:
        import_trajectories('ngsim-sqlite', path, tmp_path / 'bag')
    assert '\n' not in str(caught.value)
    assert 'made.shf' in str(caught.value)
    assert os.listdir(tmp_path) == ['made.shf']


def test_what_is_no_database_is_refused(tmp_path):
    path = tmp_path / 'made.shf'
    with pytest.raises(OccError, match=r'cannot read \S+made.shf: No such file'):
        read_trajectories('ngsim-sqlite', path)
    path.write_text('id,speed\n')
    with pytest.raises(OccError, match=r'made.shf is no SQLite database; allowed is one with Spec'):
        read_trajectories('ngsim-sqlite', path)


@pytest.mark.parametrize('kept', [0.05, 0.3, 0.6, 0.9])
def test_a_truncated_file_is_refused(tmp_path, kept):
    path = write_ngsim(tmp_path / 'made.shf')
    data = path.read_bytes()
    path.write_bytes(data[: int(kept * len(data))])
    with pytest.raises(OccError, match=r'made.shf') as caught:
        read_trajectories('ngsim-sqlite', path)
    assert '\n' not in str(caught.value)


def test_ngsim(driving):
    path = driving / 'ngsim_i80' / '200_actors_i80_0400-0415.shf'
    trajectories = read_trajectories('ngsim-sqlite', path)
    # All vehicles of this file begin at one time, most of them at one place.
    assert 'in 94% of the rows' in trajectories.warnings[0]
    assert len(trajectories.beginnings) == 200
    columns = dict(zip(trajectories.names, trajectories.values.T, strict=True))
    assert 0.0 < columns['v_x'].min() < columns['v_x'].max() < 28.0
    # A few on the ramp are nearer to the edge than half of what drives there.
    assert np.percentile(columns['d_right'], [1, 99]) == pytest.approx([0.9, 25.0], abs=0.2)
