# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Where two rule sets give different verdicts: proven by box arithmetic, exact to the float."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from occ_constraints_pkg.rules.rule import Literal, Rule
from occ_constraints_pkg.rules.ruleset import RuleSet
from occ_constraints_pkg.rules.verdict import Verdict

# Boxes looked at for all rules of one side, until the rest is left unproven; some seconds.
MOST_BOXES = 5_000
# Differing boxes listed for one rule.
MOST_PIECES = 20
# Points tried for each rule of which the boxes were too many, and for how many such rules.
POINTS_TRIED = 2_000
MOST_TRIED = 20

# First and last values inside, (k,) each.
_Box = tuple[np.ndarray, np.ndarray]


@dataclass(frozen=True, eq=False)
class Difference:
    """A box of inputs on which one rule set flags what the other does not.

    Attributes:
        rule: id of the rule that is true on all of it.
        point: an input inside, by the name of the feature: finite, and within the physical bounds.
        limits: first and last value inside of each feature that the box bounds more tightly than
            the physical bounds do.
        verdicts: on the point, by the first and by the second rule set.
    """

    rule: str
    point: Mapping[str, float]
    limits: Mapping[str, tuple[float, float]]
    verdicts: tuple[Verdict, Verdict]


@dataclass(frozen=True, eq=False)
class UnknownDifference:
    """A feature that only one of two rule sets can judge at some value.

    Attributes:
        feature: its name.
        value: a value within the physical bounds of one and beyond those of the other.
        known_to_first: whether it is the first rule set that can judge it.
    """

    feature: str
    value: float
    known_to_first: bool


@dataclass(frozen=True, eq=False)
class VerdictComparison:
    """How the verdicts of two rule sets compare, over all inputs.

    Attributes:
        problem: why they cannot be compared; empty if they can.
        only_first: boxes that only the first rule set flags, for each rule the largest first.
        only_second: boxes that only the second one flags.
        unknown: values that only one of them can judge.
        missing: names of features that only one of them has, without which it says UNKNOWN.
        without_rules: whether the first and the second enable no rule, which makes every verdict
            UNKNOWN.
        unproven: ids of the rules, of the first and of the second, that may differ in more than is
            listed here.
        boxes: number of boxes that were looked at.
        points: number of points that were tried for rules with too many boxes.
    """

    problem: str = ''
    only_first: tuple[Difference, ...] = ()
    only_second: tuple[Difference, ...] = ()
    unknown: tuple[UnknownDifference, ...] = ()
    missing: tuple[str, ...] = ()
    without_rules: tuple[bool, bool] = (False, False)
    unproven: tuple[tuple[str, ...], tuple[str, ...]] = ((), ())
    boxes: int = 0
    points: int = 0

    @property
    def differs(self) -> bool:
        """Whether there is an input with different verdicts."""
        first, second = self.without_rules
        return bool(
            self.only_first or self.only_second or self.unknown or self.missing or first != second
        )

    @property
    def is_same(self) -> bool:
        """Whether the verdicts are proven to be the same for every input within bounds."""
        return not (self.problem or self.differs or any(self.unproven))


def compare_verdicts(
    first: RuleSet, second: RuleSet, *, most_boxes: int = MOST_BOXES, seed: int = 0
) -> VerdictComparison:
    """Find where two rule sets give different verdicts, or prove that they never do.

    A rule is true on a box; a literal about a family, on one for each member. What is left of the
    box of a rule without all boxes of the other rule set is a set of boxes again. It is found by
    cases, one literal at a time, where possible without alternatives. Features are matched by name,
    in any order; disabled rules do not count. Inputs are all finite floats within the physical
    bounds of both.

    The number of boxes can grow exponentially with that of the rules. After ``most_boxes`` the
    remaining rules are listed as unproven, and only points, random ones and corners, are tried for
    the first :data:`MOST_TRIED` of them.

    Args:
        first: a rule set.
        second: another one.
        most_boxes: to look at for all rules of each.
        seed: of the random points.
    """
    units = {feature.name: feature.unit for feature in first.space.features}
    for feature in second.space.features:
        unit = units.get(feature.name, feature.unit)
        if unit != feature.unit:
            return VerdictComparison(
                f'feature {feature.name!r} is in {unit!r} in the first and in {feature.unit!r} in '
                'the second, so the same number means something else'
            )
    inputs = _Inputs(first, second)
    rng = np.random.default_rng(seed)
    searches = [_Search(inputs, flags, rng, most_boxes) for flags in (0, 1) if not inputs.is_empty]
    found = [search.run() for search in searches] or [(), ()]
    unproven = [tuple(search.unproven) for search in searches] or [(), ()]
    return VerdictComparison(
        only_first=found[0],
        only_second=found[1],
        unknown=tuple(inputs.unknown()),
        missing=tuple(sorted(set(first.space.names) ^ set(second.space.names))),
        without_rules=(bool(first.problem), bool(second.problem)),
        unproven=(unproven[0], unproven[1]),
        boxes=sum(search.boxes for search in searches),
        points=sum(search.points for search in searches),
    )


