# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Judges one sample: the rules as a few straight lines of Python."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any

import numpy as np

from occ_constraints_pkg.rules.formula import Disjunction, Group
from occ_constraints_pkg.rules.rule import Literal, Rule
from occ_constraints_pkg.rules.space import FeatureSpace
from occ_constraints_pkg.rules.verdict import Verdict


class OneRow:
    """Judges a sample given as a list of k floats.

    NumPy needs about a microsecond per call, whatever it computes. For one sample, comparing
    Python floats is faster, if there is no loop and the bounds are constants. So the rules are
    written as functions. Only positions of features, floats and one of four operators go into
    their text (a :class:`Literal` admits no other); nothing that a file says in words does.

    Args:
        space: the features.
        rules: the enabled rules in the order they are tried.
        positions: what to call each of them.
        formula: the same rules, factored.
        scale: (k,) the unit of distance of each feature.

    Attributes:
        verdict: takes the list and gives the :class:`Verdict`.
    """

    def __init__(
        self,
        space: FeatureSpace,
        rules: Sequence[Rule],
        positions: Sequence[int],
        formula: Disjunction,
        scale: np.ndarray,
    ) -> None:
        known = ' and '.join(
            f'{low!r} <= x{feature} <= {high!r}'
            for feature, (low, high) in enumerate(space.finite_bounds.T.tolist())
        )
        verdict = [f'if not ({known}): return UNKNOWN', *_verdict_lines(formula), 'return SAFE']
        first = [
            f'if {_all(rule.tightest_literals)}: return {int(position)}'
            for position, rule in zip(positions, rules, strict=True)
        ]
        margin = ['m = inf', *_margin_lines(formula, scale.tolist(), 0), 'return m + 0.0']
        features = len(space)
        self.verdict: Callable[[list[float]], Verdict] = _function(features, verdict)
        self._first: Callable[[list[float]], int] = _function(features, first)
        self._margin: Callable[[list[float]], float] = _function(features, margin)

    def judge(self, row: list[float]) -> tuple[Verdict, int, float]:
        """Return verdict, position of the first true rule (-1 where none) and margin."""
        verdict = self.verdict(row)
        if verdict is Verdict.UNKNOWN:
            return verdict, -1, math.nan
        first = self._first(row) if verdict is Verdict.VIOLATED else -1
        return verdict, first, self._margin(row)


def _function(features: int, lines: Iterable[str]) -> Callable[[list[float]], Any]:
    """Return a function of a list of so many floats, called x0, x1, ..., with these lines."""
    names = ', '.join(f'x{feature}' for feature in range(features))
    text = '\n '.join(['def function(row):', f'{names}, = row', *lines])
    known = {'SAFE': Verdict.SAFE, 'VIOLATED': Verdict.VIOLATED, 'UNKNOWN': Verdict.UNKNOWN}
    namespace: dict[str, Any] = {'inf': math.inf, **known}
    exec(compile(text, '<rules>', 'exec'), namespace)
    return namespace['function']


def _verdict_lines(formula: Disjunction) -> Iterator[str]:
    if formula.ends:
        alone = ' or '.join(_text(literal) for literal in _literals(formula.ends))
        yield f'if {alone}: return VIOLATED'
    for condition, inner in formula.parts:
        yield f'if {_all(_literals(condition))}:'
        yield from _indented(_verdict_lines(inner))


def _margin_lines(formula: Disjunction, scale: list[float], level: int) -> Iterator[str]:
    """Lines that lower m to the margin of a formula under conditions of distance c{level}.

    The margin of a conjunction is at least that of its first literals, so where these alone are
    no smaller than the m found so far, the rest needs no look.
    """
    for literal in _literals(formula.ends):
        yield f'd = {_distance(literal, scale)}'
        yield f'if d < m: m = d if d > c{level} else c{level}' if level else 'if d < m: m = d'
    inside = f'c{level + 1}'
    for condition, inner in formula.parts:
        first, *others = _literals(condition)
        yield f'{inside} = {_distance(first, scale)}'
        if level:
            yield f'if {inside} < c{level}: {inside} = c{level}'
        yield f'if {inside} < m:'
        for literal in others:
            yield f' d = {_distance(literal, scale)}'
            yield f' if d > {inside}: {inside} = d'
        if others:
            yield f' if {inside} < m:'
        lines = _indented(_margin_lines(inner, scale, level + 1))
        yield from _indented(lines) if others else lines


def _indented(lines: Iterable[str]) -> Iterator[str]:
    return (f' {line}' for line in lines)


def _literals(groups: Iterable[Group]) -> list[Literal]:
    return [literal for group in groups for literal in group.literals]


def _all(literals: Iterable[Literal]) -> str:
    return ' and '.join(_text(literal) for literal in literals)


def _text(literal: Literal) -> str:
    return f'x{int(literal.feature)} {literal.operator} {float(literal.bound)!r}'


def _distance(literal: Literal, scale: list[float]) -> str:
    """Return how far the literal is from being true, at most 0 where it is."""
    value, bound = f'x{int(literal.feature)}', f'{float(literal.bound)!r}'
    difference = f'{value} - {bound}' if literal.is_upper else f'{bound} - {value}'
    return f'({difference}) / {scale[literal.feature]!r}'
