# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""What a program calls: learn from recordings, check recordings, suggest a feature map."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from occ_constraints_pkg.checking.files import check_files
from occ_constraints_pkg.checking.timeline import BRIDGE_SECONDS, TIMEOUT_SECONDS
from occ_constraints_pkg.demonstrations.learning import learn_from_files
from occ_constraints_pkg.documents import parse_yaml
from occ_constraints_pkg.features.feature_map import FeatureMap, load_feature_map
from occ_constraints_pkg.features.lateness import MAX_LAG_SECONDS
from occ_constraints_pkg.learning.conditional.settings import chosen_conditions
from occ_constraints_pkg.learning.settings import OCTreeSettings
from occ_constraints_pkg.rosbag.recording import Recording
from occ_constraints_pkg.rules.constraints_file import Constraints, load_constraints
from occ_constraints_pkg.rules.rule import Rule
from occ_constraints_pkg.rules.verdict import Judgement
from occ_constraints_pkg.suggestion.suggest import suggest
from occ_constraints_pkg.suggestion.text import suggestion_text

Paths = str | Path | Sequence[str | Path]


@dataclass(frozen=True, eq=False)
class Violation:
    """A stretch of one episode in which one rule is true.

    Attributes:
        rule: the rule.
        recording: name of the recording or table.
        episode: number of the episode.
        start: seconds since the recording's first message; for tables the row number.
        end: when the rule stopped being true, likewise.
        margin: the rule's smallest own margin in that time, at most 0.
        values: each feature's value in that sample, by its name.

    Example:
        >>> constraints = occ.learn('bags/simple_nav_expert', 'simple_nav')
        >>> report = occ.check('bags/simple_nav_straight', constraints)
        >>> first = report.violations[0]
        >>> print(first.rule.words(constraints.space), f'from {first.start:.1f} s')
        x below 0.737 and y above 0.298 from 0.9 s
    """

    rule: Rule
    recording: str
    episode: int
    start: float
    end: float
    margin: float
    values: Mapping[str, float]


@dataclass(frozen=True, eq=False)
class Report:
    """What :func:`check` found.

    Attributes:
        is_safe: whether every sample is SAFE and none was missing.
        shares: share of the time of each verdict, by its name; of the rows for tables.
        violations: sorted by recording, episode and start.
        judgement: verdict, first violated rule and margin of each of the n samples.

    Example:
        >>> constraints = occ.learn('bags/point_goal_expert', 'PointGoal1')
        >>> report = occ.check('bags/point_goal_straight', constraints)
        >>> print(f'{report.shares["VIOLATED"]:.1%} of the time VIOLATED')
        3.1% of the time VIOLATED
    """

    is_safe: bool
    shares: Mapping[str, float]
    violations: tuple[Violation, ...]
    judgement: Judgement


def learn(
    paths: Paths,
    feature_map: FeatureMap | str | Path | None = None,
    *,
    conditions: str | None = None,
    apart: Sequence[tuple[str, str]] = (),
    false_alarm: float | None = None,
    calibrate_on: Paths = (),
    families: bool = True,
    seed: int = 0,
    **settings: Any,
) -> Constraints:
    """Learn constraints from recordings or tables of safe behaviour, as ``occ learn`` does.

    What is damaged, left out or likely not meant is reported as a Python warning.

    Args:
        paths: rosbag2 directories, storage files, or manifests that list them; or ``.npz``,
            ``.csv`` or ``.parquet`` tables.
        feature_map: a map, the path of one, or the name of a built-in one. Recordings need it;
            without one every column of a table is a feature.
        conditions: ``triples`` or ``pairs`` to look for rules about up to three, or two, features
            as well; ``none`` for the box alone. ``None`` for the default: triples, or none with
            settings with which the safe set is more than a box.
        apart: pairs of features or families that no such rule may combine, besides those of the
            feature map.
        false_alarm: largest probability of an alarm in a fresh safe episode; ``None`` for no
            guarantee.
        calibrate_on: safe episodes for that guarantee, from which nothing is learned; none: held-
            out episodes of ``paths``.
        families: whether columns of tables that are named and behave like one measurement in
            several directions (``d_0`` to ``d_15``) are taken for a family, with the same bounds.
        seed: chooses the held-out episodes.
        settings: attributes of :class:`~occ_constraints_pkg.learning.settings.OCTreeSettings`,
            for example ``contamination=0.01``.

    Raises:
        OccError: a file cannot be read or lacks a feature, no sample is usable, a setting is not
            allowed, or there are too few episodes for the guarantee.

    Example:
        >>> constraints = occ.learn('bags/simple_nav_expert', 'simple_nav')
        >>> for rule in constraints.rules:
        ...     print(rule.id, rule.words(constraints.space))
        R94ae8 x below 0.08225
        R5de3a x above 0.9021
        Ra3a47 y below 0.08584
        R62a3d y above 0.9052
        R00b2f x below 0.737 and y above 0.298
        >>> constraints.save('nav.yaml')
    """
    if feature_map is not None and not isinstance(feature_map, FeatureMap):
        feature_map = load_feature_map(feature_map)
    sentences: list[str] = []
    constraints = learn_from_files(
        _listed(paths),
        feature_map,
        OCTreeSettings(**settings),
        rng=np.random.default_rng(seed),
        conditional=chosen_conditions(conditions, apart),
        false_alarm=false_alarm,
        calibrate_on=_listed(calibrate_on),
        families=families,
        warn=sentences.append,
    )
    for sentence in sentences:
        _warn(sentence)
    return constraints


