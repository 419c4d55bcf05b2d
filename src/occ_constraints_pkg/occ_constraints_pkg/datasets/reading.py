# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Rows of features from files, recordings and tables alike: to learn from, or to check."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from occ_constraints_pkg.datasets.dataset import Dataset
from occ_constraints_pkg.datasets.extraction import extract
from occ_constraints_pkg.datasets.manifest import Selection, select
from occ_constraints_pkg.datasets.table_files import TABLE_ENDINGS, are_table_files, read_tables
from occ_constraints_pkg.errors import DataError
from occ_constraints_pkg.features.feature_map import FeatureMap
from occ_constraints_pkg.rules.constraints_file import Constraints
from occ_constraints_pkg.rules.space import FeatureSpace


def read_demonstrations(
    paths: Sequence[str | Path],
    feature_map: FeatureMap | None,
    space: FeatureSpace | None = None,
    *,
    namespace: str = '',
    progress: Callable[[int, int], None] | None = None,
) -> tuple[Dataset, FeatureSpace]:
    """Read the features of recordings or of tables.

    Args:
        paths: recordings only, or table files only.
        feature_map: what to extract. Of tables, the columns of its names are read.
        space: without a feature map, the columns of tables to read; None: every column is a
            feature.
        namespace: of the robot in recordings, see :meth:`.FeatureMap.in_namespace`.
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
    data = extract(paths, feature_map, namespace=namespace, progress=progress)
    return data, feature_map.space


def read_for_rules(
    paths: Sequence[str | Path | Selection],
    constraints: Constraints,
    where: str,
    *,
    max_lag: float = 0.0,
    namespace: str = '',
    provenance: bool = False,
    progress: Callable[[int, int], None] | None = None,
) -> Dataset:
    """Read the features that rules speak of: from recordings by the feature map, or from tables.

    Args:
        paths: recordings only, or table files only, whose columns are found by name.
        constraints: the rules, and for recordings their feature map.
        where: what errors call the constraints.
        max_lag: seconds that a message of a recording may come late, see
            :class:`~occ_constraints_pkg.features.extractor.FeatureExtractor`; 0 for any.
        namespace: as of :func:`read_demonstrations`.
        provenance: whether the sources tell hashes of recordings, for which the files are read
            once more; tables always have theirs.
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
    return extract(
        paths,
        feature_map,
        max_lag=max_lag,
        namespace=namespace,
        progress=progress,
        provenance=provenance,
    )
