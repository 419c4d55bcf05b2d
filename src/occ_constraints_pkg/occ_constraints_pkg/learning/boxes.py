# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Simplification of a union of boxes: the same region with fewer boxes and literals."""

from __future__ import annotations

import bisect
import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from occ_constraints_pkg.rules.rule import Literal, Rule, Subject
from occ_constraints_pkg.rules.space import FeatureSpace

# Rounds of merging and dropping; learned rule sets need three or four.
_MOST_ROUNDS = 50
_LARGEST = np.finfo(np.float64).max

# What a literal is about, and whether it bounds that from above.
_End = tuple[Subject, bool]
# First and last value.
_Interval = tuple[float, float]


@dataclass
class Box:
    """A conjunction of literals during simplification, at most one per side of a feature.

    The smallest and the largest member of a family are features of their own here: two boxes with
    the same union whatever values all of these have, have it for the values that go together.

    Attributes:
        sources: positions of the rules it stands for, in ascending order.
        ends: by (feature, is upper end) the literal that bounds it; absent where the physical
            bound does.
        fixed: whether it must not change.
    """

    sources: list[int]
    ends: dict[_End, Literal]
    fixed: bool

    @classmethod
    def of(cls, rule: Rule, position: int, *, fixed: bool) -> Box:
        """Return the box of a rule; of several literals for one end, the tightest."""
        ends = {(item.subject, item.is_upper): item for item in rule.tightest_literals}
        return cls([position], ends, fixed)

    @property
    def features(self) -> set[Subject]:
        """The features that it bounds."""
        return {feature for feature, _ in self.ends}


def simplify_boxes(space: FeatureSpace, boxes: Sequence[Box]) -> list[Box]:
    """Return fewer boxes with fewer literals and, within the physical bounds, the same union.

    The given boxes are modified. Fixed boxes that hold no possible value are left out too.

    Args:
        space: the features, with their physical bounds.
        boxes: in the order of their sources.
    """
    return _Steps(space, list(boxes)).run()


def _touch(low: float, high: float) -> bool:
    """Return whether no number lies between an end at ``high`` and a beginning at ``low``."""
    return low <= math.nextafter(high, math.inf)


