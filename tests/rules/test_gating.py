# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The gate passes only what the verdicts allow, and lets go only after enough safe ones."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.rules import Verdict
from occ_constraints_pkg.rules.gating import Debounce, GateSettings, SpeedGate, SteadyVerdict

counts = st.tuples(st.integers(1, 5), st.integers(1, 5), st.integers(1, 5)).map(
    lambda drawn: (min(drawn[:2]), max(drawn[:2]), drawn[2])
)
verdicts = st.lists(st.sampled_from(list(Verdict)), max_size=60)


@given(counts, st.lists(st.booleans(), max_size=80))
def test_debounce_trips_and_releases_by_its_counts(numbers, samples):
    trigger_count, window, release_count = numbers
    debounce, expected = Debounce(*numbers), False
    for place, sample in enumerate(samples):
        debounce.add(sample)
        seen = samples[: place + 1]
        if sum(seen[-window:]) >= trigger_count:
            expected = True
        elif len(seen) >= release_count and not any(seen[-release_count:]):
            expected = False
        assert debounce.tripped == expected


@given(st.lists(st.booleans(), min_size=1))
def test_one_of_one_follows_the_samples(samples):
    debounce = Debounce(1, 1, 1)
    for sample in samples:
        debounce.add(sample)
        assert debounce.tripped == sample


@given(verdicts)
def test_a_steady_verdict_of_one_of_one_is_the_verdict(sequence):
    steady = SteadyVerdict(1, 1, 1)
    assert steady.state is Verdict.UNKNOWN
    for verdict in sequence:
        assert steady.add(verdict) is verdict is steady.state


@given(counts, verdicts)
def test_a_steady_verdict_is_safe_only_after_enough_safe_ones(numbers, sequence):
    trigger_count, window, release_count = numbers
    steady = SteadyVerdict(*numbers)
    before = Verdict.UNKNOWN
    for place, verdict in enumerate(sequence):
        state, seen = steady.add(verdict), sequence[: place + 1]
        released = len(seen) >= release_count and set(seen[-release_count:]) == {Verdict.SAFE}
        if verdict is Verdict.UNKNOWN:
            assert state is Verdict.UNKNOWN
        elif verdict is Verdict.SAFE and state is Verdict.SAFE:
            assert before is Verdict.SAFE or released
        elif verdict is Verdict.SAFE:
            assert state is before
        else:
            bad = sum(item is not Verdict.SAFE for item in seen[-window:])
            tripped = before is not Verdict.SAFE or bad >= trigger_count
            assert state is (Verdict.VIOLATED if tripped else Verdict.SAFE)
        before = state


@given(counts, verdicts)
def test_nothing_passes_unless_enough_safe_verdicts_came_last(numbers, sequence):
    settings = GateSettings(0.0, 1.0, *numbers, timeout=1.0)
    gate = SpeedGate(settings)
    for step, verdict in enumerate(sequence):
        gate.judge(verdict, 1.0, verdict.name, 0.1 * step)
        passes = gate.passage(0.1 * step).scale > 0.0
        if verdict is Verdict.UNKNOWN:
            assert not passes
        recent = sequence[max(0, step + 1 - settings.release_count) : step + 1]
        if len(recent) == settings.release_count and all(v is Verdict.SAFE for v in recent):
            in_window = sequence[max(0, step + 1 - settings.trigger_window) : step + 1]
            bad = sum(v is not Verdict.SAFE for v in in_window)
            assert passes == (bad < settings.trigger_count)
        if passes:
            # Since the last stop there were enough in a row.
            assert any(
                all(v is Verdict.SAFE for v in sequence[start : start + settings.release_count])
                for start in range(step + 2 - settings.release_count)
            )


def opened(settings):
    gate = SpeedGate(settings)
    for _ in range(settings.release_count):
        gate.judge(Verdict.SAFE, 1.0, 'SAFE', 0.0)
    assert gate.passage(0.0).scale == 1.0
    return gate


def test_it_is_shut_before_the_first_verdict():
    passage = SpeedGate(GateSettings()).passage(5.0)
    assert (passage.scale, passage.reason) == (0.0, 'no verdict yet')


def test_silence_stops_and_needs_the_release_again():
    settings = GateSettings(timeout=0.5, release_count=2)
    gate = opened(settings)
    assert gate.passage(0.5).scale == 1.0
    assert gate.passage(0.51) == type(gate.passage(0.0))(0.0, 'no verdict for 0.5 s')
    gate.judge(Verdict.SAFE, 1.0, 'SAFE', 1.0)
    assert gate.passage(1.0).reason == 'no verdict for 0.5 s'
    gate.judge(Verdict.SAFE, 1.0, 'SAFE', 1.1)
    assert gate.passage(1.1).scale == 1.0


@given(st.floats(0.0, 2.0), st.floats(0.0, 2.0), st.floats(0.0, 1.0), st.floats(0.001, 1.0))
def test_speed_falls_with_the_margin_and_never_below_the_slowest(one, other, slowest, slow):
    gate = opened(GateSettings(slow_margin=slow, slowest=slowest))
    scales = []
    for margin in sorted((one, other)):
        gate.judge(Verdict.SAFE, margin, 'SAFE', 0.0)
        scales.append(gate.passage(0.0).scale)
        assert slowest <= scales[-1] <= 1.0
        assert scales[-1] == 1.0 or margin < slow
    assert scales[0] <= scales[1]


def test_a_violation_is_slowest_until_it_has_lasted_long_enough():
    gate = opened(GateSettings(slow_margin=0.1, slowest=0.25, trigger_count=2, trigger_window=3))
    gate.judge(Verdict.VIOLATED, -0.5, 'VIOLATED: too fast', 0.0)
    assert gate.passage(0.0).scale == 0.25
    gate.judge(Verdict.VIOLATED, -0.5, 'VIOLATED: too fast', 0.1)
    assert gate.passage(0.1).scale == 0.0
    assert gate.passage(0.1).reason == 'VIOLATED: too fast'


def test_unknown_and_a_margin_that_is_no_number_stop_at_once():
    for verdict, margin in ((Verdict.UNKNOWN, 1.0), (Verdict.SAFE, math.nan)):
        gate = opened(GateSettings(trigger_count=3))
        gate.judge(verdict, margin, 'why', 0.0)
        assert gate.passage(0.0).scale == 0.0


@pytest.mark.parametrize(
    'wrong',
    [
        {'slow_margin': -0.1},
        {'slow_margin': math.nan},
        {'slowest': 1.1},
        {'timeout': 0.0},
        {'trigger_count': 4, 'trigger_window': 3},
        {'trigger_count': 0},
        {'release_count': 0},
    ],
)
def test_settings_out_of_range_are_refused(wrong):
    with pytest.raises(OccError, match='allowed are'):
        GateSettings(**wrong)
