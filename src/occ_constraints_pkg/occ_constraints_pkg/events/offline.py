# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The events of judged rows, such as those of a recording: what the live ones would have been."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import Any

import numpy as np

from occ_constraints_pkg.events.derivation import RuleSample, Sample, Settings, VerdictEvents
from occ_constraints_pkg.events.event import Event
from occ_constraints_pkg.rules.constraints_file import literal_documents
from occ_constraints_pkg.rules.ruleset import RuleSet
from occ_constraints_pkg.rules.verdict import Judgement, Verdict


def events_of_rows(
    rule_set: RuleSet,
    values: np.ndarray,
    stamps_ns: np.ndarray,
    times_ns: np.ndarray,
    episodes: np.ndarray,
    settings: Settings,
    *,
    robot: str = '/',
) -> list[Event]:
    """Return the events of rows as the recorder derives them live, in the order of their ends.

    Silence is no event here, for a row only shows after it.

    Args:
        rule_set: judges the rows.
        values: (n, k) the features.
        stamps_ns: (n,) header stamps.
        times_ns: (n,) times of arrival.
        episodes: (n,) the same number for the rows of one episode.
        settings: what counts as one event.
        robot: its namespace.
    """
    problem = rule_set.problem
    judgement = Judgement.unknown(len(values)) if problem else rule_set.judge(values)
    events = []
    for episode in np.unique(episodes).tolist():
        derived = VerdictEvents(robot, settings)
        rows = np.flatnonzero(episodes == episode)
        changes = []
        for row in rows.tolist():
            sample = values[row]
            verdict = Verdict(judgement.verdict[row])
            is_violated = verdict is Verdict.VIOLATED
            time = int(times_ns[row])
            changes += derived.add(
                Sample(
                    verdict,
                    float(judgement.margin[row]),
                    int(stamps_ns[row]),
                    time,
                    time,
                    rules=tuple(violated_rules(rule_set, sample)) if is_violated else (),
                    reason=problem,
                    rule_set=rule_set.fingerprint,
                    nearest=partial(nearest_rule, rule_set, sample),
                )
            )
        if len(rows):
            # The last verdict of an episode is valid as long as the one before.
            changes += derived.close(np.iinfo(np.int64).max, '')
        events += [event for event, phase in changes if phase == 'ended']
    return events


def violated_rules(rule_set: RuleSet, sample: np.ndarray) -> Iterator[RuleSample]:
    """Yield the enabled rules that are true on one sample (k,)."""
    margins = rule_set.rule_margins(sample)
    for index in rule_set.violated_rules(sample):
        yield _rule_sample(rule_set, int(index), sample, float(margins[index]))


def nearest_rule(rule_set: RuleSet, sample: np.ndarray) -> RuleSample | None:
    """Return the enabled rule with the smallest margin on one sample (k,); None without any."""
    margins = rule_set.rule_margins(sample)
    enabled = rule_set.order
    if not len(enabled) or np.isnan(margins[enabled]).all():
        return None
    index = int(enabled[np.nanargmin(margins[enabled])])
    return _rule_sample(rule_set, index, sample, float(margins[index]))


def bounds_of(rule_set: RuleSet, rule: str) -> tuple[dict[str, Any], ...]:
    """Return the literals of a rule as in a constraints file; none if there is no such rule."""
    found = next((item for item in rule_set.rules if item.id == rule), None)
    return () if found is None else tuple(literal_documents(found, rule_set.space))


def _rule_sample(rule_set: RuleSet, index: int, sample: np.ndarray, margin: float) -> RuleSample:
    rule, space = rule_set.rules[index], rule_set.space
    is_true = bool(rule.holds(sample[None])[0])
    features = rule.fired(sample) if is_true else rule.deciding(sample)
    return RuleSample(
        rule.id,
        rule.words(space, sample),
        margin,
        {space.names[feature]: float(sample[feature]) for feature in features},
        tuple(literal_documents(rule, space)),
    )
