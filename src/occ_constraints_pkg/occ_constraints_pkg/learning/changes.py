# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""What changed from one constraints file to another: rules, bounds, features, feature map."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from occ_constraints_pkg.learning.evidence import why_document
from occ_constraints_pkg.rules.constraints_file import Constraints
from occ_constraints_pkg.rules.difference import VerdictComparison, compare_verdicts
from occ_constraints_pkg.rules.matching import matched_rules, rule_ends
from occ_constraints_pkg.rules.rule import Literal, Rule
from occ_constraints_pkg.rules.space import Feature

_MISSING: Any = object()


@dataclass(frozen=True, eq=False)
class BoundChange:
    """A literal of which the bound, or whether it includes the bound, changed.

    Attributes:
        name: what it is about, such as ``v_x`` or ``any hazards``.
        unit: of its bound.
        before: the literal in the first file.
        after: the literal in the second.
        relative: the change of the bound in parts of the range that the first file's demonstrations
            have; ``None`` where this feature was constant.
        demonstrations: demonstrated samples, safe by the file with the wider safe set, that the
            rule of the other file flags; as far as the evidence in the former names them, see
            :func:`why_document`.
    """

    name: str
    unit: str
    before: Literal
    after: Literal
    relative: float | None
    demonstrations: tuple[Mapping[str, Any], ...] = ()

    @property
    def change(self) -> float:
        """By how much the bound moved, in the unit."""
        return self.after.bound - self.before.bound

    @property
    def flags_more(self) -> bool:
        """Whether the literal is true for more values than before."""
        return self.after.contains(self.before)


@dataclass(frozen=True, eq=False)
class RuleChange:
    """A rule in one file or in both, which differs.

    Attributes:
        before: the rule in the first file, ``None`` if it is new.
        after: the rule in the second file, ``None`` if it is gone.
        bounds: its bounds that moved.
        gone: literals of the first file for whose feature and side the second has none.
        new: literals of the second file likewise.
        is_edited: whether, by the second file's record of what was learned, somebody changed the
            formula since; ``None`` where there is no record.
    """

    before: Rule | None
    after: Rule | None
    bounds: tuple[BoundChange, ...] = ()
    gone: tuple[Literal, ...] = ()
    new: tuple[Literal, ...] = ()
    is_edited: bool | None = None

    @property
    def kind(self) -> str:
        """``new``, ``gone``, ``conditions``, ``moved`` or, with the same formula, ``edited``."""
        if self.before is None:
            return 'new'
        if self.after is None:
            return 'gone'
        if self.gone or self.new:
            return 'conditions'
        return 'moved' if self.bounds else 'edited'


@dataclass(frozen=True, eq=False)
class ValueChange:
    """A value of the features or of the feature map that differs.

    Attributes:
        path: where it stands, such as ``clearance.unit``.
        before: in the first file; ``None`` where there is none.
        after: in the second file.
    """

    path: str
    before: Any
    after: Any


@dataclass(frozen=True, eq=False)
class FileComparison:
    """What changed from one constraints file to another, and where their verdicts differ.

    Attributes:
        first: the content of the first file.
        second: the content of the second one.
        verdicts: where the verdicts on features differ.
        rules: the rules that differ, in the order of the second file, then those that are gone.
        features: what differs in names, units, physical bounds and families.
        feature_map: what differs in the feature maps; empty if one of the files has none.
    """

    first: Constraints
    second: Constraints
    verdicts: VerdictComparison
    rules: tuple[RuleChange, ...]
    features: tuple[ValueChange, ...]
    feature_map: tuple[ValueChange, ...]

    @property
    def is_same(self) -> bool:
        """Whether the same messages are proven to give the same verdicts.

        Another feature map can make other numbers of the same messages.
        """
        return self.verdicts.is_same and not self.feature_map


def compare_files(first: Constraints, second: Constraints) -> FileComparison:
    """Compare two constraints files.

    Which rules stand for each other, :func:`.matched_rules` says.
    """
    maps = first.feature_map, second.feature_map
    return FileComparison(
        first,
        second,
        compare_verdicts(first.rule_set, second.rule_set),
        tuple(_rule_changes(first, second)),
        tuple(
            _changed_values(
                {feature.name: _feature(feature) for feature in first.space.features},
                {feature.name: _feature(feature) for feature in second.space.features},
            )
        ),
        () if None in maps else tuple(_changed_values(*maps)),
    )


