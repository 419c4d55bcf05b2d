# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Log times of captured messages in simulated time."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

pytest.importorskip('rclpy', reason="needs the extra 'ros'")

from occ_constraints_pkg.nodes.event_recorder.capture import ros_time

BEFORE = (1_700_000_000_000_000_000, 5_000_000_000)
TIMES = st.integers(0, 20_000_000)


@given(TIMES, TIMES, TIMES, TIMES)
def test_times_between_two_looks_keep_their_order(passed, ros_passed, first, second):
    now = (BEFORE[0] + passed, BEFORE[1] + ros_passed)
    earlier, later = sorted(min(time, passed) for time in (first, second))
    times = [ros_time(BEFORE[0] + time, BEFORE, now) for time in (earlier, later)]
    assert BEFORE[1] <= times[0] <= times[1] <= now[1]


def test_a_clock_that_runs_half_as_fast():
    now = (BEFORE[0] + 20_000_000, BEFORE[1] + 10_000_000)
    assert ros_time(BEFORE[0] + 4_000_000, BEFORE, now) == BEFORE[1] + 2_000_000


@pytest.mark.parametrize(
    ('arrived', 'now'),
    [
        # The clock of ROS was set back, as by a simulation that begins again, or far ahead.
        (BEFORE[0] + 5, (BEFORE[0] + 10, 0)),
        (BEFORE[0] + 5, (BEFORE[0] + 10, BEFORE[1] + 10**12)),
        # The system's clock was set.
        (BEFORE[0] - 10**12, (BEFORE[0] - 10**12, BEFORE[1] + 10)),
        (BEFORE[0] + 10**12, (BEFORE[0] + 10, BEFORE[1] + 10)),
    ],
)
def test_where_a_clock_was_set_it_is_now(arrived, now):
    assert ros_time(arrived, BEFORE, now) == now[1]
