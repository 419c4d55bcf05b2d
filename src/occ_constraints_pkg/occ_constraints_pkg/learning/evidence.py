# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Evidence: which demonstrations a bound rests on, for the file, for people and for machines."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from typing import Any

import numpy as np

from occ_constraints_pkg.documents import did_you_mean
from occ_constraints_pkg.errors import ConfigurationError
from occ_constraints_pkg.learning.conditional.rules import ConditionalRule
from occ_constraints_pkg.rules.constraints_file import Constraints
from occ_constraints_pkg.rules.rule import Literal, Rule
from occ_constraints_pkg.rules.ruleset import RuleSet
from occ_constraints_pkg.rules.space import FeatureSpace
from occ_constraints_pkg.terminal import printable

# Distance to a bound, in parts of the demonstrated range, within which a sample counts as near.
NEAR = 0.01
# Longer formulas have no evidence: nobody would read it, and every program would have to parse it.
MOST_LITERALS = 2000
# Of conditional rules only, see ConditionalRule.
_PROOF = ('expected', 'seen', 'evidence')
# Samples listed per bound, each of another episode.
_MOST_NAMED = 3


@dataclass(frozen=True, eq=False)
class LiteralEvidence:
    """The samples that hold a bound where it is.

    These SAFE samples would be violations without the literal, because all other literals of its
    rule are true on them. They keep the bound from moving inward.

    Attributes:
        near: how many lie within :data:`NEAR` of the bound.
        episodes: of how many episodes these are.
        closest: (position, feature, value) of the closest, near or not, at most one per episode.
            The feature is another one than the literal's if a family shares its bounds.
    """

    near: int
    episodes: int
    closest: tuple[tuple[int, int, float], ...]


@dataclass(frozen=True, eq=False)
class RuleEvidence:
    """The evidence for a rule.

    Attributes:
        rule: the rule.
        flagged: training samples on which it is true, treated as outliers.
        literals: the evidence for each of its literals, in order.
    """

    rule: Rule
    flagged: int
    literals: tuple[LiteralEvidence, ...]


def gather_evidence(
    rule_set: RuleSet,
    rows: np.ndarray,
    safe: np.ndarray,
    episodes: np.ndarray,
    families: Sequence[Sequence[int]] = (),
) -> list[RuleEvidence]:
    """Find the evidence for all enabled rules.

    Takes one pass over the column for each distinct literal; if no sample is near, one more over
    the other columns of its rule.

    Args:
        rule_set: the rules.
        rows: (n, k) finite samples that the rules were learned from.
        safe: (n,) bool, whether the verdict on each is SAFE.
        episodes: (n,) the episode of each.
        families: positions of features with shared bounds; each bound is held by the member closest
            to it, whichever feature the literal names. A literal about a family always is.
    """
    together = {member: tuple(family) for family in families for member in family}
    rules = [rule_set.rules[index] for index in rule_set.order]
    holders: dict[Literal, list[Rule]] = {}
    for rule in rules:
        for literal in rule.literals:
            holders.setdefault(literal, []).append(rule)

    def members(literal: Literal) -> tuple[int, ...]:
        return together.get(literal.members[0], literal.members)

    inside, outside = np.flatnonzero(safe), np.flatnonzero(~safe)
    found: dict[tuple[str, Literal], LiteralEvidence] = {}
    group: tuple[tuple[int, ...], bool] = ((), False)
    values, features = np.empty(0), np.empty(0)
    # Sorted so that only one column has to be copied at a time.
    for literal in sorted(holders, key=lambda item: (members(item), item.is_upper)):
        if (members(literal), literal.is_upper) != group:
            group = members(literal), literal.is_upper
            values, features = _extreme(rows, inside, *group)
        away = literal.distances(values)
        away[literal.holds(values)] = np.inf
        near = np.flatnonzero(away <= NEAR * rule_set.scale[literal.members[0]])
        for rule in holders[literal]:
            others = [item for item in rule.literals if item != literal]
            held = _where_true(others, rows, inside, near)
            shown = held
            if not len(held):
                shown = _where_true(others, rows, inside, np.flatnonzero(away < np.inf))
            closest = _closest(shown, away[shown], episodes[inside[shown]])
            found[rule.id, literal] = LiteralEvidence(
                len(held),
                len(np.unique(episodes[inside[held]])),
                tuple(
                    (int(inside[place]), int(features[place]), float(values[place]))
                    for place in closest
                ),
            )
    everything = np.arange(len(outside))
    return [
        RuleEvidence(
            rule,
            len(_where_true(rule.literals, rows, outside, everything)),
            tuple(found[rule.id, literal] for literal in rule.literals),
        )
        for rule in rules
    ]


