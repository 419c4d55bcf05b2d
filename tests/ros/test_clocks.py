# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
import pytest

pytest.importorskip('rclpy', reason="needs the extra 'ros'")

from occ_constraints_pkg.ros.clocks import ArrivalClock


class Node:
    """A node whose clocks are set by hand."""

    time_ns, steady = 0, 100.0

    def ros_ns(self):
        return self.time_ns

    def steady_seconds(self):
        return self.steady


@pytest.fixture
def node():
    return Node()


def arrive(node, clock, *, ros_ns, after):
    node.time_ns, node.steady = ros_ns, node.steady + after
    assert clock.now_ns() == ros_ns
    return clock.problem()


def test_nothing_has_come_on_the_clock(node):
    clock = ArrivalClock(node, 1.0)
    assert 'nothing has come on /clock' in arrive(node, clock, ros_ns=0, after=0.0)
    assert arrive(node, clock, ros_ns=5, after=0.1) == ''


def test_a_clock_that_goes_on_is_relied_on(node):
    clock = ArrivalClock(node, 1.0)
    for tick in range(1, 50):
        assert arrive(node, clock, ros_ns=tick, after=0.9) == ''


def test_a_clock_that_stands_still_while_messages_come_is_not(node):
    clock = ArrivalClock(node, 1.0)
    told = [arrive(node, clock, ros_ns=7, after=0.4) for _ in range(6)]
    assert told[:3] == [''] * 3
    assert all('/clock has stood still for 1 s' in text for text in told[3:])
    assert arrive(node, clock, ros_ns=8, after=0.4) == ''


def test_a_pause_of_everything_is_no_fault_of_the_clock(node):
    clock = ArrivalClock(node, 1.0)
    assert arrive(node, clock, ros_ns=7, after=0.0) == ''
    assert arrive(node, clock, ros_ns=7, after=60.0) == ''
    assert arrive(node, clock, ros_ns=7, after=0.8) == ''
    assert 'stood still' in arrive(node, clock, ros_ns=7, after=0.8)
