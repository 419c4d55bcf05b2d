# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Clipping by mass, our extension of the OC-tree: distributes the outlier budget over the features.

A bound moves inward as long as the length that it cuts off is worth the samples in it. This is the
excess mass of Hartigan (JASA 82, 1987) and of Müller and Sawitzki (JASA 86, 1991) on one feature:
the largest mass less a price times length.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from occ_constraints_pkg.learning.density import bandwidth
from occ_constraints_pkg.learning.division import LARGEST, is_eligible
from occ_constraints_pkg.learning.edges import MOST_ESTIMATED, MOST_EVEN, Edge, estimate_edge

# Bisection steps for the price of a stated share, to one part in 1e9.
_HALVINGS = 30
# Size of a subsample for rough estimates.
_SOME = 4096


@dataclass(frozen=True)
class Unit:
    """A feature, or a family with the same interval for all members.

    Attributes:
        features: positions of the members.
        smallest: (n,) each sample's smallest member; for one feature, its value.
        largest: (n,) each sample's largest member.
        limits: the physical bounds, infinite where there is none.
    """

    features: tuple[int, ...]
    smallest: np.ndarray
    largest: np.ndarray
    limits: tuple[float, float]

    @property
    def is_family(self) -> bool:
        """Whether there are several members."""
        return len(self.features) > 1


@dataclass(frozen=True)
class Trim:
    """The interval of a unit, before any shrinking.

    Attributes:
        low: left bound, a sample's value, inclusive.
        high: right bound, the same.
        extent: the smallest and the largest value.
        impurity: the article's proxy (p. 12-13) of this cut at the root; for a family, with the
            volume of all its members.
    """

    low: float
    high: float
    extent: tuple[float, float]
    impurity: float


def make_units(
    samples: np.ndarray, families: Sequence[Sequence[int]], limits: np.ndarray | None
) -> list[Unit]:
    """Return each family, and each feature that is in none, in the order of the features.

    Args:
        samples: (n, k).
        families: positions of features that share their bounds.
        limits: (k, 2) physical bounds of the features; ``None`` for none.
    """
    together = {member for family in families for member in family}
    ends = np.full((samples.shape[1], 2), [-np.inf, np.inf]) if limits is None else limits
    units = [
        Unit((feature,), samples[:, feature], samples[:, feature], tuple(ends[feature]))
        for feature in range(samples.shape[1])
        if feature not in together
    ]
    for family in map(list, families):
        smallest, largest = samples[:, family[0]].copy(), samples[:, family[0]].copy()
        for member in family[1:]:
            np.minimum(smallest, samples[:, member], out=smallest)
            np.maximum(largest, samples[:, member], out=largest)
        units.append(Unit(tuple(family), smallest, largest, tuple(ends[family[0]])))
    return sorted(units, key=lambda unit: unit.features)


def edges_of(unit: Unit) -> tuple[Edge | None, Edge | None]:
    """Return the lower and the upper edge of a family; ``None`` where nothing bounds it."""
    lower, upper = (
        estimate_edge(sign * (values - limit)) if unit.is_family and np.isfinite(limit) else None
        for values, sign, limit in zip(
            (unit.smallest, unit.largest), (1.0, -1.0), unit.limits, strict=True
        )
    )
    return lower, upper


def most_outside(count: int, contamination: float | None) -> int:
    """Return how many of ``count`` samples may lie outside."""
    return int((MOST_ESTIMATED if contamination is None else contamination) * count)


class _Tail(NamedTuple):
    """One side of a unit, from its extreme inward.

    Attributes:
        values: (r + 1,) the outermost samples; r of them may be left outside.
        beyond: (r + 1,) share of the unit's range that a bound there leaves outside.
        members: number of features that the bound serves.
        edge: estimated end of a family, or ``None``.
        distances: (r + 1,) distances to the physical bound, ascending.
    """

    values: np.ndarray
    beyond: np.ndarray
    members: int
    edge: Edge | None
    distances: np.ndarray

    def beyond_edge(self, edge: Edge, room: int) -> int:
        """Return how many samples lie beyond the edge, at most ``room``; equal ones together."""
        outside = min(edge.beyond, room)
        return int(np.searchsorted(self.distances, self.distances[outside]))