def _rule_changes(first: Constraints, second: Constraints) -> Iterator[RuleChange]:
    pairs = matched_rules(first, second)
    before, after = first.rules, second.rules
    match = {new: old for old, new in pairs}
    for place, rule in enumerate(after):
        if place not in match:
            yield RuleChange(None, rule, is_edited=_is_edited(second, rule))
            continue
        former = before[match[place]]
        change = _change(first, second, former, rule)
        is_alike = (former.id, former.enabled, former.note) == (rule.id, rule.enabled, rule.note)
        if change.kind != 'edited' or not is_alike:
            yield change
    left = set(range(len(before))) - set(match.values())
    yield from (RuleChange(before[place], None) for place in sorted(left))


def _change(first: Constraints, second: Constraints, old: Rule, new: Rule) -> RuleChange:
    before, after = rule_ends(old, first.space), rule_ends(new, second.space)
    moved = {
        end: (before[end], after[end])
        for end in before
        if end in after
        and (before[end].bound, before[end].operator) != (after[end].bound, after[end].operator)
    }
    gone = tuple(before[end] for end in before if end not in after)
    added = tuple(after[end] for end in after if end not in before)
    bounds = []
    for end, (former, literal) in moved.items():
        others = [pair for other, pair in moved.items() if other != end]
        demonstrations: tuple[Mapping[str, Any], ...] = ()
        if literal.contains(former):
            if not added and all(one.contains(other) for other, one in others):
                demonstrations = _flagged(first, old, former, literal)
        elif not gone and all(other.contains(one) for other, one in others):
            demonstrations = _flagged(second, new, literal, former)
        bounds.append(
            BoundChange(
                end[0],
                first.space.features[former.members[0]].unit,
                former,
                literal,
                _relative(first, former, literal.bound - former.bound),
                demonstrations,
            )
        )
    return RuleChange(old, new, tuple(bounds), gone, added, _is_edited(second, new))


def _relative(constraints: Constraints, literal: Literal, change: float) -> float | None:
    low, high = constraints.rule_set.demonstrated[list(literal.members)].T
    extent = float(high.max() - low.min())
    return change / extent if 0 < extent < np.inf else None


def _flagged(
    constraints: Constraints, rule: Rule, own: Literal, wider: Literal
) -> tuple[Mapping[str, Any], ...]:
    """Return samples that hold a bound where it is and that a wider literal makes true.

    All other literals of the rule are true on them.
    """
    why = why_document(constraints, rule.id)
    if why['missing']:
        return ()
    return tuple(
        sample
        for sample in why['literals'][rule.literals.index(own)]['closest']
        # Of features that share their bounds, the sample may be of another one.
        if (own.is_family or 'feature' not in sample)
        and wider.holds(np.array([sample['value']]))[0]
    )


def _is_edited(constraints: Constraints, rule: Rule) -> bool | None:
    """Return whether the formula was changed since it was learned; None where nothing says so."""
    if not constraints.evidence:
        return None
    return why_document(constraints, rule.id)['missing'] is not None


def _feature(feature: Feature) -> dict[str, Any]:
    low, high = (float(end) if np.isfinite(end) else None for end in (feature.low, feature.high))
    return {'unit': feature.unit, 'bounds': [low, high], 'family': feature.family}


def _changed_values(before: Any, after: Any, path: str = '') -> Iterator[ValueChange]:
    """Yield the values that differ in two documents; entries of lists with names go by these."""
    before, after = _by_name(before), _by_name(after)
    if isinstance(before, Mapping) and isinstance(after, Mapping):
        for key in dict.fromkeys((*before, *after)):
            yield from _changed_values(
                before.get(key, _MISSING),
                after.get(key, _MISSING),
                f'{path}.{key}' if path else str(key),
            )
    elif before is _MISSING or after is _MISSING or before != after:
        yield ValueChange(
            path, None if before is _MISSING else before, None if after is _MISSING else after
        )


def _by_name(value: Any) -> Any:
    is_named = (
        isinstance(value, Sequence)
        and not isinstance(value, str)
        and len(value) > 0
        and all(isinstance(item, Mapping) and 'name' in item for item in value)
    )
    return {str(item['name']): item for item in value} if is_named else value
