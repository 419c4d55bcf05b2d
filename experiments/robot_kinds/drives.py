# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Drives of synthetic robots: their random tasks, and the fault planted in them."""

from __future__ import annotations

import bisect
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

# Robots work for so long at a time; each task is done at a pace of its own.
_TASK_S = 30.0
_SLOWEST, _FASTEST = 0.75, 1.25
# Of the time that a way to and fro takes: the quickest move, and the longest stay at a goal.
_QUICKEST, _LONGEST_STAY = 0.15, 0.25


@dataclass
class Drive:
    """One drive: its random signals, and the fault planted in it.

    Attributes:
        seed: tells drives of one kind apart.
        fault: name of the fault; empty for none.
        seconds: how long it takes.
    """

    seed: int
    fault: str = ''
    seconds: float = 120.0

    def goals(
        self, name: str, low: float, high: float, period: float = 7.0
    ) -> Callable[[float], float]:
        """Return a smooth function of time that goes from goal to goal between two limits.

        The goals of all drives are drawn from the same uniform distribution, and so is the pace.
        A robot stays at every other goal for a while.

        Args:
            name: what it is; each has goals of its own.
            low: the least goal.
            high: the greatest goal.
            period: from low to high and back in so many seconds, at a pace of 1.
        """
        rng = np.random.default_rng([self.seed, *name.encode()])
        starts, ends, values = [-1.0], [-1.0], [float(rng.uniform(low, high))]
        while ends[-1] < self.seconds + 2.0:
            task = np.random.default_rng([self.seed, 7, int(max(ends[-1], 0.0) / _TASK_S)])
            pace = task.uniform(_SLOWEST, _FASTEST) * rng.uniform(_SLOWEST, _FASTEST)
            begin = ends[-1] + rng.uniform(0.0, _LONGEST_STAY * period) * (rng.random() < 0.5)
            goal = float(rng.uniform(low, high))
            way = abs(goal - values[-1]) / (high - low) * period / 2.0
            starts.append(begin)
            ends.append(begin + max(way, _QUICKEST * period) / pace)
            values.append(goal)

        def signal(time: float) -> float:
            place = bisect.bisect_right(starts, time) - 1
            if place < 1:
                return values[0]
            part = min((time - starts[place]) / (ends[place] - starts[place]), 1.0)
            smooth = part**3 * (10.0 + part * (6.0 * part - 15.0))
            return values[place - 1] + (values[place] - values[place - 1]) * smooth

        return signal

    def gait(
        self, name: str, low: float, high: float, period: float = 1.3
    ) -> Callable[[float], float]:
        """Return a smooth function of time that repeats, its strength and pace changing by task.

        Args: see :meth:`goals`.
        """
        rng = np.random.default_rng([self.seed, *name.encode()])
        first = rng.uniform(0.0, math.tau)
        strength = self.goals(f'{name} strength', 0.7, 1.0, 10.0 * period)
        middle, half = (low + high) / 2.0, (high - low) / 2.0

        def signal(time: float) -> float:
            return middle + half * strength(time) * math.sin(math.tau * time / period + first)

        return signal

    def noise(self, name: str, size: float) -> Callable[[], float]:
        """Return a function that gives noise of a standard deviation."""
        rng = np.random.default_rng([self.seed, 99, *name.encode()])
        return lambda: float(rng.normal(0.0, size))

    def between(self, name: str, low: float, high: float) -> float:
        """Return a number that is drawn for each drive."""
        return float(np.random.default_rng([self.seed, 3, *name.encode()]).uniform(low, high))

    def has(self, fault: str, time: float) -> bool:
        """Tell whether a fault is present, as from half of the drive to three quarters."""
        return self.fault == fault and 0.5 <= time / self.seconds < 0.75

    def ticks(self, rate: float) -> Iterator[float]:
        """Yield times of messages."""
        return (step / rate for step in range(int(self.seconds * rate)))