class _Inputs:
    """The features of two rule sets together, and the inputs that both can judge."""

    def __init__(self, first: RuleSet, second: RuleSet) -> None:
        self.rule_sets = first, second
        self.names = tuple(dict.fromkeys((*first.space.names, *second.space.names)))
        column = {name: index for index, name in enumerate(self.names)}
        # For each rule set, where its features are among those of both.
        self.columns = [
            np.array([column[name] for name in rule_set.space.names]) for rule_set in self.rule_sets
        ]
        largest = np.finfo(np.float64).max
        self.low = np.full(len(self.names), -largest)
        self.high = np.full(len(self.names), largest)
        # Where values are looked for: around the demonstrations of both.
        self.usual_low = np.full(len(self.names), np.inf)
        self.usual_high = np.full(len(self.names), -np.inf)
        for rule_set, own in zip(self.rule_sets, self.columns, strict=True):
            low, high = rule_set.space.finite_bounds
            self.low[own] = np.maximum(self.low[own], low)
            self.high[own] = np.minimum(self.high[own], high)
            low, high = rule_set.demonstrated.T
            self.usual_low[own] = np.minimum(self.usual_low[own], low)
            self.usual_high[own] = np.maximum(self.usual_high[own], high)

    @property
    def is_empty(self) -> bool:
        """Whether there is no input that both can judge."""
        return bool((self.low > self.high).any())

    def unknown(self) -> Iterator[UnknownDifference]:
        """Yield for each end of the physical bounds that differs a value between the two."""
        for name in self.names:
            if not all(name in rule_set.space.names for rule_set in self.rule_sets):
                continue
            bounds = [
                rule_set.space.finite_bounds[:, rule_set.space.index(name)]
                for rule_set in self.rule_sets
            ]
            for mine, other in ((0, 1), (1, 0)):
                (low, high), (inner_low, inner_high) = bounds[mine], bounds[other]
                if low < inner_low:
                    last = min(high, np.nextafter(inner_low, -np.inf))
                    value = _between(low, last, inner_low, inner_low)
                    yield UnknownDifference(name, value, mine == 0)
                if high > inner_high:
                    start = max(low, np.nextafter(inner_high, np.inf))
                    value = _between(start, high, inner_high, inner_high)
                    yield UnknownDifference(name, value, mine == 0)

    def point(self, box: _Box) -> np.ndarray:
        """Return an input in a box, near the demonstrations if it can be."""
        usual = zip(*box, self.usual_low, self.usual_high, strict=True)
        return np.array([_between(*limits) for limits in usual])

    def verdicts(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return (n,) verdicts of both on (n, k) inputs."""
        first, second = (
            rule_set.verdicts(points[:, own])
            for rule_set, own in zip(self.rule_sets, self.columns, strict=True)
        )
        return first, second

    def size(self, box: _Box) -> float:
        """Return how large a box is near the demonstrations, to compare boxes by."""
        low, high = np.maximum(box[0], self.usual_low), np.minimum(box[1], self.usual_high)
        extent = np.maximum(self.usual_high / 2 - self.usual_low / 2, np.finfo(np.float64).tiny)
        # Far from what was demonstrated as constant; the result is cut to 0 anyway.
        with np.errstate(over='ignore'):
            return float(np.clip((high / 2 - low / 2) / extent, 0.0, 1.0).mean())


def _between(low: float, high: float, usual_low: float, usual_high: float) -> float:
    """Return a number of few digits from ``low`` to ``high``, if possible in the usual range.

    Beyond this range it is not farther away than the range is wide, if possible.
    """
    reach = max(usual_high / 2 - usual_low / 2, 0.5 * max(abs(usual_low), abs(usual_high), 1e-3))
    near_low = max(low, usual_low) if max(low, usual_low) <= min(high, usual_high) else low
    near_high = min(high, usual_high) if max(low, usual_low) <= min(high, usual_high) else high
    if near_low > usual_high:
        near_high = min(near_high, near_low + reach)
    elif near_high < usual_low:
        near_low = max(near_low, near_high - reach)
    middle = float(np.clip(near_low / 2 + near_high / 2, low, high))
    for digits in range(3, 17):
        rounded = float(f'{middle:.{digits}g}')
        if near_low <= rounded <= near_high:
            return rounded
    return middle


class _Conditions:
    """The literals of several rules over the features of both rule sets, as arrays.

    A literal is ``sign * x >= sign * first`` of its only or its deciding member. The numbers that
    decide are those of each feature, of each with the opposite sign, and of families, likewise.
    """

    def __init__(self, rules: Sequence[Rule], columns: np.ndarray, width: int) -> None:
        self.rules = rules
        self.literals = [literal for rule in rules for literal in rule.literals]
        self.members = [columns[list(literal.members)] for literal in self.literals]
        counts = np.array([len(rule.literals) for rule in rules], dtype=np.int64)
        self.starts = np.cumsum(counts) - counts
        self.ends = self.starts + counts
        self.reached = np.array([literal.sign * literal.first for literal in self.literals])
        families = list(
            dict.fromkeys(
                (tuple(members.tolist()), literal.is_upper)
                for literal, members in zip(self.literals, self.members, strict=True)
                if literal.is_family
            )
        )
        self._families = [np.array(members) + is_upper * width for members, is_upper in families]
        self._source = np.array(
            [
                2 * width + families.index((tuple(members.tolist()), literal.is_upper))
                if literal.is_family
                else members[0] + literal.is_upper * width
                for literal, members in zip(self.literals, self.members, strict=True)
            ],
            dtype=np.int64,
        )

    def status(self, box: _Box) -> tuple[np.ndarray, np.ndarray]:
        """Return for each literal whether it holds on all of a box, and whether anywhere in it."""
        low, high = box
        return self._exceeds(low, -high), self._exceeds(high, -low)

    def _exceeds(self, upward: np.ndarray, downward: np.ndarray) -> np.ndarray:
        each = np.concatenate([upward, downward])
        if self._families:
            each = np.concatenate([each, [each[members].max() for members in self._families]])
        return each[self._source] >= self.reached

    def kept(self, rows: np.ndarray, columns: np.ndarray, width: int) -> _Conditions:
        """Return those of the rules at these positions."""
        return _Conditions([self.rules[row] for row in rows], columns, width)


class _Search:
    """What the rules of one rule set flag and the other does not."""

    def __init__(
        self, inputs: _Inputs, flags: int, rng: np.random.Generator, most_boxes: int
    ) -> None:
        self._inputs, self._flags, self._rng = inputs, flags, rng
        self._own = inputs.columns[flags]
        self._other = inputs.columns[1 - flags]
        self._width = len(inputs.names)
        self._rules = _enabled(inputs.rule_sets[flags])
        self._others = _Conditions(_enabled(inputs.rule_sets[1 - flags]), self._other, self._width)
        self._most_boxes = most_boxes
        self.boxes = 0
        self.points = 0
        self.unproven: list[str] = []

    def run(self) -> tuple[Difference, ...]:
        found: list[Difference] = []
        formulas = {_formula(rule, self._other) for rule in self._others.rules}
        tried = 0
        for rule in self._rules:
            # What most files have in common needs no boxes.
            if _formula(rule, self._own) in formulas:
                continue
            pieces: list[_Box] = []
            is_whole = False
            for piece in self._pieces(rule):
                if piece is None:
                    break
                if len(pieces) == MOST_PIECES:
                    break
                pieces.append(piece)
            else:
                is_whole = True
            if not is_whole:
                self.unproven.append(rule.id)
                if not pieces and tried < MOST_TRIED:
                    tried += 1
                    pieces = self._tried(rule)
            pieces.sort(key=self._inputs.size, reverse=True)
            found += [self._difference(rule, piece) for piece in pieces]
        return tuple(found)

    def _pieces(self, rule: Rule) -> Iterator[_Box | None]:
        """Yield the boxes on which the rule is true and no other; None where too many are left."""
        own = _Conditions([rule], self._own, self._width)
        start = self._inputs.low.copy(), self._inputs.high.copy()
        for literal in rule.literals:
            if not literal.is_family:
                _assume(start, literal, self._own[list(literal.members)])
        if (start[0] > start[1]).any():
            return
        others = self._others
        if others.rules:
            possible = np.logical_and.reduceat(others.status(start)[1], others.starts)
            others = others.kept(np.flatnonzero(possible), self._other, self._width)
        stack = [start]
        while stack:
            box = stack.pop()
            if self.boxes >= self._most_boxes:
                yield None
                return
            self.boxes += 1
            cases = _cases(box, own, others)
            if cases is None:
                yield box
            else:
                stack.extend(reversed(cases))

    def _tried(self, rule: Rule) -> list[_Box]:
        """Return points on which the rule is true and no other, as boxes; at most one."""
        low, high = self._inputs.low, self._inputs.high
        corners: list[set[float]] = [set() for _ in range(self._width)]
        for literals, columns in (
            (rule.literals, self._own),
            (self._others.literals, self._other),
        ):
            for literal in literals:
                for column in columns[list(literal.members)]:
                    corners[column] |= {literal.first, literal.last}
        start = low.copy(), high.copy()
        for literal in rule.literals:
            members = self._own[list(literal.members)]
            _assume(start, literal, members[[self._rng.integers(len(members))]])
        points = np.empty((POINTS_TRIED, self._width))
        for column in range(self._width):
            first, last = start[0][column], start[1][column]
            allowed = np.array([first, last, *corners[column]]).clip(first, last)
            usual = np.clip(
                [self._inputs.usual_low[column], self._inputs.usual_high[column]], first, last
            )
            inside = usual[0] + self._rng.random(POINTS_TRIED) * (usual[1] - usual[0])
            at_corner = self._rng.random(POINTS_TRIED) < 0.5
            points[:, column] = np.where(
                at_corner, self._rng.choice(allowed, POINTS_TRIED), inside.clip(first, last)
            )
        self.points += len(points)
        verdicts = self._inputs.verdicts(points)
        differ = (verdicts[self._flags] == Verdict.VIOLATED) & (
            verdicts[1 - self._flags] == Verdict.SAFE
        )
        true = rule.holds(points[:, self._own])
        return [(points[row], points[row]) for row in np.flatnonzero(differ & true)[:1]]

    def _difference(self, rule: Rule, box: _Box) -> Difference:
        inputs = self._inputs
        point = inputs.point(box)
        verdicts = tuple(Verdict(int(one[0])) for one in inputs.verdicts(point[None]))
        if (verdicts[self._flags], verdicts[1 - self._flags]) != (Verdict.VIOLATED, Verdict.SAFE):
            # A proof that the judge of the monitor does not confirm must never be shown.
            raise RuntimeError(f'rule {rule.id!r}: {point.tolist()} is judged as {verdicts}')
        limits = {
            name: (float(low), float(high))
            for name, low, high, lowest, highest in zip(
                inputs.names, *box, inputs.low, inputs.high, strict=True
            )
            if low > lowest or high < highest
        }
        return Difference(
            rule.id,
            dict(zip(inputs.names, point.tolist(), strict=True)),
            limits,
            (verdicts[0], verdicts[1]),
        )


def _cases(box: _Box, own: _Conditions, others: _Conditions) -> list[_Box] | None:
    """Return boxes that together hold what of a box is flagged by the one and not by the others.

    First whatever has no alternative is applied, to the box itself. Then a rule of the others that
    is true on a part of the box, or a family's literal of the own rule, is taken: the one with the
    fewest alternatives. The boxes do not overlap, unless families do.

    Args:
        box: on which the literals of the own rule about single features hold; modified.
        own: the rule that is to be true.
        others: the rules that are to be false.

    Returns:
        None if it is all of the box.
    """
    while True:
        if (box[0] > box[1]).any():
            return []
        choice: tuple[int, int] | None = None
        is_tightened = False
        sure, possible = own.status(box)
        if not possible.all():
            return []
        for place in np.flatnonzero(~sure):
            literal, members = own.literals[place], own.members[place]
            left = members[_reachable(box, literal, members)]
            if len(left) == 1:
                _assume(box, literal, left)
                is_tightened = True
            elif choice is None or len(left) < choice[0]:
                choice = len(left), -1 - int(place)
        if others.rules:
            sure, possible = others.status(box)
            count = np.add.reduceat((~sure).astype(np.int64), others.starts)
            open_rules = np.logical_and.reduceat(possible, others.starts)
            if (open_rules & (count == 0)).any():
                return []
            for row in np.flatnonzero(open_rules & (count == 1)):
                place = others.starts[row] + int(
                    (~sure[others.starts[row] : others.ends[row]]).argmax()
                )
                _exclude(box, others.literals[place], others.members[place])
                is_tightened = True
            rows = np.flatnonzero(open_rules)
            if len(rows):
                fewest = int(rows[count[rows].argmin()])
                if choice is None or count[fewest] <= choice[0]:
                    choice = int(count[fewest]), fewest
        if is_tightened:
            continue
        if choice is None:
            return None
        if choice[1] < 0:
            return _by_member(box, own, -1 - choice[1])
        return _by_literal(box, others, choice[1], sure)


def _by_member(box: _Box, own: _Conditions, place: int) -> list[_Box]:
    """Return a box for each member that may make a family's literal true, the first that does."""
    literal, members = own.literals[place], own.members[place]
    cases = []
    rest = box[0].copy(), box[1].copy()
    for member in members[_reachable(box, literal, members)]:
        case = rest[0].copy(), rest[1].copy()
        _assume(case, literal, np.array([member]))
        cases.append(case)
        _exclude(rest, literal, np.array([member]))
    return cases


def _by_literal(box: _Box, others: _Conditions, row: int, sure: np.ndarray) -> list[_Box]:
    """Return a box for each literal that may make a rule false, the first that does."""
    cases = []
    rest = box[0].copy(), box[1].copy()
    for place in range(others.starts[row], others.ends[row]):
        if sure[place]:
            continue
        literal, members = others.literals[place], others.members[place]
        case = rest[0].copy(), rest[1].copy()
        _exclude(case, literal, members)
        cases.append(case)
        if not literal.is_family:
            _assume(rest, literal, members)
    return cases


def _reachable(box: _Box, literal: Literal, members: np.ndarray) -> np.ndarray:
    """Return for each member whether it can make the literal true in a box."""
    if literal.is_upper:
        return box[0][members] <= literal.first
    return box[1][members] >= literal.first


def _assume(box: _Box, literal: Literal, members: np.ndarray) -> None:
    """Shrink a box to where the literal is true of all these members."""
    if literal.is_upper:
        box[1][members] = np.minimum(box[1][members], literal.first)
    else:
        box[0][members] = np.maximum(box[0][members], literal.first)


def _exclude(box: _Box, literal: Literal, members: np.ndarray) -> None:
    """Shrink a box to where the literal is false of all these members."""
    if literal.is_upper:
        box[0][members] = np.maximum(box[0][members], literal.last)
    else:
        box[1][members] = np.minimum(box[1][members], literal.last)


def _enabled(rule_set: RuleSet) -> list[Rule]:
    return [rule_set.rules[index] for index in rule_set.order]


def _formula(rule: Rule, columns: np.ndarray) -> frozenset[tuple[tuple[int, ...], str, float]]:
    """Return the literals over the features of both rule sets."""
    return frozenset(
        (tuple(sorted(columns[list(item.members)].tolist())), item.operator, item.bound)
        for item in rule.literals
    )