def trim(units: Sequence[Unit], contamination: float | None) -> list[Trim | None]:
    """Bound each unit, so that in total at most a given share of the samples is outside.

    Without a stated share: bad samples, a share :data:`MOST_ESTIMATED` of all, are assumed to be
    uniform over the range of one unknown feature; a feature is cut where there are fewer samples
    than that. A family with a physical bound (for the sectors of a lidar: contact) ends at its
    edge, see :mod:`~occ_constraints_pkg.learning.edges`, which does not depend on how careful the
    demonstrator was. What an edge with an even tail leaves outside, up to :data:`MOST_EVEN`, does
    not count in the total.

    With a stated share: at the price that spends it. A bound of a whole family makes the safe set
    smaller in each of its features, so its worth counts once for each. Edges with an even tail are
    served first: of a share that is too small, none is spent elsewhere.

    Args:
        units: what to bound, at least one.
        contamination: the share; ``None`` to estimate.

    Returns:
        For each unit its interval; ``None`` where it is not eligible, see
        :func:`~occ_constraints_pkg.learning.division.is_eligible`.
    """
    count = len(units[0].smallest)
    room = most_outside(count, contamination)
    found = [_tails(unit, room, is_estimated=contamination is None) for unit in units]
    tails = [tail for pair in found if pair is not None for tail in pair]
    price = MOST_ESTIMATED / sum(len(unit.features) for unit in units)
    outside = np.zeros(len(tails), dtype=np.int64)
    if contamination is None:
        _estimate(tails, outside, price, count, room)
    elif tails:
        price *= contamination / MOST_ESTIMATED
        for index, tail in enumerate(tails):
            if tail.edge is not None:
                outside[index] = tail.beyond_edge(tail.edge, room - int(outside.sum()))
        worth = np.stack([tail.members * tail.beyond for tail in tails])
        price = _spending_price(worth, price, count, room, outside)
        outside = np.maximum(outside, _bought(worth, price, count))
    numbers = iter(outside.reshape(-1, 2).tolist())
    return [None if pair is None else _trim(pair, next(numbers), count) for pair in found]


def _estimate(
    tails: Sequence[_Tail], outside: np.ndarray, price: float, count: int, room: int
) -> None:
    """Set how many samples to leave outside, for each tail, if no share is stated.

    Args:
        tails: t of them.
        outside: (t,) zeros; changed.
        price: of a worth of 1, as a share of the samples.
        count: number of samples.
        room: most samples outside, but for those beyond edges with an even tail.
    """
    priced = [index for index, tail in enumerate(tails) if tail.edge is None]
    if priced:
        worth = np.stack([tails[index].members * tails[index].beyond for index in priced])
        outside[priced] = _bought(worth, price, count)
    left = room - int(outside.sum())
    for index, tail in enumerate(tails):
        if tail.edge is not None and tail.edge.is_even:
            outside[index] = tail.beyond_edge(tail.edge, len(tail.values) - 1)
        elif tail.edge is not None:
            outside[index] = tail.beyond_edge(tail.edge, max(0, left))
            left -= int(outside[index])


def _bought(worth: np.ndarray, price: float, count: int) -> np.ndarray:
    """Return how many samples to leave outside at a price, for each tail: (t,).

    Args:
        worth: (t, r + 1) what leaving 0 to r samples outside is worth.
        price: share of the samples that a worth of 1 costs.
        count: number of samples.
    """
    shares = np.arange(worth.shape[1]) / count
    # argmax takes the first of equal values, so equal samples stay together.
    return np.argmax(price * worth - shares, axis=1)


def _spending_price(
    worth: np.ndarray, price: float, count: int, room: int, least: np.ndarray
) -> float:
    """Return the largest price, to rounding, at which at most ``room`` samples are outside.

    Args:
        worth: (t, r + 1) what leaving 0 to r samples outside is worth, for each tail.
        price: of the share per feature.
        count: number of samples.
        room: most samples outside.
        least: (t,) how many are outside at any price.
    """

    def is_affordable(price: float) -> bool:
        return int(np.maximum(least, _bought(worth, price, count)).sum()) <= room

    # Half the price of the share per feature is affordable unless edges take it: neither side of a
    # unit is worth more than its whole range. (Without a stated share the whole price is: sides
    # that do not cross share one range, and if they crossed all samples would be outside.)
    low, high = price / 2, float(count) ** 2
    if not is_affordable(low):
        return 0.0
    if is_affordable(high):
        return high
    for _ in range(_HALVINGS):
        middle = float(np.sqrt(low * high))
        low, high = (middle, high) if is_affordable(middle) else (low, middle)
    return low


