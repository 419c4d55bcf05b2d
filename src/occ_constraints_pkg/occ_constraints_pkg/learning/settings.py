# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Parameters of the OC-tree learner."""

from __future__ import annotations

from dataclasses import dataclass
from numbers import Integral, Real
from typing import Any

from occ_constraints_pkg.errors import ConfigurationError

# Deeper trees could not be written to a file: YAML and JSON schema readers recurse.
DEEPEST = 100


@dataclass(frozen=True)
class OCTreeSettings:
    """Parameters of the OC-tree learner; gamma, alpha, beta and nu are the article's.

    Attributes:
        max_depth: most levels of splits, as in the paper; ``None``, as in the article, for no
            limit but :data:`DEEPEST`.
        clip: how outliers of an attribute are cut off: ``mass`` (by the share of samples) or
            ``density`` (as in the article, by the share of the largest density).
        contamination: for ``mass``: share of the demonstrated samples that may lie outside,
            distributed over the features so that the safe set becomes smallest. ``None`` estimates
            the bounds, with at most
            :data:`~occ_constraints_pkg.learning.edges.MOST_ESTIMATED` of the samples outside, and
            :data:`~occ_constraints_pkg.learning.edges.MOST_EVEN` where these are bad for sure.
        gamma: for ``density``: share of the largest density below which values are outliers.
        alpha: a minimum of the density at most this share of the lower neighbouring maximum
            splits an interval; 0 never splits. The article advises 0.5.
        beta: an interval with a smaller share of all training samples is dropped.
        min_split: a node with a smaller share of all training samples is not divided further;
            the article has no such limit (0).
        nu: stop before more than this share of the training samples lies outside; ``None`` lets
            the depth limit alone decide.
        full_conditions: write rules with both bounds of every branch above them, as the paper
            does, even if other rules imply them.

    Raises:
        ConfigurationError: a value is not allowed.
    """

    max_depth: int | None = 20
    clip: str = 'mass'
    contamination: float | None = None
    gamma: float = 0.05
    alpha: float = 0.0
    beta: float = 0.0001
    min_split: float = 0.02
    nu: float | None = None
    full_conditions: bool = False

    @classmethod
    def article(cls, **overrides: Any) -> OCTreeSettings:
        """Return the settings of the article, section 3 and the advice it gives there.

        Clipping at 5 % of the largest density, revision at half of the lower maximum, intervals
        of at least 2 % of the training samples, growth until 10 % of them are outside; no limit
        of depth but :data:`DEEPEST` and none of node size. The article chooses alpha from 0.5 to
        0.8 and nu from 0.05 to 0.2 by cross-validation. Rules name every bound on their path, as
        its list of hyper-rectangles does.

        Args:
            overrides: attributes to set otherwise.

        Raises:
            ConfigurationError: a value is not allowed.
        """
        preset = {
            'max_depth': None,
            'clip': 'density',
            'gamma': 0.05,
            'alpha': 0.5,
            'beta': 0.02,
            'min_split': 0.0,
            'nu': 0.1,
            'full_conditions': True,
        }
        return cls(**{**preset, **overrides})

    def __post_init__(self) -> None:
        if self.clip not in ('mass', 'density'):
            raise ConfigurationError(f"clip is {self.clip!r}; allowed are 'mass' and 'density'")
        self._check_types()
        if self.max_depth is not None and not 0 <= self.max_depth <= DEEPEST:
            raise ConfigurationError(f'max_depth is {self.max_depth}; allowed is 0 to {DEEPEST}')
        for name in ('contamination', 'gamma', 'beta', 'min_split'):
            value = getattr(self, name)
            if value is None and name == 'contamination':
                continue
            if not 0.0 <= value < 1.0:
                raise ConfigurationError(f'{name} is {value}; allowed is 0 <= {name} < 1')
        if not 0.0 <= self.alpha <= 1.0:
            raise ConfigurationError(f'alpha is {self.alpha}; allowed is 0 <= alpha <= 1')
        if self.nu is not None and not 0.0 <= self.nu <= 1.0:
            raise ConfigurationError(f'nu is {self.nu}; allowed is 0 <= nu <= 1')

    def _check_types(self) -> None:
        """Refuse values that are not numbers."""
        for name in ('max_depth', 'contamination', 'gamma', 'alpha', 'beta', 'min_split', 'nu'):
            value, kind = getattr(self, name), Integral if name == 'max_depth' else Real
            if value is None and name in ('max_depth', 'contamination', 'nu'):
                continue
            if not isinstance(value, kind):
                what = 'a whole number' if kind is Integral else 'a number'
                raise ConfigurationError(f'{name} is {value!r}; allowed is {what}')