def evidence_document(
    evidence: Iterable[RuleEvidence],
    space: FeatureSpace,
    origin: Callable[[int], Mapping[str, int]],
    conditional: Mapping[str, ConditionalRule],
) -> dict[str, Any]:
    """Return evidence as plain values for the constraints file.

    The formula is stored to detect later edits of the rule.

    Args:
        evidence: of each rule.
        space: the features.
        origin: maps the position of a sample to its source; may be empty.
        conditional: by its id, what a rule stands for that says more than the box does.
    """
    names = space.names
    return {
        'near': NEAR,
        'rules': [
            {
                'id': item.rule.id,
                'formula': item.rule.formula(space),
                'flagged': item.flagged,
                **_proof(conditional.get(item.rule.id)),
                'literals': [
                    {
                        'near': part.near,
                        'episodes': part.episodes,
                        'closest': [
                            {
                                'value': value,
                                **(
                                    {} if (feature,) == own.members else {'feature': names[feature]}
                                ),
                                **origin(row),
                            }
                            for row, feature, value in part.closest
                        ],
                    }
                    for own, part in zip(item.rule.literals, item.literals, strict=True)
                ],
            }
            for item in evidence
        ],
    }


def _proof(rule: ConditionalRule | None) -> dict[str, float]:
    """Return why a conditional rule is no chance; empty for other rules."""
    return {} if rule is None else {name: float(getattr(rule, name)) for name in _PROOF}


def _extreme(
    rows: np.ndarray, positions: np.ndarray, members: tuple[int, ...], smallest: bool
) -> tuple[np.ndarray, np.ndarray]:
    """Return (m,) each sample's smallest or largest member, and which feature that is."""
    values = rows[positions, members[0]]
    features = np.full(len(values), members[0], dtype=np.int64)
    for member in members[1:]:
        other = rows[positions, member]
        beyond = other < values if smallest else other > values
        values[beyond], features[beyond] = other[beyond], member
    return values, features


def _where_true(
    literals: Iterable[Literal], rows: np.ndarray, positions: np.ndarray, places: np.ndarray
) -> np.ndarray:
    """Return those of ``places``, which index ``positions`` of rows, where all literals hold."""
    for literal in literals:
        first, *others = literal.members
        holds = literal.holds(rows[positions[places], first])
        for member in others:
            holds |= literal.holds(rows[positions[places], member])
        places = places[holds]
    return places


def _closest(places: np.ndarray, away: np.ndarray, episodes: np.ndarray) -> list[int]:
    """Return the places of the smallest distances, one of each episode, closest first."""
    away = away.copy()
    chosen: list[int] = []
    while len(chosen) < _MOST_NAMED and len(away):
        best = int(away.argmin())
        if away[best] == np.inf:
            break
        chosen.append(int(places[best]))
        away[episodes == episodes[best]] = np.inf
    return chosen


_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)


def why_document(constraints: Constraints, rule_id: str) -> dict[str, Any]:
    """Return a rule and its evidence as plain values, ready for JSON.

    Evidence refers to the learned bounds. If a bound of the rule was moved, or a literal added or
    removed, other samples would be near, so there is no evidence and ``missing`` says why.

    Args:
        constraints: the file.
        rule_id: the rule.

    Raises:
        ConfigurationError: there is no such rule.
    """
    space = constraints.rule_set.space
    ids = [rule.id for rule in constraints.rule_set.rules]
    if rule_id not in ids:
        hint = did_you_mean(rule_id, ids) or '; occ show FILE prints the ids of all'
        raise ConfigurationError(f'the constraints have no rule {rule_id!r}{hint}')
    rule = constraints.rule_set.rules[ids.index(rule_id)]
    document: dict[str, Any] = {
        'id': rule.id,
        'text': rule.words(space),
        'formula': rule.formula(space),
        'enabled': rule.enabled,
        'note': rule.note,
    }
    texts = [literal.text(space) for literal in rule.literals]
    learned = _learned(constraints, rule)
    missing = _missing(constraints, rule, learned)
    if missing or learned is None:
        return {**document, 'missing': missing, 'literals': [{'text': text} for text in texts]}
    return {
        **document,
        'missing': None,
        'flagged': learned['flagged'],
        **{name: learned[name] for name in _PROOF if name in learned},
        'near': constraints.evidence['near'],
        'literals': [
            {
                'text': text,
                'near': item['near'],
                'episodes': item['episodes'],
                'closest': [_traced(constraints, sample) for sample in item['closest']],
            }
            for text, item in zip(texts, learned['literals'], strict=True)
        ],
    }


