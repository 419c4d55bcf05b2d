# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Selection of usable samples, division into training and held-out episodes, ranges."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from occ_constraints_pkg.errors import DataError
from occ_constraints_pkg.learning.settings import OCTreeSettings
from occ_constraints_pkg.rules.space import FeatureSpace

LEAST_EPISODES_TO_HOLD_OUT = 5
"""With fewer episodes, none is held out: too few would be left to learn from."""


@dataclass(frozen=True, eq=False)
class Samples:
    """Usable samples, divided by episodes.

    Attributes:
        training: (n, k) samples to learn from.
        episodes: (n,) their episodes.
        held_out: (m, k) samples of the held-out episodes.
        held_out_names: (m,) their episodes.
        held_out_episodes: how many these are.
        usable: (all samples,) bool; the others would be UNKNOWN at run time.
        is_held_out: (usable samples,) bool.
    """

    training: np.ndarray
    episodes: np.ndarray
    held_out: np.ndarray
    held_out_names: np.ndarray
    held_out_episodes: int
    usable: np.ndarray
    is_held_out: np.ndarray

    @property
    def unusable(self) -> int:
        """Number of samples that were left out."""
        return int((~self.usable).sum())

    @cached_property
    def positions(self) -> np.ndarray:
        """(n,) the positions of the training samples among all samples."""
        return np.flatnonzero(self.usable)[~self.is_held_out]

    def demonstrated(self, space: FeatureSpace, settings: OCTreeSettings) -> np.ndarray:
        """Return the (k, 2) smallest and largest training values.

        Members of a family share them if the learner uses families.
        """
        ranges = np.stack([self.training.min(axis=0), self.training.max(axis=0)], axis=1)
        for family in map(list, families(space, settings)):
            ranges[family] = ranges[family, 0].min(), ranges[family, 1].max()
        return ranges


def families(space: FeatureSpace, settings: OCTreeSettings) -> tuple[tuple[int, ...], ...]:
    """Return the families that the learner uses: all with clipping by mass, else none."""
    return space.families if settings.clip == 'mass' else ()


def checked_samples(values: np.ndarray) -> np.ndarray:
    """Return ``values`` as (n, k) finite float64.

    Raises:
        DataError: no sample, or a value that is not finite.
    """
    try:
        if np.iscomplexobj(values):
            raise TypeError('complex numbers')
        samples = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise DataError(f'learning needs numbers, rows of equal length: {error}') from error
    if samples.ndim != 2 or not samples.size:
        raise DataError(f'learning needs samples of shape (n, k), got an array of {samples.shape}')
    # A sum tells at a glance; finite samples may have an infinite one.
    with np.errstate(over='ignore', invalid='ignore'):
        glance = samples.sum()
    if not np.isfinite(glance) and not np.isfinite(samples).all():
        row, column = np.argwhere(~np.isfinite(samples))[0]
        raise DataError(
            f'sample {row}, feature {column} is {samples[row, column]}; learning takes finite '
            'values only'
        )
    return samples


def divide_samples(
    values: np.ndarray,
    episodes: np.ndarray,
    space: FeatureSpace,
    *,
    rng: np.random.Generator,
    held_out_share: float = 0.2,
    hold_out_least: int = 0,
) -> Samples:
    """Leave out unusable samples, and hold out whole episodes.

    Args:
        values: (n, k) samples.
        episodes: (n,) the episode each sample belongs to.
        space: the features.
        rng: chooses the held-out episodes.
        held_out_share: share of episodes to hold out when there are five or more.
        hold_out_least: minimum number of episodes to hold out, up to half of all.

    Raises:
        DataError: there is no usable sample, or the share is not within 0 to 1.
    """
    if not 0.0 <= held_out_share < 1.0:
        raise DataError(f'held_out_share is {held_out_share}; allowed is 0 <= held_out_share < 1')
    rows = space.check_rows(values)
    if not len(rows):
        raise DataError('there are no samples to learn from; allowed are one or more')
    usable = space.knows(rows)
    if not usable.any():
        raise DataError(
            f'none of the {len(rows)} samples is usable: each has a value that is missing, not '
            f'finite or outside the physical bounds{_worst_feature(rows, space)}'
        )
    episodes = np.asarray(episodes)
    if not usable.all():
        # Copies of very many samples are not made for nothing.
        rows, episodes = rows[usable], episodes[usable]
    held_out = np.zeros(len(rows), dtype=bool)
    names = np.unique(episodes)
    chosen = names[:0]
    if len(names) >= LEAST_EPISODES_TO_HOLD_OUT:
        count = min(round(held_out_share * len(names)), len(names) - 1)
        count = max(count, min(hold_out_least, len(names) // 2))
        chosen = rng.choice(names, size=count, replace=False)
        held_out = np.isin(episodes, chosen)
    stays = slice(None) if not len(chosen) else ~held_out
    return Samples(
        rows[stays],
        episodes[stays],
        rows[held_out],
        episodes[held_out],
        len(chosen),
        usable,
        held_out,
    )


def _worst_feature(rows: np.ndarray, space: FeatureSpace) -> str:
    bad = ~(np.isfinite(rows) & (rows >= space.lows) & (rows <= space.highs))
    worst = int(bad.mean(axis=0).argmax())
    return f'; worst is {space.names[worst]!r}, unusable in {bad[:, worst].mean():.0%} of them'
