# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Lanelets: pieces of lane between two bounds, as the roads of a highway."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from occ_constraints_pkg.errors import DataError
from occ_constraints_pkg.traffic.neighbours import ELSEWHERE, LEFT, RIGHT, SAME
from occ_constraints_pkg.traffic.plausible import check_lane_width
from occ_constraints_pkg.traffic.reference_line import ReferenceLine

# A vehicle that is further from every lanelet than this has left the recorded stretch of road.
_FARTHEST_ALONG_M, _FARTHEST_BESIDE_M = 1.0, 4.0
_SAMPLES = 21
_BACKWARDS_M = 1.0
_SHORTEST_M = 0.1


@dataclass(frozen=True, eq=False)
class Lanelet:
    """A piece of lane.

    Attributes:
        id: its number in the file.
        where: what errors call it: file, line and number.
        left, right: (n, 2) and (m, 2) metres, its bounds in the direction of travel.
        successors: numbers of the lanelets that continue it.
        beside_left, beside_right: number of the lanelet beside it in the same direction, or None.
    """

    id: int
    where: str
    left: np.ndarray
    right: np.ndarray
    successors: tuple[int, ...] = ()
    beside_left: int | None = None
    beside_right: int | None = None


@dataclass(frozen=True, eq=False)
class Placed:
    """Where vehicles are on the road.

    Attributes:
        lane: (n,) int, position of the lanelet; -1 where there is none.
        along: (n,) metres along the carriageway.
        left: (n,) metres to the left of its reference line.
        angle: (n,) rad, its direction there.
        d_left, d_right: (n,) metres to the outer edges of its outermost lanelets.
    """

    lane: np.ndarray
    along: np.ndarray
    left: np.ndarray
    angle: np.ndarray
    d_left: np.ndarray
    d_right: np.ndarray


class RoadMap:
    """The lanelets of a file: which lie beside which, and where vehicles are on them.

    Attributes:
        beside: (lanelets, lanelets) int, see :func:`~.neighbours.gaps_by_lane`. A lanelet is the
            same lane as all that lead to it and all that it leads to.

    Args:
        lanelets: at least one, with different numbers.

    Raises:
        OccError: a lanelet refers to one that is not there, its bounds are swapped, it is no
            road's lane, runs against the others, or overlaps one; or they form a circle.
    """

    def __init__(self, lanelets: Sequence[Lanelet]) -> None:
        self._lanelets = lanelets
        self._places = {lanelet.id: place for place, lanelet in enumerate(lanelets)}
        self._next = [[self._place(i, n) for n in i.successors] for i in lanelets]
        self._left = [self._place(i, i.beside_left) for i in lanelets]
        self._right = [self._place(i, i.beside_right) for i in lanelets]
        self._roads = [self._carriageway(members) for members in self._components()]
        self._leftmost = [self._outermost(self._left, place) for place in range(len(lanelets))]
        self._rightmost = [self._outermost(self._right, place) for place in range(len(lanelets))]
        self.beside = self._find_beside()
        for road in self._roads:
            self._check_overlaps(road)

    def place(self, points: np.ndarray) -> Placed:
        """Return where (n, 2) points, in metres, are on the road."""
        count = len(points)
        lane, best = np.full(count, -1), np.full(count, np.inf)
        along, beside_line, angle, d_left, d_right = np.zeros((5, count))
        for road in self._roads:
            at, left, direction = road.line.locate(points)
            for place, band in road.bands.items():
                low, high = band.sides(at)
                beyond = np.maximum(band.begin - at, at - band.end).clip(min=0.0)
                beside = np.maximum(left - high, low - left).clip(min=0.0)
                # The centre decides where two share a boundary.
                away = beyond + beside + 1e-3 * np.abs(left - (low + high) / 2.0)
                near = (beyond <= _FARTHEST_ALONG_M) & (beside <= _FARTHEST_BESIDE_M)
                better = near & (away < best)
                best[better], lane[better] = away[better], place
                along[better], beside_line[better] = at[better], left[better]
                angle[better] = direction[better]
                _, outer_left = road.bands[self._leftmost[place]].sides(at)
                outer_right, _ = road.bands[self._rightmost[place]].sides(at)
                d_left[better] = (outer_left - left)[better]
                d_right[better] = (left - outer_right)[better]
        return Placed(lane, along, beside_line, angle, d_left, d_right)

    def _place(self, lanelet: Lanelet, number: int | None) -> int:
        if number is None:
            return -1
        if number not in self._places:
            raise DataError(f'{lanelet.where} refers to lanelet {number}, which is not there')
        return self._places[number]

    def _components(self) -> list[list[int]]:
        """Return lanelets that hang together, each a carriageway."""
        neighbours: list[set[int]] = [set() for _ in self._lanelets]
        for place, following in enumerate(self._next):
            for other in (*following, self._left[place], self._right[place]):
                if other >= 0:
                    neighbours[place].add(other)
                    neighbours[other].add(place)
        found, seen = [], set()
        for place in range(len(self._lanelets)):
            if place not in seen:
                members = _reached(neighbours, place)
                seen |= members
                found.append(sorted(members))
        return found

    def _outermost(self, beside: Sequence[int], place: int) -> int:
        seen = {place}
        while (following := beside[place]) >= 0:
            if following in seen:
                raise DataError(
                    f'{self._lanelets[following].where} lies beside itself; '
                    'allowed are lanes from left to right'
                )
            seen.add(following)
            place = following
        return place

    def _carriageway(self, members: list[int]) -> _Carriageway:
        chain = self._longest(members)
        try:
            line = ReferenceLine(np.concatenate([self._lanelets[i].left for i in chain]))
        except ValueError as error:
            raise DataError(
                f'{self._lanelets[chain[0]].where}: it and what follows it turn back; '
                'allowed are the lanes of a highway'
            ) from error
        return _Carriageway(line, {i: _band(line, self._lanelets[i]) for i in members})

    def _longest(self, members: list[int]) -> list[int]:
        """Return the longest chain of successors."""
        waiting = {i: len(self._next[i]) for i in members}
        before: dict[int, list[int]] = {i: [] for i in members}
        for i in members:
            for following in self._next[i]:
                before[following].append(i)
        length: dict[int, float] = {}
        following_of: dict[int, int] = {}
        ready = [i for i, count in waiting.items() if not count]
        while ready:
            place = ready.pop()
            left = self._lanelets[place].left
            length[place] = float(np.linalg.norm(np.diff(left, axis=0), axis=1).sum())
            if self._next[place]:
                following_of[place] = max(self._next[place], key=length.__getitem__)
                length[place] += length[following_of[place]]
            for earlier in before[place]:
                waiting[earlier] -= 1
                if not waiting[earlier]:
                    ready.append(earlier)
        if len(length) < len(members):
            first = next(i for i in members if i not in length)
            raise DataError(
                f'{self._lanelets[first].where} leads back to itself or to lanes that do; '
                'allowed is a road with a beginning and an end'
            )
        chain = [max(members, key=length.__getitem__)]
        while chain[-1] in following_of:
            chain.append(following_of[chain[-1]])
        return chain

    def _find_beside(self) -> np.ndarray:
        count = len(self._lanelets)
        previous: list[list[int]] = [[] for _ in range(count)]
        for place, following in enumerate(self._next):
            for other in following:
                previous[other].append(place)
        same = np.zeros((count, count), dtype=bool)
        for place in range(count):
            same[place, list(_reached(self._next, place) | _reached(previous, place))] = True
        beside = np.full((count, count), ELSEWHERE)
        for place in range(count):
            for side, other in ((LEFT, self._left[place]), (RIGHT, self._right[place])):
                if other >= 0:
                    beside[place, same[other]] = side
            beside[place, same[place]] = SAME
        return beside

    def _check_overlaps(self, road: _Carriageway) -> None:
        for first, second in _pairs(list(road.bands)):
            shared = set(self._next[first]) & set(self._next[second])
            forked = any({first, second} <= set(following) for following in self._next)
            if self.beside[first, second] != SAME and not shared and not forked:
                one, other = road.bands[first], road.bands[second]
                if one.overlaps(other):
                    raise DataError(
                        f'{self._lanelets[second].where} overlaps lanelet '
                        f'{self._lanelets[first].id} for more than half of their common way; '
                        'allowed are lanes beside one another'
                    )