def describe_why(document: Mapping[str, Any]) -> str:
    """Return what :func:`why_document` gives as lines of text."""
    lines = [f'{document["id"]}: {document["text"]}']
    if document['note']:
        lines[0] += f'   # {document["note"]}'
    if document['missing']:
        lines.append(f'no evidence: {document["missing"]}')
        return '\n'.join(map(printable, lines))
    if all(name in document for name in _PROOF):
        lines.append(
            f'expected {document["expected"]:.1%} of the time, seen {document["seen"]:.2%}, '
            f'evidence {document["evidence"]:.0f}'
        )
    lines.append(
        f'training samples beyond its bounds, taken for outliers: {document["flagged"]}'
        if document['flagged']
        else 'no training sample lies beyond its bounds'
    )
    for literal in document['literals']:
        lines.append(f'  {literal["text"]}: {_describe_support(literal, document["near"])}')
        lines += [f'    {describe_sample(sample)}' for sample in literal['closest']]
    return '\n'.join(map(printable, lines))


def _learned(constraints: Constraints, rule: Rule) -> Mapping[str, Any] | None:
    """Return the stored evidence for the rule, None if there is none."""
    items = constraints.evidence.get('rules', ())
    return next((item for item in items if item['id'] == rule.id), None)


def _missing(constraints: Constraints, rule: Rule, learned: Mapping[str, Any] | None) -> str | None:
    """Return why there is no evidence for the rule as it is now, None if there is."""
    if not constraints.evidence:
        return (
            'the file holds none; it was written by hand, by an earlier version, or with more than '
            f'{MOST_LITERALS} literals'
        )
    if learned is None:
        return 'the rule was not learned, but written by hand or made from others'
    if learned['formula'] != rule.formula(constraints.rule_set.space):
        return f'the rule was changed since it was learned, when it read {learned["formula"]}'
    if len(learned['literals']) != len(rule.literals):
        return 'the file does not have it for all literals of the rule'
    return None


def _traced(constraints: Constraints, sample: Mapping[str, Any]) -> dict[str, Any]:
    """Add the name of the source, and times in seconds and as a date."""
    found = {key: sample[key] for key in ('value', 'feature') if key in sample}
    sources = constraints.provenance.get('bags', ())
    if 0 <= sample.get('source', -1) < len(sources):
        source = sources[sample['source']]
        found.update(source=source.get('name'), sha256=source.get('sha256'))
    if 'time_ns' in sample:
        if constraints.feature_map is not None:
            found['topic'] = constraints.feature_map.get('pace')
        found['time_s'] = sample['time_ns'] / 1e9
        found['time'] = _calendar(sample['time_ns'])
        found['time_ns'] = sample['time_ns']
    if 'row' in sample:
        found['row'] = sample['row']
    return found


def _calendar(time_ns: int) -> str:
    return (_EPOCH + timedelta(microseconds=time_ns // 1000)).isoformat(timespec='microseconds')


def _describe_support(literal: Mapping[str, Any], near: float) -> str:
    if not literal['closest']:
        return 'no safe sample would be flagged without it'
    within = f'within {near:.0%} of the demonstrated range'
    count = (
        f'safe samples {within}: {literal["near"]} (episodes: {literal["episodes"]})'
        if literal['near']
        else f'no safe sample {within}'
    )
    return f'{count}; closest, one per episode:'


def describe_sample(sample: Mapping[str, Any]) -> str:
    """Return value, source and time of one of the closest samples of :func:`why_document`."""
    text = f'{sample["value"]!r}'
    text += f' ({sample["feature"]}, of the family)' if 'feature' in sample else ''
    if sample.get('source'):
        text += f' in {sample["source"]}'
    if 'time_ns' in sample:
        text += f', {sample["topic"]}' if sample.get('topic') else ''
        text += f' at {_seconds(sample["time_ns"])} s ({sample["time"]})'
    if 'row' in sample:
        text += f', row {sample["row"]}'
    return text


def _seconds(time_ns: int) -> str:
    """Return seconds with all nine decimals, more than a float holds."""
    seconds, rest = divmod(time_ns, 10**9)
    return f'{seconds}.{rest:09d}'
