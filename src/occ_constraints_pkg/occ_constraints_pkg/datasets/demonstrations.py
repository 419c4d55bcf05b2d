# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""From files of demonstrations to constraints in one call, and from files to what rules judge."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from occ_constraints_pkg.datasets.concerns import concerns
from occ_constraints_pkg.datasets.dataset import Dataset
from occ_constraints_pkg.datasets.extraction import extract
from occ_constraints_pkg.datasets.manifest import select
from occ_constraints_pkg.datasets.repeats import without_repeats
from occ_constraints_pkg.datasets.table_files import TABLE_ENDINGS, are_table_files, read_tables
from occ_constraints_pkg.errors import DataError
from occ_constraints_pkg.features.feature_map import FeatureMap
from occ_constraints_pkg.learning.learn import learn
from occ_constraints_pkg.learning.settings import OCTreeSettings
from occ_constraints_pkg.rules.constraints_file import Constraints
from occ_constraints_pkg.rules.space import FeatureSpace


def learn_from_files(
    paths: Sequence[str | Path],
    feature_map: FeatureMap | None,
    settings: OCTreeSettings,
    *,
    rng: np.random.Generator,
    false_alarm: float | None = None,
    calibrate_on: Sequence[str | Path] = (),
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
        false_alarm: largest probability of an alarm in a fresh safe episode, see
            :func:`~occ_constraints_pkg.learning.learn.learn`; ``None`` to promise nothing.
        calibrate_on: recordings or tables of safe episodes for that promise, from which nothing
            is learned; none: held-out episodes of ``paths``.
        progress: called with (messages read, messages in all); not for tables.
        warn: called with a sentence for each thing that is damaged, for samples left out, and for
            what is likely not meant, see :mod:`~occ_constraints_pkg.datasets.concerns`.

    Raises:
        OccError: a file cannot be read or lacks a feature, no sample is usable, or there are too
            few episodes for the promise.
    """
    if calibrate_on and false_alarm is None:
        raise DataError(
            'there is something to calibrate on but no false_alarm to promise; give one'
        )
    data, space = read_demonstrations(paths, feature_map, progress=progress)
    data, repeats = without_repeats(data)
    safe, safe_episodes = None, None
    if calibrate_on:
        safe, _ = read_demonstrations(calibrate_on, feature_map, space, progress=progress)
        # What was learned from proves nothing about fresh episodes.
        safe, more = without_repeats(safe, data)
        repeats += more
        if not len(safe):
            raise DataError(
                f'{", ".join(map(str, calibrate_on))}: there is nothing to calibrate on that is '
                'not learned from; allowed are other recordings or tables'
            )
        safe_episodes = safe.values, safe.episodes
    constraints = learn(
        data.values,
        data.episodes,
        space,
        settings,
        rng=rng,
        false_alarm=false_alarm,
        safe_episodes=safe_episodes,
        feature_map=None if feature_map is None else feature_map.to_document(),
        # Those that were learned from come first: the evidence speaks of them by position.
        bags=(*data.sources, *(() if safe is None else safe.sources)),
        origin=data.origin,
    )
    if warn is not None:
        sentences = [*_damage(data, constraints), *repeats, *concerns(data, space, settings)]
        for sentence in (*sentences, *(() if safe is None else safe.warnings)):
            warn(sentence)
    return constraints


def read_demonstrations(
    paths: Sequence[str | Path],
    feature_map: FeatureMap | None,
    space: FeatureSpace | None = None,
    *,
    progress: Callable[[int, int], None] | None = None,
) -> tuple[Dataset, FeatureSpace]:
    """Read the features of recordings or of tables.

    Args:
        paths: recordings only, or table files only.
        feature_map: what to extract. Of tables, the columns of its names are read.
        space: without a feature map, the columns of tables to read; None: every column is a
            feature.
        progress: called with (messages read, messages in all); not for tables.

    Raises:
        OccError: a file cannot be read or lacks a feature, tables and recordings are mixed, or
            there are recordings and no feature map.
    """
    if are_table_files(paths):
        return read_tables(paths, space if feature_map is None else feature_map.space)
    if feature_map is None:
        # A feature map or constraints among the data are told as what they are.
        select(paths)
        raise DataError(
            f'{paths[0]} is no table ({TABLE_ENDINGS}), and a recording needs a feature map: '
            '-m FILE or a name'
        )
    return extract(paths, feature_map, progress=progress), feature_map.space


def read_for_rules(
    paths: Sequence[str | Path],
    constraints: Constraints,
    where: str,
    *,
    max_lag: float = 0.0,
    progress: Callable[[int, int], None] | None = None,
) -> Dataset:
    """Read the features that rules speak of: from recordings by the feature map, or from tables.

    The hashes of recordings, which only learning writes down, are not computed.

    Args:
        paths: recordings only, or table files only, whose columns are found by name.
        constraints: the rules, and for recordings their feature map.
        where: what errors call the constraints.
        max_lag: seconds that a message of a recording may come late, see
            :class:`~occ_constraints_pkg.features.extractor.FeatureExtractor`; 0 for any.
        progress: called with (messages read, messages in all); not for tables.

    Raises:
        OccError: a file cannot be read or lacks a feature, tables and recordings are mixed, or
            recordings are given and the constraints have no feature map.
    """
    if are_table_files(paths):
        data, _ = read_tables(paths, constraints.rule_set.space)
        return data
    if constraints.feature_map is None:
        raise DataError(
            f'{where} has no feature_map, so no topic gives its features; '
            'allowed are tables (.npz, .csv, .parquet) with columns of their names'
        )
    feature_map = FeatureMap.from_document(constraints.feature_map, where)
    return extract(paths, feature_map, max_lag=max_lag, progress=progress, provenance=False)


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