class _Steps:
    """The boxes, and the steps that keep their union.

    Every step keeps the union: boxes grow within it, and are removed only if another one contains
    them.
    """

    def __init__(self, space: FeatureSpace, boxes: list[Box]) -> None:
        limits = space.finite_bounds.T.tolist()
        subjects: list[Subject] = [((feature,), 0) for feature in range(len(space))]
        subjects += [(members, end) for members in space.families for end in (-1, 1)]
        self.lows = {subject: limits[subject[0][0]][0] for subject in subjects}
        self.highs = {subject: limits[subject[0][0]][1] for subject in subjects}
        self._families = {member: family for family in space.families for member in family}
        self.boxes = boxes
        self.changed = False

    def run(self) -> list[Box]:
        self._drop_vacuous()
        everywhere = [box for box in self.boxes if not box.features]
        if everywhere:
            # Such a rule contains all others; a fixed one must stay, so it is preferred.
            first = min(everywhere, key=lambda box: not box.fixed)
            return [box for box in self.boxes if box.fixed or box is first]
        for _ in range(_MOST_ROUNDS):
            self.changed = False
            self._join_members()
            intervals = self._merge_single_feature()
            self._apply_intervals(intervals)
            self._remove_contained()
            self._merge_boxes()
            self._drop_covered()
            if not self.changed:
                break
        return self.boxes

    def _low(self, box: Box, feature: Subject) -> float:
        literal = box.ends.get((feature, False))
        return self.lows[feature] if literal is None else literal.first

    def _high(self, box: Box, feature: Subject) -> float:
        literal = box.ends.get((feature, True))
        return self.highs[feature] if literal is None else literal.first

    def _remove(self, gone: Iterable[Box]) -> None:
        numbers = {id(box) for box in gone}
        if numbers:
            self.boxes = [box for box in self.boxes if id(box) not in numbers]
            self.changed = True

    def _drop(self, box: Box, end: _End) -> None:
        """Drop a literal, unless it is the last: a rule has at least one."""
        if len(box.ends) > 1:
            del box.ends[end]
            self.changed = True

    def _drop_vacuous(self) -> None:
        """Drop literals that always hold, and boxes that hold no possible value.

        The rule of a fixed box keeps them; only what the box covers matters here.
        """
        never = []
        for box in self.boxes:
            if any(
                self._low(box, feature) > self._high(box, feature)
                or self._low(box, feature) > self.highs[feature]
                or self._high(box, feature) < self.lows[feature]
                for feature in box.features
            ):
                never.append(box)
                continue
            for feature, is_upper in list(box.ends):
                reach = box.ends[feature, is_upper].first
                if reach >= self.highs[feature] if is_upper else reach <= self.lows[feature]:
                    del box.ends[feature, is_upper]
            for end, literal in list(box.ends.items()):
                own = (box.ends.get((((member,), 0), end[1])) for member in literal.members)
                if literal.is_family and any(item and literal.contains(item) for item in own):
                    del box.ends[end]
        self._remove(never)

    def _join_members(self) -> None:
        """Let one literal about a family stand for those of all its members.

        That takes boxes that are equal but for the member. Where the bounds of members differ, the
        literal has the one that all of them include, and stands for those that have just this, if
        these are most.
        """
        groups: dict[tuple[tuple[int, ...], bool, frozenset[Literal]], dict[int, list[Box]]] = {}
        for box in self.boxes:
            for end, literal in box.ends.items():
                member = literal.members[0]
                family = () if literal.is_family else self._families.get(member, ())
                if not family:
                    continue
                rest = frozenset(item for item in box.ends.values() if item is not literal)
                # Of a rule about several members each says something of its own.
                if not any(item.members[0] in family for item in rest):
                    alike = groups.setdefault((family, end[1], rest), {})
                    alike.setdefault(member, []).append(box)
        gone: list[Box] = []
        taken: set[int] = set()
        for (family, is_upper, _), alike in groups.items():
            numbers = {id(box) for boxes in alike.values() for box in boxes}
            # A box that has just been joined is another one now; the next round sees it.
            if len(alike) == len(family) and not numbers & taken:
                gone += self._join_family(family, is_upper, alike)
                taken |= numbers
        self._remove(gone)

    def _join_family(
        self, family: tuple[int, ...], is_upper: bool, alike: dict[int, list[Box]]
    ) -> list[Box]:
        """Join boxes that are equal but for the member of a family; return those to remove."""
        own = [
            (box, box.ends[((member,), 0), is_upper])
            for member, boxes in alike.items()
            for box in boxes
        ]
        widest: dict[int, Literal] = {}
        for _, literal in own:
            (member,) = literal.members
            if member not in widest or literal.contains(widest[member]):
                widest[member] = literal
        common = max(widest.values(), key=lambda one: (one.sign * one.bound, one.is_strict))
        joined = [
            (box, literal)
            for box, literal in own
            if not box.fixed and replace(literal, feature=common.feature) == common
        ]
        if 2 * len(joined) <= len(family):
            return []
        first, literal = joined[0]
        ends = {end: item for end, item in first.ends.items() if item is not literal}
        whole = replace(common, feature=family)
        ends[whole.subject, is_upper] = whole
        return self._become_one([box for box, _ in joined], ends)

    def _merge_single_feature(self) -> dict[Subject, list[_Interval]]:
        """Merge boxes of one and the same feature; return the connected intervals of each."""
        groups: dict[Subject, list[Box]] = {}
        for box in self.boxes:
            if len(box.features) == 1:
                groups.setdefault(next(iter(box.features)), []).append(box)
        gone: list[Box] = []
        lines: dict[Subject, list[_Interval]] = {}
        for feature, group in groups.items():
            for low, high, members in self._connected(feature, group):
                lines.setdefault(feature, []).append((low, high))
                if len(members) > 1:
                    gone += self._join(feature, low, high, members)
        self._remove(gone)
        return lines

    def _connected(
        self, feature: Subject, boxes: list[Box]
    ) -> Iterator[tuple[float, float, list[Box]]]:
        boxes = sorted(boxes, key=lambda box: self._low(box, feature))
        members, low, high = [boxes[0]], self._low(boxes[0], feature), self._high(boxes[0], feature)
        for box in boxes[1:]:
            if not _touch(self._low(box, feature), high):
                yield low, high, members
                members, low, high = [], self._low(box, feature), -_LARGEST
            members.append(box)
            high = max(high, self._high(box, feature))
        yield low, high, members

    def _join(self, feature: Subject, low: float, high: float, members: list[Box]) -> list[Box]:
        """Merge the free members of a connected interval; return those to remove."""
        inside = [
            box
            for box in members
            if not box.fixed
            and any(other.fixed and self._lies_in(box, other, feature) for other in members)
        ]
        free = [box for box in members if not box.fixed and not any(box is item for item in inside)]
        if not free:
            return inside
        ends = {}
        if low > self.lows[feature]:
            lowest = min(free, key=lambda box: self._low(box, feature))
            ends[feature, False] = lowest.ends[feature, False]
        if high < self.highs[feature]:
            highest = max(free, key=lambda box: self._high(box, feature))
            ends[feature, True] = highest.ends[feature, True]
        if not ends:
            # Every value is flagged, which one rule cannot express without a literal.
            for box in free:
                others = (item for item in free if item is not box and item not in inside)
                if any(self._lies_in(box, other, feature) for other in others):
                    inside.append(box)
            return inside
        return inside + self._become_one(free, ends)

    def _lies_in(self, box: Box, other: Box, feature: Subject) -> bool:
        """Return whether one of two boxes of this feature alone lies in the other."""
        return self._low(other, feature) <= self._low(box, feature) and self._high(
            other, feature
        ) >= self._high(box, feature)

    def _become_one(self, boxes: list[Box], ends: dict[_End, Literal]) -> list[Box]:
        """Let the box of the first rule stand for all; return the others."""
        boxes = sorted(boxes, key=lambda box: box.sources[0])
        first, others = boxes[0], boxes[1:]
        if others or first.ends != ends:
            first.ends = ends
            first.sources = sorted({index for box in boxes for index in box.sources})
            self.changed = True
        return others

    def _apply_intervals(self, lines: dict[Subject, list[_Interval]]) -> None:
        """Use that boxes of a single feature or family flag whole intervals of it."""
        shared: dict[Subject, list[_Interval]] = {}
        for (members, side), found in lines.items():
            for member in members if side else ():
                shared.setdefault(((member,), 0), []).extend(found)
        shared = {feature: _connected(found) for feature, found in shared.items()}
        lines = lines | {
            feature: _connected([*found, *lines.get(feature, ())])
            for feature, found in shared.items()
        }
        gone = []
        for box in self.boxes:
            features = box.features
            if box.fixed:
                continue
            # A box of a single feature is one of its intervals itself.
            known = shared if len(features) == 1 else lines
            for feature in features & known.keys():
                low, high = self._low(box, feature), self._high(box, feature)
                first, last = known[feature][0], known[feature][-1]
                place = bisect.bisect_right(known[feature], (low, math.inf)) - 1
                if place >= 0 and high <= known[feature][place][1]:
                    gone.append(box)
                    break
                if first[0] <= self.lows[feature] < low and _touch(low, first[1]):
                    self._drop(box, (feature, False))
                if last[1] >= self.highs[feature] > high and _touch(last[0], high):
                    self._drop(box, (feature, True))
        self._remove(gone)

    def _remove_contained(self) -> None:
        table = _Table(self)
        low, high, marks = table.implied()
        free = np.array([not box.fixed for box in table.boxes], dtype=bool)
        alive = np.ones(len(free), dtype=bool)
        for row, box in enumerate(table.boxes):
            if alive[row]:
                # A box without a literal at this end cannot lie inside a box that has one.
                others = np.flatnonzero(alive & free & ((~marks & table.marks[row]) == 0))
                inside = others != row
                for column in map(table.place.get, box.features):
                    inside &= low[others, column] >= table.low[row, column]
                    inside &= high[others, column] <= table.high[row, column]
                alive[others[inside]] = False
        self._remove(box for box, stays in zip(table.boxes, alive, strict=True) if not stays)

    def _merge_boxes(self) -> None:
        """Merge boxes that are equal but for one feature, in which they touch or overlap."""
        table = _Table(self)
        free = np.array([not box.fixed for box in table.boxes], dtype=bool)
        codes = table.codes()
        gone: list[Box] = []
        for feature, column in table.place.items():
            rows = np.flatnonzero(free)
            keys = codes[rows].sum(axis=1) - codes[rows, column]
            order = np.lexsort((table.low[rows, column], keys))
            rows, keys = rows[order], keys[order]
            rest = np.arange(len(table.place)) != column
            alike = keys[1:] == keys[:-1]
            for pair in np.flatnonzero(alike):
                # Keys of different boxes may collide.
                one, other = rows[pair], rows[pair + 1]
                alike[pair] = np.array_equal(
                    table.low[one, rest], table.low[other, rest]
                ) and np.array_equal(table.high[one, rest], table.high[other, rest])
            start = 0
            while start < len(rows):
                end, top = start + 1, table.high[rows[start], column]
                while (
                    end < len(rows) and alike[end - 1] and _touch(table.low[rows[end], column], top)
                ):
                    top = max(top, table.high[rows[end], column])
                    end += 1
                if end > start + 1:
                    gone += self._join_alike(feature, [table.boxes[row] for row in rows[start:end]])
                    # The new box is not in the table; the next round sees it.
                    free[rows[start:end]] = False
                start = end
        self._remove(gone)

    def _join_alike(self, feature: Subject, boxes: list[Box]) -> list[Box]:
        """Merge boxes that touch in a feature, the lowest first; return those to remove."""
        lowest, highest = boxes[0], max(boxes, key=lambda box: self._high(box, feature))
        ends = {end: item for end, item in lowest.ends.items() if end[0] != feature}
        for end, box in (((feature, False), lowest), ((feature, True), highest)):
            if end in box.ends:
                ends[end] = box.ends[end]
        return self._become_one(boxes, ends)

    def _drop_covered(self) -> None:
        """Drop a literal of each box if another box contains everything that it gains."""
        table = _Table(self)
        ends = [
            (row, end) for row, box in enumerate(table.boxes) if not box.fixed for end in box.ends
        ]
        if not ends:
            return
        owner = np.array([row for row, _ in ends])
        columns = np.array([table.place[feature] for _, (feature, _) in ends])
        # The interval of that feature that the box gains; in the others, gain and box are equal.
        gain = np.array([self._gain(table.boxes[row], *end) for row, end in ends])
        marks = table.marks[owner]
        marks &= ~np.array([table.mark(*end) for _, end in ends])
        marks |= np.array([table.mark(feature, not upper) for _, (feature, upper) in ends])
        covered = np.zeros(len(ends), dtype=bool)
        for row, box in enumerate(table.boxes):
            places = np.flatnonzero(~covered & ((~marks & table.marks[row]) == 0))
            inside = np.ones(len(places), dtype=bool)
            for column in map(table.place.get, box.features):
                own = columns[places] == column
                low = np.where(own, gain[places, 0], table.low[owner[places], column])
                high = np.where(own, gain[places, 1], table.high[owner[places], column])
                inside &= (low >= table.low[row, column]) & (high <= table.high[row, column])
            covered[places[inside]] = True
        found = np.flatnonzero(covered)
        # One literal of a box at a time: two at once would also gain the corner between them.
        for row, first in zip(*np.unique(owner[found], return_index=True), strict=True):
            self._drop(table.boxes[row], ends[found[first]][1])

    def _gain(self, box: Box, feature: Subject, is_upper: bool) -> tuple[float, float]:
        if is_upper:
            return math.nextafter(self._high(box, feature), math.inf), self.highs[feature]
        return self.lows[feature], math.nextafter(self._low(box, feature), -math.inf)


