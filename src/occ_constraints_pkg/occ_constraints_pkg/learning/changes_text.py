# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The comparison of two constraints files as text and as plain values."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from occ_constraints_pkg.learning.changes import (
    BoundChange,
    FileComparison,
    RuleChange,
    ValueChange,
)
from occ_constraints_pkg.learning.evidence import describe_sample
from occ_constraints_pkg.rules.constraints_file import Constraints
from occ_constraints_pkg.rules.difference import Difference
from occ_constraints_pkg.rules.rule import Literal, Rule, apart
from occ_constraints_pkg.rules.space import FeatureSpace
from occ_constraints_pkg.terminal import printable
from occ_constraints_pkg.wording import count_of

# Features of an example point that are shown; all are in JSON.
_MOST_VALUES = 6
_LARGEST = float(np.finfo(np.float64).max)


def describe_comparison(result: FileComparison) -> str:
    """Return where verdicts differ, with an example for each rule, and then what changed.

    The files are called A and B, as in the help of the command.
    """
    lines = list(_verdict_lines(result))
    if result.rules:
        lines += ['', 'rules from A to B:']
        for change in result.rules:
            lines += _rule_lines(result, change)
    for title, changes in (('features', result.features), ('feature map', result.feature_map)):
        if changes:
            lines += ['', f'{title} from A to B:']
            lines += [
                f'  {change.path}: {_plain(change.before)} -> {_plain(change.after)}'
                for change in changes
            ]
    if result.feature_map:
        lines.append('so the same messages can give other values, and other verdicts')
    return '\n'.join(map(printable, lines))


def _verdict_lines(result: FileComparison) -> Iterator[str]:
    verdicts = result.verdicts
    if verdicts.problem:
        yield f'verdicts not compared: {verdicts.problem}'
        return
    if verdicts.is_same:
        yield 'same verdicts for every input within bounds'
    if verdicts.differs:
        yield 'different verdicts:'
    for name, is_without in zip('AB', verdicts.without_rules, strict=True):
        if is_without and not all(verdicts.without_rules):
            yield f'  {name} enables no rule, so every verdict of it is UNKNOWN'
    for name in verdicts.missing:
        has = 'A' if name in result.first.space.names else 'B'
        yield f'  {name} is a feature of {has} only: without it, only {has} says UNKNOWN'
    for item in verdicts.unknown:
        knows, other = ('A', 'B') if item.known_to_first else ('B', 'A')
        yield (
            f'  {item.feature} = {item.value!r} is within the bounds of {knows}; to {other} it is '
            'UNKNOWN'
        )
    for name, own, found in (
        ('A', result.first, verdicts.only_first),
        ('B', result.second, verdicts.only_second),
    ):
        for rule in own.rules:
            pieces = [item for item in found if item.rule == rule.id]
            if pieces:
                yield from _piece_lines(name, own, rule, pieces)
    if any(verdicts.unproven):
        more = 'more than this' if verdicts.differs else 'no difference found, but this'
        named = ', '.join(
            f'{_listed(ids)} of {name}'
            for name, ids in zip('AB', verdicts.unproven, strict=True)
            if ids
        )
        tried = f'{verdicts.boxes} boxes'
        if verdicts.points:
            tried += f' and {count_of(verdicts.points, "point")}, at random and at corners'
        yield f'not proven: {more} may differ by {named}; looked at were {tried}'


def _piece_lines(
    name: str, own: Constraints, rule: Rule, pieces: Sequence[Difference]
) -> Iterator[str]:
    largest, *others = pieces
    other = 'B' if name == 'A' else 'A'
    region = _region(own.space, rule, largest)
    more = f' (the largest of {len(pieces)} boxes)' if others else ''
    yield f'  {rule.id:<9} only {name} flags {region or "it"}{more}'
    members = [member for literal in rule.literals for member in literal.members]
    names = dict.fromkeys([*(own.space.names[member] for member in members), *largest.point])
    shown = list(names) if len(names) <= _MOST_VALUES else _about(own.space, rule, largest)
    values = ', '.join(f'{item} = {largest.point[item]!r}' for item in shown)
    left = len(largest.point) - len(shown)
    rest = f' (and {left} more, see --json)' if left else ''
    yield f'            such as {values}{rest}: VIOLATED by {name}, SAFE by {other}'


def _about(space: FeatureSpace, rule: Rule, piece: Difference) -> list[str]:
    """Return the features that decide on the rule at the example."""
    sample = np.array([piece.point[name] for name in space.names])
    return [space.names[feature] for feature in rule.deciding(sample)]


def _region(space: FeatureSpace, rule: Rule, piece: Difference) -> str:
    """Return the box in words, as far as it is about the features that decide on its rule."""
    literals = []
    for name in _about(space, rule, piece):
        if name not in piece.limits:
            continue
        index = space.index(name)
        low, high = piece.limits[name]
        lowest, highest = space.finite_bounds[:, index]
        literals += [_shortest(index, '>', low)] if low > lowest else []
        literals += [_shortest(index, '<', high)] if high < highest else []
    return Rule(rule.id, tuple(literals)).words(space) if literals else ''


def _shortest(feature: int, side: str, first: float) -> Literal:
    """Return the literal that begins with this value, strict if its bound has fewer digits."""
    whole = Literal(feature, f'{side}=', first)
    beside = whole.last
    if math.isfinite(beside) and len(repr(beside)) < len(repr(first)):
        return Literal(feature, side, beside)
    return whole


