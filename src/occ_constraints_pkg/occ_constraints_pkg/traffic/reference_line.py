# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""A line along a road, and where points lie along it and beside it."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import gaussian_filter1d

_STEP_M = 2.0
_MOST_STEPS = 20_000
# Bounds of mapped lanes jitter by decimetres within metres; the direction of a highway does not.
_SMOOTH_M = 20.0
# Distances of points to steps that are held at once.
_PAIRS = 2_000_000


class ReferenceLine:
    """A smoothed polyline, continued straight beyond both ends.

    Args:
        points: (n, 2) metres, two or more different ones in the direction of travel.

    Raises:
        ValueError: they lead back over themselves.
    """

    def __init__(self, points: np.ndarray) -> None:
        lengths = np.linalg.norm(np.diff(points, axis=0), axis=1)
        points = points[np.concatenate([[True], lengths > 0.0])]
        along = np.concatenate([[0.0], np.cumsum(lengths[lengths > 0.0])])
        count = 1 + min(max(1, round(along[-1] / _STEP_M)), _MOST_STEPS)
        at = np.linspace(0.0, along[-1], count)
        line = np.stack([np.interp(at, along, axis) for axis in points.T], axis=1)
        # Only what departs from the chord is smoothed, so that the ends stay where they are.
        chord = line[0] + np.linspace(0.0, 1.0, count)[:, None] * (line[-1] - line[0])
        sigma = _SMOOTH_M / (along[-1] / (count - 1))
        self._points = chord + gaussian_filter1d(line - chord, sigma, axis=0, mode='nearest')
        steps = np.diff(self._points, axis=0)
        self._lengths = np.linalg.norm(steps, axis=1)
        if not self._lengths.all():
            raise ValueError('a step of the line has no length')
        self._units = steps / self._lengths[:, None]
        self._begins = np.concatenate([[0.0], np.cumsum(self._lengths)[:-1]])

    def locate(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return where points lie.

        Args:
            points: (n, 2) metres.

        Returns:
            (n,) metres along the line, (n,) metres to its left, (n,) its direction there in rad.
        """
        size = max(1, _PAIRS // len(self._lengths))
        parts = [
            self._locate(points[begin : begin + size]) for begin in range(0, len(points), size)
        ]
        along, left, angle = (np.concatenate(part) for part in zip(*parts, strict=True))
        return along, left, angle

    def _locate(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        offsets = points[:, None, :] - self._points[None, :-1, :]
        along = np.einsum('nsk,sk->ns', offsets, self._units)
        lows, highs = np.zeros(len(self._lengths)), self._lengths.copy()
        lows[0], highs[-1] = -np.inf, np.inf
        inside = np.clip(along, lows, highs)
        away = offsets - inside[:, :, None] * self._units[None]
        nearest = np.einsum('nsk,nsk->ns', away, away).argmin(axis=1)
        rows = np.arange(len(points))
        unit, offset = self._units[nearest], offsets[rows, nearest]
        left = unit[:, 0] * offset[:, 1] - unit[:, 1] * offset[:, 0]
        angle = np.arctan2(unit[:, 1], unit[:, 0])
        return self._begins[nearest] + inside[rows, nearest], left, angle