def check(
    paths: Paths,
    constraints: Constraints | str | Path,
    *,
    timeout: float = TIMEOUT_SECONDS,
    bridge: float = BRIDGE_SECONDS,
    max_lag: float = MAX_LAG_SECONDS,
) -> Report:
    """Judge recordings or tables by constraints, as ``occ check`` does.

    Args:
        paths: recordings only, or tables only, whose columns are found by name.
        constraints: the constraints, or the path of their file.
        timeout: seconds that a verdict is valid without new input; after that it is UNKNOWN.
        bridge: violations of one rule that are at most so many seconds apart count as one.
        max_lag: seconds that a message may come late until the verdict is UNKNOWN; 0 for any.

    Raises:
        OccError: a file cannot be read, lacks a feature, or there are recordings and the
            constraints have no feature map.

    Example:
        >>> constraints = occ.learn('bags/simple_nav_expert', 'simple_nav')
        >>> report = occ.check('bags/simple_nav_straight', constraints, timeout=0.5)
        >>> report.is_safe, len(report.violations)
        (False, 200)
    """
    where = 'the constraints'
    if not isinstance(constraints, Constraints):
        where, constraints = str(constraints), load_constraints(constraints)
    timeline = check_files(
        _listed(paths), constraints, where, max_lag=max_lag, timeout=timeout, bridge=bridge
    )
    data, rule_set = timeline.data, constraints.rule_set
    for sentence in data.warnings:
        _warn(sentence)
    if rule_set.problem:
        _warn(f'{where}: {rule_set.problem}, so every verdict is UNKNOWN')
    violations = tuple(
        Violation(
            rule_set.rules[item.rule],
            data.sources[item.source]['name'],
            item.episode,
            item.start,
            item.end,
            item.margin,
            dict(zip(data.names, data.values[item.worst].tolist(), strict=True)),
        )
        for item in timeline.violations
    )
    return Report(timeline.is_safe, timeline.shares, violations, timeline.judgement)


def suggest_feature_map(path: str | Path) -> FeatureMap:
    """Suggest a feature map for a recording, as ``occ features suggest`` does.

    The command writes the same map as a commented file, which is to be read and edited. What
    the recording lacks is reported as a Python warning.

    Args:
        path: a rosbag2 directory or a storage file (``.mcap``, ``.db3``).

    Raises:
        OccError: the recording cannot be read, or has no topic of which a feature can be
            suggested.

    Example:
        >>> feature_map = occ.suggest_feature_map('bags/simple_nav_expert')
        >>> print(feature_map.pace, *feature_map.names)
        observation x y
    """
    suggestion = suggest(Recording(path))
    for sentence in suggestion.warnings:
        _warn(sentence)
    where, text = f'the map suggested for {path}', suggestion_text(suggestion)
    return FeatureMap.from_document(parse_yaml(text, where), where, text=text)


def _listed(paths: Paths) -> list[str | Path]:
    return [paths] if isinstance(paths, str | Path) else list(paths)


def _warn(sentence: str) -> None:
    """Warn at the line that called a function of this module."""
    warnings.warn(sentence, UserWarning, stacklevel=3)