def _connected(intervals: Iterable[_Interval]) -> list[_Interval]:
    """Return intervals in ascending order, those that touch or overlap as one."""
    ordered = sorted(intervals)
    found = [ordered[0]]
    for low, high in ordered[1:]:
        if _touch(low, found[-1][1]):
            found[-1] = found[-1][0], max(high, found[-1][1])
        else:
            found.append((low, high))
    return found


class _Table:
    """The boxes of several features as arrays.

    Attributes:
        boxes: the m boxes.
        place: the column of each of the c features that they bound.
        low: (m, c) first values inside.
        high: (m, c) last values inside.
        marks: (m,) uint64, one bit per end of a box. With more than 64 ends bits are shared, so
            only a bit that is not set is conclusive.
    """

    def __init__(self, owner: _Steps) -> None:
        self.boxes = [box for box in owner.boxes if len(box.features) > 1]
        features = sorted({feature for box in self.boxes for feature in box.features})
        self.place = {feature: index for index, feature in enumerate(features)}
        lows = np.array([owner.lows[feature] for feature in features])
        highs = np.array([owner.highs[feature] for feature in features])
        self.low: np.ndarray = np.tile(lows, (len(self.boxes), 1))
        self.high: np.ndarray = np.tile(highs, (len(self.boxes), 1))
        self.marks = np.zeros(len(self.boxes), dtype=np.uint64)
        for row, box in enumerate(self.boxes):
            for (feature, is_upper), literal in box.ends.items():
                (self.high if is_upper else self.low)[row, self.place[feature]] = literal.first
                self.marks[row] |= self.mark(feature, is_upper)

    def mark(self, feature: Subject, is_upper: bool) -> np.uint64:
        """Return the bit of an end."""
        return np.uint64(1 << (2 * self.place[feature] + is_upper) % 64)

    def implied(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return low, high and marks with what bounds of members say of their families."""
        low, high, marks = self.low.copy(), self.high.copy(), self.marks.copy()
        for (members, side), column in self.place.items():
            if not side:
                continue
            own = [((member,), 0) for member in members]
            for subject in own:
                place = self.place.get(subject)
                if place is None:
                    continue
                if side < 0:
                    np.minimum(high[:, column], self.high[:, place], out=high[:, column])
                else:
                    np.maximum(low[:, column], self.low[:, place], out=low[:, column])
            for row, box in enumerate(self.boxes):
                if any((subject, side < 0) in box.ends for subject in own):
                    marks[row] |= self.mark((members, side), side < 0)
        return low, high, marks

    def codes(self) -> np.ndarray:
        """(m, c) uint64 hashes of intervals; their sum over columns is a hash of the box."""
        weights = np.random.default_rng(0).integers(2**63, size=(2, len(self.place)))
        codes = np.zeros(self.low.shape, dtype=np.uint64)
        for column in range(len(self.place)):
            for values, weight in zip((self.low, self.high), weights[:, column], strict=True):
                _, numbers = np.unique(values[:, column], return_inverse=True)
                codes[:, column] += (numbers + 1).astype(np.uint64) * np.uint64(weight)
        return codes
