# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Warnings and what became of them, on data small enough to know the answer."""

import numpy as np
import pytest
from occ_constraints_pkg.checking.early_warning import Onset, warning_record
from occ_constraints_pkg.checking.timeline import make_timeline
from occ_constraints_pkg.datasets.dataset import Dataset
from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.rules import Feature, FeatureSpace, Literal, Rule, RuleSet

SPACE = FeatureSpace((Feature('x', 'm'),))
RULES = RuleSet(SPACE, (Rule('FAR', (Literal(0, '>', 4.0),)),), np.array([[0.0, 4.0]]))


def record(*episodes, horizon=1.0, **more):
    """Judge x of some episodes, whose samples are 0.25 s apart."""
    steps = [np.arange(len(episode)) * 250_000_000 for episode in episodes]
    data = Dataset(
        SPACE.names,
        np.concatenate([np.array(episode, dtype=np.float64)[:, None] for episode in episodes]),
        np.concatenate(steps),
        np.repeat(np.arange(len(episodes)), [len(episode) for episode in episodes]),
        times_ns=np.concatenate(steps),
        sources=({'name': 'one'},),
    )
    timeline = make_timeline(RULES, data, RULES.judge(data.values), bridge=0.25)
    return warning_record(timeline, RULES, horizon=horizon, bridge=0.25, **more)


def test_a_steady_approach_is_warned_of_by_the_horizon():
    # 1 m/s: from 1.0 s on, at 3.0, the boundary is 1 s away; at 4.25 it is passed.
    approach = [2.0, 2.25, 2.5, 2.75, 3.0, 3.25, 3.5, 3.75, 4.0, 4.25]
    assert record(approach).onsets == (Onset(0, 0, 2.25, 0, 1.25, 0),)
    assert record(approach, horizon=0.5).onsets == (Onset(0, 0, 2.25, 0, 0.75, 0),)
    assert record(approach).warnings == 1
    assert record(approach).false == 0


def test_a_jump_is_not_foreseen_and_a_turn_is_a_false_warning():
    jump = record([1.0, 1.0, 1.0, 1.0, 5.0])
    assert [onset.warned for onset in jump.onsets] == [0.0]
    assert (jump.warnings, jump.false) == (0, 0)
    turn = record([2.5, 2.75, 3.0, 3.25, 3.25, 3.0, 2.75, 2.5, 2.25])
    assert turn.onsets == ()
    assert (turn.warnings, turn.false) == (1, 1)


def test_a_violation_at_the_start_or_after_a_break_is_none():
    assert record([5.0, 1.0, 1.0]).onsets == ()
    short = record([1.0, 1.0, 1.0, 5.0, 4.0, 5.0, 4.0])
    assert [onset.start for onset in short.onsets] == [0.75]
    again = record([1.0, 1.0, 1.0, 5.0, 4.0, 4.0, 4.0, 5.0])
    assert [onset.start for onset in again.onsets] == [0.75, 1.75]


def test_episodes_do_not_continue_one_another():
    # Seen as one, x would rise from 1 to 3.
    got = record([1.0, 1.0, 1.0], [3.0, 3.0, 3.0], [4.25, 4.25])
    assert (got.onsets, got.warnings) == ((), 0)
    calls = []
    warned = [[3.0, 3.5]] * 2 + [[2.0, 2.5, 3.0, 3.5]]
    got = record(*warned, progress=lambda *numbers: calls.append(numbers))
    assert (got.warnings, got.false) == (1, 1)


def test_tables_know_no_time():
    data = Dataset(SPACE.names, np.zeros((3, 1)), np.arange(3), np.zeros(3, dtype=np.int64))
    timeline = make_timeline(RULES, data, RULES.judge(data.values))
    with pytest.raises(OccError, match='know no time'):
        warning_record(timeline, RULES)
