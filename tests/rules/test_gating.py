# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The gate passes only what the verdicts allow, and lets go only after enough safe ones."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.rules import Verdict
from occ_constraints_pkg.rules.gating import (
    CLOCK_TOLERANCE,
    Debounce,
    GateOutput,
    GateSettings,
    SpeedGate,
    SteadyVerdict,
    Timing,
)

counts = st.tuples(st.integers(1, 5), st.integers(1, 5), st.integers(1, 5)).map(
    lambda drawn: (min(drawn[:2]), max(drawn[:2]), drawn[2])
)
verdicts = st.lists(st.sampled_from(list(Verdict)), max_size=60)
BEGIN = 10**18


def timing(now, *, stamp=0.0, sent=0.0, judged=0.0):
    """Return the times of a verdict at steady time ``now``; each may differ by some seconds."""
    wall = BEGIN + round(now * 1e9)
    return Timing(
        wall + round(stamp * 1e9),
        wall + round(sent * 1e9),
        None if judged is None else wall + round(judged * 1e9),
        wall,
        wall,
    )


def say(gate, verdict, now, margin=1.0, text=None, **times):
    gate.judge(verdict, margin, text or verdict.name, timing(now, **times), now)


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
        say(gate, verdict, 0.1 * step)
        passes = gate.output(0.1 * step).scale > 0.0
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
    """Return a gate that is open at time 0."""
    gate = SpeedGate(settings)
    for number in range(settings.release_count):
        say(gate, Verdict.SAFE, 0.001 * (number + 1 - settings.release_count))
    assert gate.output(0.0).scale == 1.0
    return gate


def test_it_is_shut_before_the_first_verdict():
    assert SpeedGate(GateSettings()).output(5.0) == GateOutput(0.0, 'no verdict yet')


def test_silence_stops_and_needs_the_release_again():
    gate = opened(GateSettings(timeout=0.5, release_count=2))
    assert gate.output(0.5).scale == 1.0
    assert gate.output(0.51) == GateOutput(0.0, 'no verdict for 0.5 s')
    say(gate, Verdict.SAFE, 1.0)
    assert gate.output(1.0).reason == 'no verdict for 0.5 s'
    say(gate, Verdict.SAFE, 1.1)
    assert gate.output(1.1).scale == 1.0


def test_a_verdict_that_was_long_under_way_keeps_open_for_the_rest_of_the_timeout_only():
    gate = opened(GateSettings(timeout=0.5))
    say(gate, Verdict.SAFE, 0.45, sent=-0.4, judged=-0.4, stamp=0.1)
    assert gate.output(0.54).scale == 1.0
    assert gate.output(0.56).scale == 0.0


REFUSED = {
    'sent long ago': {'sent': -0.51, 'judged': -0.51},
    'judged long ago and sent again now': {'judged': -0.51},
    'judged ages ago': {'judged': -1e9},
    'stamped long ago, without a time of judging': {'stamp': -0.51, 'judged': None},
    'stamped in 1970, without a time of judging': {'stamp': -1e9, 'judged': None},
    'stamped an hour ahead, without a time of judging': {'stamp': 3600.0, 'judged': None},
    'sent ahead of the clock': {'sent': CLOCK_TOLERANCE + 0.01},
    'judged ahead of the clock': {'judged': CLOCK_TOLERANCE + 0.01},
}


@pytest.mark.parametrize('times', REFUSED.values(), ids=REFUSED.keys())
def test_what_proves_nothing_about_now_never_opens_and_stops(times):
    gate = SpeedGate(GateSettings())
    for step in range(100):
        say(gate, Verdict.SAFE, 0.02 * step, **times)
        assert gate.output(0.02 * step).scale == 0.0
    gate = opened(GateSettings(release_count=3))
    say(gate, Verdict.SAFE, 0.1, **times)
    assert gate.output(0.1).scale == 0.0
    for number in range(3):
        assert gate.output(0.1 + 0.01 * number).scale == 0.0
        say(gate, Verdict.SAFE, 0.11 + 0.01 * number)
    assert gate.output(0.13).scale == 1.0


@pytest.mark.parametrize(('what', 'back', 'refused'), [('stamp', -5.0, 16), ('sent', -0.45, 13)])
def test_going_back_stops_until_it_has_been_silent_for_the_timeout(what, back, refused):
    gate = opened(GateSettings(timeout=0.5))
    say(gate, Verdict.SAFE, 0.1, **{what: -0.2})
    assert gate.output(0.1).scale == 0.0
    # A simulation that begins anew, or a clock that was set back by a little, is taken again.
    for step in range(40):
        say(gate, Verdict.SAFE, 0.2 + 0.02 * step, **{what: back})
        assert (gate.output(0.2 + 0.02 * step).scale == 1.0) == (step >= refused + 4)


