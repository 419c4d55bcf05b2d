# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from occ_constraints_pkg.traffic.neighbours import (
    gaps_by_lane,
    lanes_in_a_row,
    side_of,
    standing_inside,
)

CAR = st.tuples(
    st.integers(0, 2),  # moment
    st.floats(-100.0, 100.0),
    st.floats(1.0, 20.0),
    st.integers(0, 3),  # lane
)


@given(st.lists(CAR, min_size=1, max_size=12))
def test_gaps_are_those_of_the_nearest_on_each_lane(cars):
    moment, along, length, lane = (np.array(column) for column in zip(*cars, strict=True))
    # All drive in the middle of their lanes.
    size = np.stack([length, np.full(len(cars), 2.0)], axis=1)
    gaps = gaps_by_lane(moment, along, -4.0 * lane, size, lane, lanes_in_a_row(np.arange(4)))
    for i in range(len(cars)):
        expected = [np.inf] * 6
        for j in range(len(cars)):
            side = lane[j] - lane[i] + 1
            if i != j and moment[i] == moment[j] and 0 <= side <= 2:
                place = side + (3 if along[j] >= along[i] else 0)
                gap = abs(along[j] - along[i]) - (length[i] + length[j]) / 2
                expected[place] = min(expected[place], gap)
        np.testing.assert_allclose(gaps[i], expected)


def test_two_abreast_on_one_lane_are_on_the_left_and_on_the_right():
    moment, lane = np.zeros(3), np.zeros(3, dtype=int)
    along, left = np.array([0.0, 2.0, 12.0]), np.array([1.2, -1.2, 0.0])
    size = np.tile([4.0, 2.0], (3, 1))
    gaps = gaps_by_lane(moment, along, left, size, lane, lanes_in_a_row(np.arange(1)))
    none = np.inf
    assert gaps.tolist() == [
        [none, none, none, none, 8.0, -2.0],
        [-2.0, none, none, none, 6.0, none],
        [none, 6.0, none, none, none, none],
    ]


def test_lanes_are_numbered_from_the_left():
    assert lanes_in_a_row(np.arange(3)).tolist() == [[1, 2, -1], [0, 1, 2], [-1, 0, 1]]
    assert side_of(np.array([-2, -1, 0, 1, 2])).tolist() == [-1, 0, 1, 2, -1]


def test_two_at_one_place_at_one_time():
    moment = np.array([0, 0, 0, 1])
    along = np.array([0.0, 2.0, 0.0, 0.0])
    left = np.array([0.0, 0.5, 3.0, 0.0])
    size = np.tile([4.0, 2.0], (4, 1))
    assert standing_inside(moment, along, left, size).tolist() == [True, True, False, False]
