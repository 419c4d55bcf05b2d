# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""From what was read of the messages to features: differences, and steps such as the rate."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from occ_constraints_pkg.features.feature_map import FeatureMap
from occ_constraints_pkg.features.sources import ROUND_ANGLES, Step


class RowTransforms:
    """Computes one row of features after the other; the rate remembers the row before.

    Args:
        feature_map: its features, with ``readings`` in the order of what is read.
    """

    def __init__(self, feature_map: FeatureMap) -> None:
        features = feature_map.features
        self._count = len(features)
        # (feature, what is subtracted from it, whether both are angles that go round)
        self._minus: list[tuple[int, int, bool]] = []
        self._before: list[_Steps] = []
        self._after: list[_Steps] = []
        for place, item in enumerate(features):
            max_gap_ns = feature_map.max_age_ns(item.reading)
            is_angle, read = item.reduce in ROUND_ANGLES, [place]
            if item.minus is not None:
                other = self._count + len(self._minus)
                is_round = item.minus.reduce in ROUND_ANGLES
                # Before abs or a scale, a turn by pi to the other side is a small one.
                is_same = is_round and all(step[0] == 'offset' for step in item.minus.transform)
                self._minus.append((place, other, is_angle and is_same))
                if item.minus.transform:
                    gap_ns = feature_map.max_age_ns(item.minus)
                    self._before.append(
                        _Steps(other, item.minus.transform, gap_ns, [other], is_angle=is_round)
                    )
                is_angle, read = is_angle and is_same, [place, other]
            if item.steps:
                self._after.append(_Steps(place, item.steps, max_gap_ns, read, is_angle=is_angle))

    @property
    def has_memory(self) -> bool:
        """Whether a row depends on the row before."""
        return any(steps.has_memory for steps in (*self._before, *self._after))

    def apply(
        self,
        read: np.ndarray,
        stamps_ns: Sequence[int | None],
        row_ns: int,
        restarted: np.ndarray | None = None,
    ) -> np.ndarray:
        """Return the (rows, k) features.

        Args:
            read: (rows, readings) float64; may be changed.
            stamps_ns: for each reading the header stamp of its message; None without one.
            row_ns: the row's own time, for values without a stamp.
            restarted: (rows,) bool: rows that do not go on from the row before, for a new episode
                began; None for no row.
        """
        for steps in self._before:
            steps.apply(read, stamps_ns, row_ns, restarted)
        for place, other, is_angle in self._minus:
            difference = read[:, place] - read[:, other]
            read[:, place] = _wrapped(difference) if is_angle else difference
        values = read[:, : self._count] if self._minus else read
        for steps in self._after:
            steps.apply(values, stamps_ns, row_ns, restarted)
        return values


class _Steps:
    """The steps of one column.

    Args:
        place: the column.
        steps: what is done to it, in order.
        max_gap_ns: see :class:`_Rate`.
        read: the readings that it is made of.
        is_angle: whether it is an angle that goes round.
    """

    def __init__(
        self,
        place: int,
        steps: tuple[Step, ...],
        max_gap_ns: int,
        read: list[int],
        *,
        is_angle: bool,
    ) -> None:
        names = [step[0] for step in steps]
        self._place, self._read = place, read
        at = names.index('rate') if 'rate' in names else len(names)
        self._before, self._after = steps[:at], steps[at + 1 :]
        self.has_memory = at < len(names)
        self._rate = _Rate(max_gap_ns, is_angle=is_angle and at == 0)

    def apply(
        self,
        values: np.ndarray,
        stamps_ns: Sequence[int | None],
        row_ns: int,
        restarted: np.ndarray | None,
    ) -> None:
        """Change the column in (rows, columns) values; see :meth:`RowTransforms.apply`."""
        column = _apply(self._before, values[:, self._place])
        if self.has_memory:
            stamps = [stamp for part in self._read if (stamp := stamps_ns[part]) is not None]
            now = max(stamps) if len(stamps) == len(self._read) else row_ns
            column = _apply(self._after, self._rate.step(column, now, restarted))
        values[:, self._place] = column


class _Rate:
    """The change per second of a column since the row before.

    It is missing in the first row, after a value that was missing, after a gap of more than
    ``max_gap_ns``, when time went back, when other values came under the same stamp, in rows that
    restart, and when the number of rows changed. The same values under the same stamp, as when no
    new message came between two rows, keep their rate.
    """

    def __init__(self, max_gap_ns: int, *, is_angle: bool) -> None:
        self._max_gap_ns, self._is_angle = max_gap_ns, is_angle
        self._time_ns = 0
        self._values = self._rates = np.empty(0)

    def step(self, values: np.ndarray, time_ns: int, restarted: np.ndarray | None) -> np.ndarray:
        """Take the values of one row, or of one row per robot; return their rates."""
        elapsed = time_ns - self._time_ns
        values = values.copy()
        if len(values) != len(self._values):
            rates = np.full(len(values), np.nan)
        elif elapsed == 0:
            rates = np.where(values == self._values, self._rates, np.nan)
        elif 0 < elapsed <= self._max_gap_ns:
            with np.errstate(invalid='ignore', over='ignore'):
                change = values - self._values
                rates = (_wrapped(change) if self._is_angle else change) / (elapsed * 1e-9)
        else:
            rates = np.full(len(values), np.nan)
        if restarted is not None:
            rates[restarted] = np.nan
        self._time_ns, self._values, self._rates = time_ns, values, rates
        return rates


def _wrapped(angle: np.ndarray) -> np.ndarray:
    """Return the equal angle from -pi up to pi."""
    with np.errstate(invalid='ignore'):
        return (angle + math.pi) % (2.0 * math.pi) - math.pi


def _apply(steps: Sequence[Step], values: np.ndarray) -> np.ndarray:
    """Apply steps without memory to a (rows,) column; what is not finite stays so."""
    for name, *numbers in steps:
        if name == 'abs':
            values = np.abs(values)
        elif name == 'scale':
            values = values * numbers[0]
        elif name == 'offset':
            values = values + numbers[0]
        elif name == 'round':
            # The sum makes 0 of -0, which would print as another bound.
            values = np.rint(values / numbers[0]) * numbers[0] + 0.0
        else:
            # A reading of infinity is a fault, which a clip must not hide.
            values = np.where(np.isfinite(values), np.clip(values, *numbers), values)
    return values
