# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""How many seconds before a violation the early warning comes, and how often it is wrong.

On recordings of real robots with contact, by rules learned from the safe ones as in the experiment
``robots``, and on recordings of simulated episodes, by rules learned from those of an expert. Each
is judged with its own safe recordings as well, where few warnings but false ones can come.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from occ_constraints_pkg.checking.early_warning import WarningRecord, warning_record
from occ_constraints_pkg.checking.early_warning_text import warnings_summary
from occ_constraints_pkg.checking.timeline import make_timeline
from occ_constraints_pkg.datasets.dataset import Dataset
from occ_constraints_pkg.datasets.extraction import extract
from occ_constraints_pkg.features.feature_map import load_feature_map
from occ_constraints_pkg.learning.learn import learn
from occ_constraints_pkg.learning.settings import OCTreeSettings
from occ_constraints_pkg.rules.forecast import WINDOW_SECONDS
from occ_constraints_pkg.rules.ruleset import RuleSet

from experiments.results import data_folder, markdown_table, write_results
from experiments.robots import (
    KINDS,
    learn_safe,
    other_recordings,
    read_recorded,
    safe_recordings,
    suggested_map,
)

HORIZONS = (0.5, 1.0, 2.0)
# World, recording of the expert, recording of the driver that violates.
DRIVES = (
    ('simple_nav', 'simple_nav_expert', 'simple_nav_straight'),
    ('PointGoal1', 'point_goal_expert', 'point_goal_straight'),
)
SETS = (*KINDS, *(world for world, _, _ in DRIVES))


def run_warnings(
    output: Path,
    *,
    folder: Path | None = None,
    bags: Path = Path('bags'),
    names: Sequence[str] = (),
    progress: Callable[[int, int], None] = lambda *_: None,
) -> dict[str, Any]:
    """Run the experiment and write ``warnings.json`` and ``warnings.md``.

    Args:
        output: directory for the files; made if needed.
        folder: where the recordings of robots are; default: ``robots``, see :func:`.data_folder`.
        bags: where the recordings of simulated episodes are, those of this repository.
        names: of the sets of recordings, a kind of robot or a world; empty for all.
        progress: called with (sets of recordings done, sets in all).

    Raises:
        OccError: a recording is missing or cannot be read.
    """
    folder = folder or data_folder('robots')
    result: dict[str, Any] = {'window': WINDOW_SECONDS, 'sets': {}}
    chosen = tuple(names) or SETS
    for done, name in enumerate(chosen):
        progress(done, len(chosen))
        if name in KINDS:
            rule_set, safe, violating = _robots(folder, name)
        else:
            rule_set, safe, violating = _simulated(bags, name)
        result['sets'][name] = {
            'violating': [_tried(rule_set, violating, horizon) for horizon in HORIZONS],
            'safe': [_tried(rule_set, safe, horizon) for horizon in HORIZONS],
        }
    write_results(output, 'warnings', result, _markdown(result))
    return result


def _robots(folder: Path, kind: str) -> tuple[RuleSet, list[Dataset], list[Dataset]]:
    paths = safe_recordings(folder, kind)
    feature_map, _ = suggested_map(paths[0], kind)
    safe = [read_recorded(path, feature_map) for path in paths]
    violating = [read_recorded(path, feature_map).data for path in other_recordings(folder, kind)]
    places = list(range(len(feature_map.names)))
    rule_set = learn_safe(safe, feature_map, places).rule_set
    return rule_set, [item.data for item in safe], violating


def _simulated(bags: Path, name: str) -> tuple[RuleSet, list[Dataset], list[Dataset]]:
    world, safe_bag, other_bag = next(item for item in DRIVES if item[0] == name)
    feature_map = load_feature_map(world)
    safe, other = (extract([bags / bag], feature_map) for bag in (safe_bag, other_bag))
    rules = learn(
        safe.values,
        safe.episodes,
        feature_map.space,
        OCTreeSettings(),
        rng=np.random.default_rng(0),
        feature_map=feature_map.to_document(),
    )
    return rules.rule_set, [safe], [other]


def _tried(rule_set: RuleSet, items: Sequence[Dataset], horizon: float) -> dict[str, Any]:
    records, seconds = [], 0.0
    for data in items:
        timeline = make_timeline(rule_set, data, rule_set.judge(data.values))
        records.append(warning_record(timeline, rule_set, horizon=horizon))
        seconds += timeline.duration
    whole = WarningRecord(
        horizon,
        tuple(onset for record in records for onset in record.onsets),
        sum(record.warnings for record in records),
        sum(record.false for record in records),
    )
    return {'seconds': round(seconds, 2), **warnings_summary(whole)}


def _markdown(result: dict[str, Any]) -> str:
    heads = ('recordings', 'time', 'horizon', 'violations', 'warned of', 'median before')
    rows = [
        _row(f'{name}, {title}', entry)
        for name, found in result['sets'].items()
        for title in ('violating', 'safe')
        for entry in found[title]
    ]
    return (
        '# Early warnings\n\n'
        'Written by `python -m experiments warnings`. A warning is given while a violation is '
        f'estimated within the horizon, by slopes over {result["window"]:g} s; it is false when '
        'none comes within the horizon after it.\n\n'
        f'{markdown_table((*heads, "least before", "warnings", "false"), rows)}\n'
    )


def _row(title: str, entry: dict[str, Any]) -> list[object]:
    def seconds(key: str) -> str:
        return '-' if entry[key] is None else f'{entry[key]:.2f} s'

    share = entry['false_share']
    false = f'{entry["false"]}' + ('' if share is None else f' ({share:.0%})')
    row = [title, f'{entry["seconds"]:.0f} s', f'{entry["horizon"]:g} s', entry['onsets']]
    row += [entry['warned'], seconds('median_seconds'), seconds('least_seconds')]
    return [*row, entry['warnings'], false]
