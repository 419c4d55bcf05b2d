# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Families of tables, which often have no place to declare them."""

from __future__ import annotations

import numpy as np

from occ_constraints_pkg.datasets.dataset import Dataset
from occ_constraints_pkg.learning.likely_families import (
    LikelyFamily,
    likely_families,
    with_families,
)
from occ_constraints_pkg.learning.settings import OCTreeSettings
from occ_constraints_pkg.rules.space import FeatureSpace


def take_families(
    data: Dataset, space: FeatureSpace, settings: OCTreeSettings
) -> tuple[FeatureSpace, list[str]]:
    """Declare the families that columns of tables look like.

    Names that say nothing, such as ``x0``, are not enough.

    Args:
        data: rows of the tables.
        space: their features, as far as the tables describe them.
        settings: of the learner. Clipping by density knows no families, so there are none.

    Returns:
        The feature space, and a sentence for each family.
    """
    if settings.clip != 'mass':
        return space, []
    rows = data.values[space.knows(data.values)]
    found = [family for family in likely_families(rows, space) if family.is_telling]
    return with_families(space, found), [_sentence(family, space) for family in found]


def _sentence(family: LikelyFamily, space: FeatureSpace) -> str:
    names = [space.names[member] for member in family.features]
    first = space.features[family.features[0]]
    told = ''
    if (family.low, family.high) != (first.low, first.high):
        upper = 'up' if family.high == np.inf else f'to {family.high:g}'
        told = f', and values from {family.low:g} {upper} are possible'
    return (
        f'the {len(names)} columns {names[0]} ... {names[-1]} are taken for a family, '
        f'{family.name!r}: they get the same bounds{told}; if that is wrong, learn with '
        '--no-families (in Python families=False)'
    )