def _listed(ids: Sequence[str]) -> str:
    shown = ', '.join(ids[:5])
    return f'{shown} and {len(ids) - 5} more' if len(ids) > 5 else shown


def _rule_lines(result: FileComparison, change: RuleChange) -> Iterator[str]:
    before, after = change.before, change.after
    if before is None or after is None:
        rule, space = (after, result.second.space) if after else (before, result.first.space)
        assert rule is not None
        notes = '' if rule.enabled else '   (disabled)'
        notes += f'   # {rule.note}' if rule.note else ''
        by_hand = ' (not as learned)' if change.is_edited else ''
        yield f'  {rule.id:<9} {change.kind}{by_hand}: {rule.words(space)}{notes}'
        return
    if change.kind == 'conditions':
        yield (
            f'  {after.id:<9} conditions changed: {before.words(result.first.space)} -> '
            f'{after.words(result.second.space)}'
        )
    for bound in change.bounds:
        yield f'  {after.id:<9} {_bound_words(bound)}'
        for sample in bound.demonstrations:
            which = 'A' if bound.flags_more else 'B'
            yield f'            safe demonstration of {which} in between: {describe_sample(sample)}'
    edits = list(_edits(change))
    if edits:
        yield f'  {after.id:<9} edited: {"; ".join(edits)}'


def _edits(change: RuleChange) -> Iterator[str]:
    before, after = change.before, change.after
    assert before is not None
    assert after is not None
    if before.id != after.id:
        yield f'called {before.id} before'
    if before.enabled != after.enabled:
        yield 'enabled' if after.enabled else 'disabled'
    if before.note != after.note:
        yield f'note {before.note!r} -> {after.note!r}'
    if (change.bounds or change.gone or change.new) and change.is_edited:
        yield 'not the formula that was learned'


def _bound_words(bound: BoundChange) -> str:
    suffix = '' if bound.unit == '1' else f' {bound.unit}'
    old, new = bound.before, bound.after
    effect = 'flags more' if bound.flags_more else 'flags less'
    if old.bound == new.bound:
        return f'{bound.name} {old.operator} -> {new.operator} {old.bound:.4g}{suffix}, {effect}'
    texts = apart(old.bound, new.bound)
    operators = (
        old.operator if old.operator == new.operator else f'{old.operator} -> {new.operator}'
    )
    share = '' if bound.relative is None else f', {bound.relative:+.2%} of the demonstrated range'
    return (
        f'{bound.name} {operators} {texts[0]} -> {texts[1]}{suffix} ({bound.change:+.4g}{suffix}'
        f'{share}), {effect}'
    )


def _plain(value: Any) -> str:
    return 'absent' if value is None else str(value)


def comparison_document(result: FileComparison) -> dict[str, Any]:
    """Return all of the comparison as plain values, ready for JSON."""
    verdicts = result.verdicts
    if verdicts.problem:
        summary = 'not compared'
    elif verdicts.differs:
        summary = 'different'
    else:
        summary = 'same' if verdicts.is_same else 'not proven'
    return {
        'same': result.is_same,
        'verdicts': summary,
        'problem': verdicts.problem or None,
        'only_a': [_difference_document(item) for item in verdicts.only_first],
        'only_b': [_difference_document(item) for item in verdicts.only_second],
        'unknown': [
            {
                'feature': item.feature,
                'value': item.value,
                'known_to': 'a' if item.known_to_first else 'b',
            }
            for item in verdicts.unknown
        ],
        'missing_features': list(verdicts.missing),
        'without_rules': dict(zip('ab', verdicts.without_rules, strict=True)),
        'unproven': {name: list(ids) for name, ids in zip('ab', verdicts.unproven, strict=True)},
        'boxes': verdicts.boxes,
        'points': verdicts.points,
        'rules': [_rule_document(result, change) for change in result.rules],
        'features': [_value_document(change) for change in result.features],
        'feature_map': [_value_document(change) for change in result.feature_map],
    }


def _difference_document(item: Difference) -> dict[str, Any]:
    return {
        'rule': item.rule,
        'point': dict(item.point),
        'limits': {
            name: [None if abs(end) == _LARGEST else end for end in limits]
            for name, limits in item.limits.items()
        },
        'verdicts': [verdict.name for verdict in item.verdicts],
    }


def _value_document(change: ValueChange) -> dict[str, Any]:
    return {'path': change.path, 'a': change.before, 'b': change.after}


def _rule_document(result: FileComparison, change: RuleChange) -> dict[str, Any]:
    def side(rule: Rule | None, space: FeatureSpace) -> dict[str, Any] | None:
        if rule is None:
            return None
        return {
            'id': rule.id,
            'text': rule.words(space),
            'formula': rule.formula(space),
            'enabled': rule.enabled,
            'note': rule.note,
        }

    return {
        'kind': change.kind,
        'a': side(change.before, result.first.space),
        'b': side(change.after, result.second.space),
        'edited_since_learned': change.is_edited,
        'bounds': [
            {
                'name': bound.name,
                'unit': bound.unit,
                'operators': [bound.before.operator, bound.after.operator],
                'bounds': [bound.before.bound, bound.after.bound],
                'change': bound.change if math.isfinite(bound.change) else None,
                'relative': bound.relative,
                'flags': 'more' if bound.flags_more else 'less',
                'demonstrations': [dict(sample) for sample in bound.demonstrations],
            }
            for bound in change.bounds
        ],
        'conditions_gone': [literal.text(result.first.space) for literal in change.gone],
        'conditions_new': [literal.text(result.second.space) for literal in change.new],
    }
