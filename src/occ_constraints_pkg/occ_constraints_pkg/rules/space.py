# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The feature space: features with their units and physical bounds."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from occ_constraints_pkg.errors import ConfigurationError


@dataclass(frozen=True)
class Feature:
    """One number that rules can refer to.

    Attributes:
        name: identifier, unique within its space.
        unit: SI unit, or ``1`` for a pure number.
        low: smallest physically possible value; a smaller input is UNKNOWN, not a violation.
        high: largest physically possible value.
        family: features of one family measure the same quantity in different places or directions,
            like the sectors of a lidar. They get the same bounds, and a literal may be about any
            of them. Empty for none.

    Example:
        >>> occ.Feature('clearance', 'm', low=0.0)
        Feature(name='clearance', unit='m', low=0.0, high=inf, family='')
    """

    name: str
    unit: str = '1'
    low: float = -np.inf
    high: float = np.inf
    family: str = ''


@dataclass(frozen=True)
class FeatureSpace:
    """An ordered tuple of features.

    Raises:
        ConfigurationError: no feature, a duplicate name, bounds that leave no value, or a family
            whose members differ in unit or bounds.

    Example:
        >>> space = occ.FeatureSpace((occ.Feature('speed', 'm/s'), occ.Feature('clearance', 'm')))
        >>> space.index('clearance')
        1
    """

    features: tuple[Feature, ...]

    def __post_init__(self) -> None:
        if not self.features:
            raise ConfigurationError('a feature space needs at least one feature, got none')
        if len(set(self.names)) != len(self.names):
            twice = next(name for name in self.names if self.names.count(name) > 1)
            raise ConfigurationError(f'feature {twice!r} is named twice; names must be unique')
        for feature in self.features:
            if not (feature.low <= feature.high and feature.low < np.inf > -feature.high):
                raise ConfigurationError(
                    f'feature {feature.name!r} has bounds [{feature.low}, {feature.high}]; '
                    'allowed are two numbers with at least one finite value from low to high'
                )
        for members in self.families:
            first = self.features[members[0]]
            for other in (self.features[index] for index in members[1:]):
                if (other.unit, other.low, other.high) != (first.unit, first.low, first.high):
                    raise ConfigurationError(
                        f'features {first.name!r} and {other.name!r} of family {first.family!r} '
                        'differ in unit or bounds; members of a family share both'
                    )

    def __len__(self) -> int:
        return len(self.features)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """The features' names, in order."""
        return tuple(feature.name for feature in self.features)

    @cached_property
    def families(self) -> tuple[tuple[int, ...], ...]:
        """The positions of each family's members, for families of two or more."""
        members: dict[str, list[int]] = {}
        for index, feature in enumerate(self.features):
            if feature.family:
                members.setdefault(feature.family, []).append(index)
        return tuple(tuple(group) for group in members.values() if len(group) > 1)

    @cached_property
    def lows(self) -> np.ndarray:
        """(k,) lower physical bounds, ``-inf`` where there is none."""
        return np.array([feature.low for feature in self.features], dtype=np.float64)

    @cached_property
    def highs(self) -> np.ndarray:
        """(k,) upper physical bounds, ``inf`` where there is none."""
        return np.array([feature.high for feature in self.features], dtype=np.float64)

    @cached_property
    def finite_bounds(self) -> np.ndarray:
        """(2, k) lows and highs with the largest floats for infinite ones.

        No NaN or infinity lies between them.
        """
        largest = np.finfo(np.float64).max
        return np.stack([self.lows, self.highs]).clip(-largest, largest)

    def index(self, name: str) -> int:
        """Return the position of a feature.

        Raises:
            ConfigurationError: there is no such feature.
        """
        try:
            return self.names.index(name)
        except ValueError:
            raise ConfigurationError(
                f'no feature {name!r}; there are {", ".join(self.names)}'
            ) from None

    def knows(self, rows: np.ndarray) -> np.ndarray:
        """Return (n,) bool, whether (n, k) rows are finite and within the physical bounds."""
        lows, highs = self.finite_bounds
        return ((rows >= lows) & (rows <= highs)).all(axis=1)

    def check_rows(self, values: np.ndarray) -> np.ndarray:
        """Return ``values`` as (n, k) float64.

        Raises:
            ConfigurationError: the shape is another one.
        """
        rows = np.asarray(values, dtype=np.float64)
        if rows.ndim != 2 or rows.shape[1] != len(self):
            raise ConfigurationError(
                f'expected rows of {len(self)} features ({", ".join(self.names)}), '
                f'got an array of shape {rows.shape}'
            )
        return rows
