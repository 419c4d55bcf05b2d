# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Rules over the features of the map ``highway`` in the terms of traffic, for people to judge."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from occ_constraints_pkg.rules.rule import Rule, Subject
from occ_constraints_pkg.rules.space import FeatureSpace
from occ_constraints_pkg.terminal import printable

_NEIGHBOURS = (
    'the vehicle behind on the left lane',
    'the vehicle behind',
    'the vehicle behind on the right lane',
    'the vehicle ahead on the left lane',
    'the vehicle ahead',
    'the vehicle ahead on the right lane',
)
_NONE_M = 500.0
_KM_H = 3.6


def in_traffic(rule: Rule, space: FeatureSpace) -> str:
    """Return what a rule forbids, in the terms of traffic.

    Speeds are told in km/h too, gaps and edges by whom and what they are to. Features that are not
    of the map ``highway`` are told as :meth:`Rule.words` does.
    """
    bounds: dict[Subject, list[float | None]] = {}
    names = {}
    for literal in rule.tightest_literals:
        pair = bounds.setdefault(literal.subject, [None, None])
        pair[literal.is_upper] = literal.bound
        names[literal.subject] = literal.name(space)
    phrases = []
    for subject, (low, high) in bounds.items():
        tell = _TELLERS.get(names[subject])
        if tell is None:
            only = tuple(item for item in rule.literals if item.subject == subject)
            phrases.append(Rule(rule.id, only).words(space))
        else:
            phrases.append(tell(low, high))
    return ', '.join(phrases)


def rule_rows(rules: Iterable[Rule], space: FeatureSpace) -> list[dict[str, str]]:
    """Return rules as a paper's appendix prints them, each with what it says in traffic.

    Returns:
        One mapping for each rule: ``words``, ``formula`` with bounds to four digits, ``traffic``.
    """
    return [
        {
            'words': rule.words(space),
            'formula': ' ∧ '.join(
                f'{item.name(space)} {item.operator} {item.bound:.4g}'
                for item in rule.tightest_literals
            ),
            'traffic': in_traffic(rule, space),
        }
        for rule in rules
    ]


def rules_table(rules: Iterable[Rule], space: FeatureSpace) -> str:
    """Return rules as a Markdown table; the formula is the disjunction of its lines."""
    lines = ['| rule | formula, the lines joined by ∨ | in traffic |', '|---|---|---|']
    lines += [
        f'| {row["words"]} | `{row["formula"]}` | {row["traffic"]} |'
        for row in rule_rows(rules, space)
    ]
    return '\n'.join(map(printable, lines))


def _speed(low: float | None, high: float | None) -> str:
    if low is None and high is not None and high <= 0.0:
        return 'backwards' if high == 0.0 else f'backwards faster than {_km_h(-high)}'
    if low is None or high is None:
        bound = low if high is None else high
        return f'{"faster" if high is None else "slower"} than {_km_h(bound)}'
    return f'between {_km_h(low)} and {_km_h(high)}'


def _km_h(speed: float | None) -> str:
    return f'{speed:.3g} m/s ({speed * _KM_H:.3g} km/h)'


def _sideways(low: float | None, high: float | None) -> str:
    if low is not None and high is not None:
        return f'moving sideways at {low:.3g} to {high:.3g} m/s, to the left positive'
    if low is not None and low >= 0.0:
        return f'moving to the left faster than {low:.3g} m/s'
    if high is not None and high <= 0.0:
        return f'moving to the right faster than {-high:.3g} m/s'
    if low is not None:
        return f'not moving to the right faster than {-low:.3g} m/s'
    return f'not moving to the left faster than {high:.3g} m/s'


def _gap(who: str) -> Callable[[float | None, float | None], str]:
    """Return a function that tells a gap; a gap of 500 m is nobody."""

    def tell(low: float | None, high: float | None) -> str:
        if low is not None and low >= _NONE_M:
            return f'without {who.replace("the vehicle", "a vehicle")}'
        if high is None:
            return f'{who} farther than {low:.3g} m, or none'
        if low is None or low <= 0.0:
            return f'{who} closer than {high:.3g} m'
        return f'{who} between {low:.3g} and {high:.3g} m away'

    return tell


def _edge(side: str) -> Callable[[float | None, float | None], str]:
    """Return a function that tells the distance to an edge, which is below 0 beyond it."""

    def tell(low: float | None, high: float | None) -> str:
        if low is None and high is not None and high <= 0.0:
            return f'centre more than {-high:.3g} m beyond the {side} road edge'
        if high is None:
            return f'centre farther than {low:.3g} m from the {side} road edge'
        if low is None:
            return f'centre closer than {high:.3g} m to the {side} road edge'
        return f'centre between {low:.3g} and {high:.3g} m from the {side} road edge'

    return tell


_TELLERS: dict[str, Callable[[float | None, float | None], str]] = {
    'v_x': _speed,
    'v_y': _sideways,
    **{f'p_rel{place}': _gap(who) for place, who in enumerate(_NEIGHBOURS)},
    'd_left': _edge('left'),
    'd_right': _edge('right'),
}
