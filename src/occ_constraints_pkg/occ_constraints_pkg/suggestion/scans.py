# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""What all scans of a topic have in common: beams, codes for "nothing", the robot's own body."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np

# Beams beyond this, in degrees, are of a scan whose angles are not in rad.
_LARGEST_ANGLE = 720.0
# So many scans are kept to look for what never changes.
_KEPT = 500
# A beam that stays within this many metres, while others move by more, sees the robot itself.
_STILL, _MOVED = 0.02, 0.1
_BODY_RANGE = 1.0
# A range below the smallest that comes again and again is a code.
_CODE_SHARE = 0.005


@dataclass
class ScanShape:
    """What all scans of a topic have in common, or at worst.

    Attributes:
        least_beams: fewest beams.
        first: smallest angle of any beam, in degrees.
        last: largest angle of any beam.
        step: largest angle between neighbouring beams.
        range_min: smallest smallest range, in m.
        range_max: largest greatest range, in m.
        counts: of all ranges, how many are zero, infinite, NaN, positive but below the scan's
            smallest range, and any of these or not.
        beyond: how many are finite and above the scan's greatest range.
    """

    least_beams: int
    first: float = math.inf
    last: float = -math.inf
    step: float = 0.0
    range_min: float = math.inf
    range_max: float = 0.0
    counts: np.ndarray = field(default_factory=lambda: np.zeros(5))
    beyond: int = 0
    _scans: list[np.ndarray] = field(default_factory=list)
    _low: dict[float, int] = field(default_factory=dict)

    def add(self, message: Any) -> None:
        """Take one LaserScan, of at least one range."""
        ranges = np.asarray(message.ranges, dtype=np.float64)
        count = len(ranges)
        ends = np.degrees(
            [message.angle_min, message.angle_min + (count - 1) * message.angle_increment]
        )
        self.least_beams = min(self.least_beams, count)
        self.first, self.last = min(self.first, *ends), max(self.last, *ends)
        self.step = max(self.step, abs(math.degrees(message.angle_increment)))
        self.range_min = min(self.range_min, float(message.range_min))
        self.range_max = max(self.range_max, float(message.range_max))
        low = (ranges > 0.0) & (ranges < message.range_min)
        seen = [ranges == 0.0, np.isinf(ranges), np.isnan(ranges), low, np.ones(count, dtype=bool)]
        self.counts += [np.count_nonzero(part) for part in seen]
        self.beyond += np.count_nonzero(np.isfinite(ranges) & (ranges > message.range_max))
        for value in ranges[low].tolist():
            self._low[value] = self._low.get(value, 0) + 1
        if len(self._scans) < _KEPT:
            self._scans.append(ranges)

    def join(self, other: ScanShape) -> None:
        """Take what another recording has."""
        self.least_beams = min(self.least_beams, other.least_beams)
        self.first, self.last = min(self.first, other.first), max(self.last, other.last)
        self.step = max(self.step, other.step)
        self.range_min = min(self.range_min, other.range_min)
        self.range_max = max(self.range_max, other.range_max)
        self.counts, self.beyond = self.counts + other.counts, self.beyond + other.beyond
        self._scans += other._scans
        for value, number in other._low.items():
            self._low[value] = self._low.get(value, 0) + number

    @property
    def fault(self) -> str:
        """What is wrong with the angles; empty if nothing is."""
        if not all(map(math.isfinite, (self.first, self.last, self.step))):
            return 'angles that are not finite'
        if max(abs(self.first), abs(self.last)) > _LARGEST_ANGLE:
            return (
                f'beams from {self.first:.0f} to {self.last:.0f} degrees, as if its angles were in '
                'degrees; allowed are radians'
            )
        if self.step == 0.0 and self.least_beams > 1:
            return 'the angle_increment 0, so that nothing tells where its beams point'
        return ''

    @property
    def code(self) -> float:
        """The range below ``range_min`` that stands for "not measured"; NaN without one."""
        often = {value: number for value, number in self._low.items() if self._is_often(number)}
        return max(often, default=math.nan)

    def _is_often(self, number: int) -> bool:
        return number > _CODE_SHARE * self.counts[4]

    @property
    def near(self) -> float:
        """Share of the ranges that are positive, below ``range_min``, and no code."""
        coded = sum(number for number in self._low.values() if self._is_often(number))
        return float(self.counts[3] - coded) / float(self.counts[4])

    def measured(self) -> np.ndarray:
        """Return (scans, beams) ranges of equally long scans, NaN for what is no measurement."""
        scans = np.array([scan for scan in self._scans if len(scan) == self.least_beams])
        code = self.code
        is_none = ~np.isfinite(scans) | (scans <= 0.0) | (scans > self.range_max)
        if math.isfinite(code):
            is_none |= scans <= code
        return np.where(is_none, np.nan, scans)

    def body(self) -> list[list[float]]:
        """Return sectors in degrees in which the scanner sees the robot itself, such as a mast.

        That is where the range stays the same and is short while most other beams move.
        """
        scans = self.measured()
        if self.fault or len(scans) < 2:
            return []
        seen = np.isfinite(scans).mean(axis=0)
        with np.errstate(invalid='ignore'):
            filled = np.where(np.isfinite(scans), scans, np.nan)
            spans = np.full(scans.shape[1], np.inf)
            often = seen > 0.9
            if not often.any():
                return []
            spans[often] = np.nanmax(filled[:, often], axis=0) - np.nanmin(filled[:, often], axis=0)
            medians = np.full(scans.shape[1], np.inf)
            medians[often] = np.nanmedian(filled[:, often], axis=0)
        moving = np.median(spans[often]) > _MOVED
        own = (spans < _STILL) & (medians < _BODY_RANGE)
        if not moving or not own.any():
            return []
        sectors, width = [], self.step
        for run in np.split(
            np.flatnonzero(own), np.flatnonzero(np.diff(np.flatnonzero(own)) > 1) + 1
        ):
            low, high = (self.first + width * beam for beam in (run[0], run[-1]))
            sectors.append([math.floor(low - width / 2), math.ceil(high + width / 2)])
        return sectors

    def openness(self) -> np.ndarray:
        """Return for each scan the clearance of its most open eighth, in m.

        What was not measured counts as the greatest range; the robot's own body does not count.
        """
        scans = self.measured()
        body = np.zeros(scans.shape[1], dtype=bool)
        angles = self.first + self.step * np.arange(scans.shape[1])
        for low, high in self.body():
            body |= (angles >= low) & (angles <= high)
        clear = np.where(np.isnan(scans) | body, self.range_max, scans)
        parts = np.array_split(clear, min(8, clear.shape[1]), axis=1)
        return np.max([part.min(axis=1) for part in parts], axis=0)
