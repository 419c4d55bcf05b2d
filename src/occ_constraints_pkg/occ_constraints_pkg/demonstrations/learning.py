# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""From files of demonstrations to constraints in one call."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from occ_constraints_pkg.datasets.dataset import Dataset, without_repeats
from occ_constraints_pkg.datasets.reading import read_demonstrations
from occ_constraints_pkg.demonstrations.concerns import concerns
from occ_constraints_pkg.demonstrations.families import take_families
from occ_constraints_pkg.errors import ConfigurationError, DataError
from occ_constraints_pkg.features.feature_map import FeatureMap
from occ_constraints_pkg.learning.conditional import ConditionalSettings
from occ_constraints_pkg.learning.conditional.settings import resolved_conditions
from occ_constraints_pkg.learning.conditional.units import MOST_COMBINED
from occ_constraints_pkg.learning.learn import learn
from occ_constraints_pkg.learning.settings import OCTreeSettings
from occ_constraints_pkg.rules.constraints_file import Constraints
from occ_constraints_pkg.rules.space import FeatureSpace
from occ_constraints_pkg.wording import count_of

# Fewer episodes hardly ever prove that a corner is empty for a reason.
_FEW_EPISODES = 20


def learn_from_files(
    paths: Sequence[str | Path],
    feature_map: FeatureMap | None,
    settings: OCTreeSettings,
    *,
    rng: np.random.Generator,
    conditional: ConditionalSettings | None = None,
    false_alarm: float | None = None,
    calibrate_on: Sequence[str | Path] = (),
    families: bool = True,
    namespace: str = '',
    progress: Callable[[int, int], None] | None = None,
    warn: Callable[[str], None] | None = None,
) -> Constraints:
    """Read the features of recordings or of tables, and learn constraints from them.

    Args:
        paths: rosbag2 directories or MCAP files; or ``.npz``, ``.csv`` or ``.parquet`` files.
        feature_map: what to extract, see :func:`read_demonstrations`. It is kept with the rules,
            so that they can be monitored.
        settings: the tree learner's parameters.
        rng: chooses the held-out episodes.
        conditional: which rules with several literals to look for as well; ``None`` for the
            default. Evidence is counted by :attr:`.Dataset.independent`.
        false_alarm: largest probability of an alarm in a fresh safe episode, see
            :func:`~occ_constraints_pkg.learning.learn.learn`; ``None`` for no guarantee.
        calibrate_on: recordings or tables of safe episodes for that guarantee, from which nothing
            is learned; none: held-out episodes of ``paths``.
        families: whether columns of tables that look like one measurement in several directions
            are taken for a family, see :func:`.take_families`. With a feature map, which declares
            them, ``warn`` is told.
        namespace: of the robot in recordings, see :meth:`.FeatureMap.in_namespace`.
        progress: called with (messages read, messages in all); not for tables.
        warn: called with a sentence for each thing that is damaged, for samples left out, and for
            what is likely not meant, see :mod:`~occ_constraints_pkg.demonstrations.concerns`.

    Raises:
        OccError: a file cannot be read or lacks a feature, no sample is usable, there are too
            few episodes for the guarantee, or settings do not go together.
    """
    asked = conditional is not None
    conditional = resolved_conditions(conditional, settings)
    if calibrate_on and false_alarm is None:
        raise ConfigurationError('calibrate_on is given without false_alarm; give both or neither')
    data, space = read_demonstrations(paths, feature_map, namespace=namespace, progress=progress)
    data, repeats = without_repeats(data)
    taken: list[str] = []
    if families and feature_map is None:
        space, taken = take_families(data, space, settings)
    safe, safe_episodes = None, None
    if calibrate_on:
        safe, _ = read_demonstrations(
            calibrate_on, feature_map, space, namespace=namespace, progress=progress
        )
        # What was learned from proves nothing about fresh episodes.
        safe, more = without_repeats(safe, data)
        repeats += more
        if not len(safe):
            raise DataError(
                f'{", ".join(map(str, calibrate_on))}: all of it is learned from, so it cannot be '
                'calibrated on; give other recordings or tables'
            )
        safe_episodes = safe.values, safe.episodes
    constraints = learn(
        data.values,
        data.episodes,
        space,
        settings,
        rng=rng,
        conditional=conditional,
        independent=data.independent,
        false_alarm=false_alarm,
        safe_episodes=safe_episodes,
        feature_map=None if feature_map is None else feature_map.to_document(),
        # Those that were learned from come first: the evidence speaks of them by position.
        bags=(*data.sources, *(() if safe is None else safe.sources)),
        origin=data.origin,
    )
    if warn is not None:
        sentences = [*_damage(data, constraints), *repeats, *taken]
        sentences += concerns(data, space, settings, families=families)
        sentences += _of_conditions(data, space, conditional, constraints, asked=asked)
        for sentence in (*sentences, *(() if safe is None else safe.warnings)):
            warn(sentence)
    return constraints


def _damage(data: Dataset, constraints: Constraints) -> list[str]:
    """Return what was damaged, and how many samples could not be used."""
    unusable = constraints.learner['unusable_samples']
    if not unusable:
        return list(data.warnings)
    return [
        *data.warnings,
        f'{unusable} of {len(data)} samples were left out: a value was missing, not finite or '
        'outside its physical bounds',
    ]


def _of_conditions(
    data: Dataset,
    space: FeatureSpace,
    conditional: ConditionalSettings,
    constraints: Constraints,
    *,
    asked: bool,
) -> list[str]:
    """Return why no conditional rule was found, if features are too many or episodes too few.

    Whoever did not ask for conditional rules does not miss them among few episodes.
    """
    if not conditional.looks or any(len(rule.literals) > 1 for rule in constraints.rules):
        return []
    together = sum(map(len, space.families))
    # The least and the largest of a family are looked at, each on its own.
    count = len(space) - together + 2 * len(space.families)
    if count > MOST_COMBINED:
        return [
            f'conditional rules were not looked for among {len(space)} features, a family counted '
            f'as two; allowed are {MOST_COMBINED}: give fewer, give those that measure the same a '
            'family, or --conditions none'
        ]
    groups, episodes = len(np.unique(data.independent)), len(np.unique(data.episodes))
    if not asked or groups >= _FEW_EPISODES:
        return []
    counted = count_of(groups, 'episode')
    if groups < episodes:
        counted = f'{count_of(groups, "recording")} with episodes at the same time'
    return [
        f'no conditional rule was found in {counted}; fewer than {_FEW_EPISODES} hardly ever prove '
        'that a combination of values is avoided'
    ]