def test_one_verdict_repeated_neither_opens_nor_keeps_open():
    gate = SpeedGate(GateSettings(timeout=0.5))
    for step in range(100):
        now = 0.02 * step
        gate.judge(Verdict.SAFE, 1.0, 'SAFE', timing(now, stamp=-now), now)
        assert gate.output(now).scale == 0.0
    gate = opened(GateSettings(timeout=0.5))
    for step in range(1, 100):
        now = 0.02 * step
        gate.judge(Verdict.SAFE, 1.0, 'SAFE', timing(now, stamp=-now), now)
        assert (gate.output(now).scale > 0.0) == (now <= 0.5)


def test_a_repeat_that_is_not_safe_acts():
    gate = opened(GateSettings())
    say(gate, Verdict.UNKNOWN, 0.1, text='UNKNOWN: no new input', stamp=-0.1)
    assert gate.output(0.1) == GateOutput(0.0, 'UNKNOWN: no new input')


def test_a_simulation_may_be_stamped_as_it_likes_if_the_time_of_judging_is_told():
    gate = SpeedGate(GateSettings())
    for step in range(5):
        say(gate, Verdict.SAFE, 0.1 * step, stamp=63.0 + step)
    assert gate.output(0.4).scale == 1.0


@given(st.integers(2, 19), st.integers(0, 30))
def test_what_is_violated_again_and_again_stops_at_its_second_violation(gap, before):
    gate = opened(GateSettings())
    now = 0.0
    for _ in range(before):
        now += 0.1
        say(gate, Verdict.SAFE, now)
    for repeat in range(20):
        for place in range(gap):
            now += 0.1
            say(gate, Verdict.VIOLATED if place == gap - 1 else Verdict.SAFE, now)
            if repeat >= 2 and gap <= 10:
                # And it stays so, for as long as it comes again.
                assert gate.output(now).scale == 0.0
        if repeat == 1:
            assert gate.output(now).scale == 0.0


@given(st.floats(0.0, 2.0), st.floats(0.0, 2.0), st.floats(0.0, 1.0), st.floats(0.001, 1.0))
def test_speed_falls_with_the_margin_and_never_below_the_least(one, other, least, slow):
    gate = opened(GateSettings(slow_margin=slow, min_speed_scale=least))
    scales = []
    for number, margin in enumerate(sorted((one, other))):
        say(gate, Verdict.SAFE, 0.1 + 0.1 * number, margin)
        output = gate.output(0.1 + 0.1 * number)
        scales.append(output.scale)
        assert least <= scales[-1] <= 1.0
        assert scales[-1] == 1.0 or margin < slow
        assert not str(output).startswith(('SLOW, 100%', 'SLOW, 0%'))
    assert scales[0] <= scales[1]


@pytest.mark.parametrize('slow_margin', [0.0, 0.1])
def test_a_violation_is_slow_until_it_has_been_confirmed(slow_margin):
    settings = GateSettings(slow_margin=slow_margin, min_speed_scale=0.25, trigger_count=2)
    gate = opened(settings)
    say(gate, Verdict.VIOLATED, 0.1, -0.5, 'VIOLATED: too fast')
    assert str(gate.output(0.1)) == 'SLOW, 25%: VIOLATED (1 of 2): too fast'
    say(gate, Verdict.VIOLATED, 0.2, -0.5, 'VIOLATED: too fast')
    assert str(gate.output(0.2)) == 'STOP: VIOLATED: too fast'


@pytest.mark.parametrize(
    ('verdict', 'margin'),
    [(Verdict.UNKNOWN, 1.0), (Verdict.SAFE, math.nan), (Verdict.SAFE, math.inf)],
)
def test_unknown_and_a_margin_that_is_not_finite_stop_at_once(verdict, margin):
    gate = opened(GateSettings(trigger_count=3))
    say(gate, verdict, 0.1, margin, 'why')
    assert gate.output(0.1).scale == 0.0


def test_tripped_from_outside_it_needs_a_full_release():
    gate = opened(GateSettings(release_count=2))
    gate.trip('two publishers', 0.0)
    assert gate.output(0.0) == GateOutput(0.0, 'two publishers')
    for number, scale in ((1, 0.0), (2, 1.0)):
        say(gate, Verdict.SAFE, 0.1 * number)
        assert gate.output(0.1 * number).scale == scale


@pytest.mark.parametrize(
    'wrong',
    [
        {'slow_margin': -0.1},
        {'slow_margin': math.nan},
        {'min_speed_scale': 1.1},
        {'timeout': 0.0},
        {'trigger_count': 4, 'trigger_window': 3},
        {'trigger_count': 0},
        {'release_count': 0},
    ],
)
def test_settings_out_of_range_are_refused(wrong):
    with pytest.raises(OccError, match='allowed are'):
        GateSettings(**wrong)