@dataclass(frozen=True, eq=False)
class _Band:
    """A lanelet in the coordinates of its carriageway: its sides over the way along it."""

    left: tuple[np.ndarray, np.ndarray]
    right: tuple[np.ndarray, np.ndarray]
    begin: float
    end: float

    def sides(self, along: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the right and the left side, metres to the left of the line."""
        return np.interp(along, *self.right), np.interp(along, *self.left)

    def overlaps(self, other: _Band) -> bool:
        begin, end = max(self.begin, other.begin), min(self.end, other.end)
        if end - begin < _BACKWARDS_M:
            return False
        at = np.linspace(begin, end, _SAMPLES)
        (low, high), (other_low, other_high) = self.sides(at), other.sides(at)
        common = np.minimum(high, other_high) - np.maximum(low, other_low)
        narrower = np.minimum(high - low, other_high - other_low)
        return bool((common > 0.5 * narrower).mean() > 0.5)


@dataclass(frozen=True, eq=False)
class _Carriageway:
    line: ReferenceLine
    bands: dict[int, _Band]


def _band(line: ReferenceLine, lanelet: Lanelet) -> _Band:
    sides = []
    for bound in (lanelet.left, lanelet.right):
        along, left, _ = line.locate(bound)
        if along[-1] - along[0] < _SHORTEST_M or (np.diff(along) < -_BACKWARDS_M).any():
            raise DataError(
                f'{lanelet.where} does not lead the way of the lanes beside and before it; '
                'allowed are the lanes of a highway'
            )
        sides.append((np.maximum.accumulate(along), left))
    begin = min(sides[0][0][0], sides[1][0][0])
    end = max(sides[0][0][-1], sides[1][0][-1])
    band = _Band(*sides, begin, end)
    low, high = band.sides(np.linspace(begin, end, _SAMPLES))
    width = float(np.median(high - low))
    if width < 0.0:
        raise DataError(
            f'{lanelet.where}: its leftBound lies to the right of its rightBound; '
            'allowed are bounds as seen in the direction of travel'
        )
    check_lane_width(lanelet.where, width)
    return band


def _reached(following: Sequence[Sequence[int] | set[int]], place: int) -> set[int]:
    seen, waiting = {place}, [place]
    while waiting:
        for other in following[waiting.pop()]:
            if other not in seen:
                seen.add(other)
                waiting.append(other)
    return seen


def _pairs(places: Sequence[int]) -> Iterator[tuple[int, int]]:
    for number, first in enumerate(places):
        for second in places[number + 1 :]:
            yield first, second
