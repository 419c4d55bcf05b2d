# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Parameters of the OC-tree learner."""

from __future__ import annotations

from dataclasses import dataclass

from occ_constraints_pkg.errors import OccError


@dataclass(frozen=True)
class OCTreeSettings:
    """Parameters of the OC-tree learner; gamma, alpha, beta and nu are the article's.

    Attributes:
        max_depth: most levels of splits, as in the paper; ``None`` for no limit.
        clip: how an attribute's outliers are cut off: ``mass`` (by the share of samples) or
            ``density`` (the article's way, by the share of the largest density).
        tail: for ``mass``: share of a node's samples left outside per split.
        gamma: for ``density``: share of the largest density below which values are outliers.
        alpha: a minimum of the density at most this share of the lower neighbouring maximum
            splits an interval.
        beta: an interval with a smaller share of all training samples is dropped.
        min_split: a node with a smaller share of all training samples is not divided further;
            the article has no such limit (0).
        nu: stop before more than this share of the training samples lies outside; ``None`` lets
            the depth limit alone decide.
    """

    max_depth: int | None = 20
    clip: str = 'mass'
    tail: float = 0.005
    gamma: float = 0.05
    alpha: float = 0.5
    beta: float = 0.0001
    min_split: float = 0.02
    nu: float | None = None

    def __post_init__(self) -> None:
        if self.clip not in ('mass', 'density'):
            raise OccError(f"clip is {self.clip!r}; allowed are 'mass' and 'density'")
        if self.max_depth is not None and self.max_depth < 0:
            raise OccError(f'max_depth is {self.max_depth}; allowed is 0 or more')
        for name in ('tail', 'gamma', 'beta', 'min_split'):
            value = getattr(self, name)
            if not 0.0 <= value < 1.0:
                raise OccError(f'{name} is {value}; allowed is 0 <= {name} < 1')
        if not 0.0 <= self.alpha <= 1.0:
            raise OccError(f'alpha is {self.alpha}; allowed is 0 <= alpha <= 1')
        if self.nu is not None and not 0.0 <= self.nu <= 1.0:
            raise OccError(f'nu is {self.nu}; allowed is 0 <= nu <= 1')