def _tails(unit: Unit, room: int, *, is_estimated: bool) -> tuple[_Tail, _Tail] | None:
    """Return the lower and the upper tail of a unit, or ``None`` if it is not eligible.

    Args:
        unit: what to bound.
        room: most samples to leave outside, but beyond an edge with an even tail.
        is_estimated: whether no share is stated. With one, only edges with an even tail count.
    """
    count = len(unit.smallest)
    # Contiguous: they are read several times.
    lower = np.ascontiguousarray(unit.smallest)
    upper = np.ascontiguousarray(unit.largest) if unit.is_family else lower
    pair = []
    sides = zip((lower, upper), (1.0, -1.0), unit.limits, edges_of(unit), strict=True)
    for values, sign, limit, estimated in sides:
        edge, most = estimated, room
        if edge is not None and is_estimated and edge.is_even:
            most = max(room, min(edge.beyond, int(MOST_EVEN * count)))
        elif edge is not None and not is_estimated and not edge.is_even:
            edge = None
        ends = _outermost(values, most, sign)
        distances = ends if edge is None else sign * (ends - limit)
        pair.append((ends, sign, edge, distances))
    start, end = pair[0][0][0], pair[1][0][0]
    if start == end or max(-start, end) > LARGEST:
        return None
    # Empty sectors are many equal values, which does not mean quantisation.
    if not unit.is_family and not _is_continuous(lower):
        return None
    low, high = (
        _Tail(ends, sign * (ends - ends[0]) / (end - start), len(unit.features), edge, distances)
        for ends, sign, edge, distances in pair
    )
    return low, high


def _outermost(values: np.ndarray, room: int, sign: float) -> np.ndarray:
    """Return the ``room`` + 1 smallest of (n,) values, ascending; with -1 the largest, descending.

    A subsample gives a rough limit, so that few more than these have to be sorted.
    """
    few = np.sort(sign * _some(values))
    guess = few[min(len(few) - 1, int(1.2 * len(few) * room / len(values)) + 20)]
    beyond = values[values <= guess] if sign > 0 else -values[values >= -guess]
    if len(beyond) <= room:
        beyond = sign * values
    beyond.partition(room)
    return sign * np.sort(beyond[: room + 1])


def _some(values: np.ndarray) -> np.ndarray:
    """Return a subsample of a few thousand values."""
    return values[:: max(1, len(values) // _SOME)]


def _is_continuous(values: np.ndarray) -> bool:
    """Return whether a feature is eligible.

    A subsample suffices if steps are well below the bandwidth, as they usually are.
    """
    few = np.sort(_some(values))
    if few[0] < few[-1]:
        h = bandwidth(few) * (len(few) / len(values)) ** 0.2
        if is_eligible(few, h / 2):
            return True
    ordered = np.sort(values)
    return is_eligible(ordered, bandwidth(ordered))


def _trim(pair: tuple[_Tail, _Tail], outside: Sequence[int], count: int) -> Trim:
    (low, high), (below, above) = pair, outside
    gone = np.array([low.beyond[below], high.beyond[above]])
    inside = max(1.0 - gone.sum(), 0.0) ** low.members
    # Of the volume outside, each side has its share of the length.
    volumes = np.array([*(gone * ((1.0 - inside) / max(gone.sum(), np.finfo(float).tiny))), inside])
    samples = np.array([below, above, count - below - above], dtype=np.float64)
    both = samples + count * volumes
    parts = np.divide(samples * count * volumes, both, out=np.zeros(3), where=both > 0)
    return Trim(
        float(low.values[below]),
        float(high.values[above]),
        (float(low.values[0]), float(high.values[0])),
        float(parts.sum()),
    )
