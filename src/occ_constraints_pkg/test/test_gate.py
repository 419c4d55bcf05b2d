# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The gate opens on proof only: fresh, ordered, safe verdicts in a row."""

import math

import pytest
from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.rules import Verdict
from occ_constraints_pkg.rules.gating import GateSettings, SpeedGate, Timing

WALL = 10**18


def timing(now, *, stamp=0.0, sent=0.0, judged=0.0):
    """The times of a verdict at steady time `now`, each off by some seconds."""
    wall = WALL + round(now * 1e9)
    times = (wall + round(seconds * 1e9) for seconds in (stamp, sent, judged))
    return Timing(*times, wall, wall)


def opened(margin=1.0, **settings):
    """A gate after as many safe verdicts as it needs, and the time."""
    gate, now = SpeedGate(GateSettings(**settings)), 0.0
    for _ in range(gate.settings.release_count):
        assert gate.output(now).scale == 0.0
        now += 0.1
        gate.judge(Verdict.SAFE, margin, 'SAFE', timing(now), now)
    return gate, now


@pytest.mark.parametrize('count', [1, 2, 5, 10])
def test_opens_after_so_many_safe_verdicts(count):
    gate, now = opened(release_count=count)
    assert gate.output(now).scale == 1.0


@pytest.mark.parametrize(
    ('margin', 'scale'), [(1.0, 1.0), (0.1, 1.0), (0.05, 0.65), (0.0, 0.3), (0.025, 0.475)]
)
def test_speed_falls_with_the_margin(margin, scale):
    gate, now = opened(margin)
    assert gate.output(now).scale == pytest.approx(scale)


@pytest.mark.parametrize('margin', [math.nan, math.inf, -math.inf])
def test_a_margin_that_is_not_finite_proves_nothing(margin):
    gate, now = opened()
    gate.judge(Verdict.SAFE, margin, 'SAFE', timing(now + 0.1), now + 0.1)
    assert gate.output(now + 0.1).scale == 0.0


@pytest.mark.parametrize(
    'late',
    [
        {'sent': -0.6},
        {'judged': -0.6},
        {'sent': 0.2},
        {'judged': 0.2},
        {'stamp': -0.2},
        {'sent': -0.2, 'stamp': 0.1},
    ],
)
def test_old_future_and_reordered_verdicts_stop(late):
    gate, now = opened()
    gate.judge(Verdict.SAFE, 1.0, 'SAFE', timing(now + 0.1, **late), now + 0.1)
    assert gate.output(now + 0.1).scale == 0.0


@pytest.mark.parametrize('verdict', [Verdict.UNKNOWN, Verdict.VIOLATED])
@pytest.mark.parametrize('times', [1, 2, 3])
def test_stops_at_once_if_unknown_and_at_the_second_violation(verdict, times):
    gate, now = opened()
    for _ in range(times):
        now += 0.1
        gate.judge(verdict, -1.0, verdict.name, timing(now), now)
    expected = 0.3 if verdict is Verdict.VIOLATED and times == 1 else 0.0
    assert gate.output(now).scale == expected


@pytest.mark.parametrize(('seconds', 'is_open'), [(0.4, True), (0.6, False), (10.0, False)])
def test_silence_stops(seconds, is_open):
    gate, now = opened()
    assert (gate.output(now + seconds).scale > 0.0) == is_open


def test_a_repeated_verdict_does_not_keep_it_open():
    gate, now = opened()
    same = timing(now)
    for step in range(1, 10):
        gate.judge(Verdict.SAFE, 1.0, 'SAFE', same, now + 0.1 * step)
    assert gate.output(now + 0.9).scale == 0.0


@pytest.mark.parametrize(
    'settings',
    [
        {'slow_margin': -0.1},
        {'min_speed_scale': 1.1},
        {'min_speed_scale': -0.1},
        {'timeout': 0.0},
        {'trigger_count': 0},
        {'release_count': 0},
        {'trigger_count': 3, 'trigger_window': 2},
    ],
)
def test_settings_out_of_range_are_refused(settings):
    with pytest.raises(OccError, match='allowed are'):
        GateSettings(**settings)
