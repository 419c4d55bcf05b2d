# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""From recordings of demonstrations to constraints, in one call."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from occ_constraints_pkg.bags.extract import extract
from occ_constraints_pkg.bags.feature_map import FeatureMap
from occ_constraints_pkg.learning.learn import learn
from occ_constraints_pkg.learning.settings import OCTreeSettings
from occ_constraints_pkg.rules.constraints_file import Constraints


def learn_from_recordings(
    paths: Sequence[str | Path],
    feature_map: FeatureMap,
    settings: OCTreeSettings,
    *,
    rng: np.random.Generator,
    progress: Callable[[int, int], None] | None = None,
    warn: Callable[[str], None] | None = None,
) -> Constraints:
    """Extract the features of recordings and learn constraints from them.

    Args:
        paths: rosbag2 directories or MCAP files.
        feature_map: what to extract.
        settings: the tree learner's parameters.
        rng: chooses the held-out episodes.
        progress: called with (messages read, messages in all).
        warn: called with a sentence for each thing that is damaged, and for samples left out.

    Raises:
        OccError: a recording cannot be read or lacks a mapped topic, or no sample is usable.
    """
    data = extract(paths, feature_map, progress=progress)
    constraints = learn(
        data.values,
        data.episodes,
        feature_map.space,
        settings,
        rng=rng,
        feature_map=feature_map.to_document(),
        bags=data.sources,
    )
    if warn is not None:
        for sentence in data.warnings:
            warn(sentence)
        unusable = constraints.learner['unusable_samples']
        if unusable:
            warn(
                f'{unusable} of {len(data)} samples were left out: a value was missing, not finite '
                'or outside its physical bounds'
            )
    return constraints
