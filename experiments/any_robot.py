# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Rules from one drive of each of many kinds of robots, tried on the next drives and on faults.

For each kind of :data:`.ROBOTS`, and for each of some drives: the feature map is the one that is
suggested for the drive, as it is, and rules are learned from it with the default learner. They
judge the other drives, which are as safe, and one for each fault that the kind may have.

All drives of a kind are drawn from the same distribution of tasks. A fault counts as told if for
half of the time that it lasts a rule is violated which is about a feature that should tell it.
"""

from __future__ import annotations

import re
import tempfile
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from occ_constraints_pkg.checking.timeline import Timeline, check_data
from occ_constraints_pkg.datasets.extraction import extract
from occ_constraints_pkg.demonstrations.learning import learn_from_files
from occ_constraints_pkg.documents import parse_yaml
from occ_constraints_pkg.features.feature_map import FeatureMap
from occ_constraints_pkg.files import make_directory
from occ_constraints_pkg.learning.settings import OCTreeSettings
from occ_constraints_pkg.rosbag.recording import Recording
from occ_constraints_pkg.rules.constraints_file import Constraints
from occ_constraints_pkg.suggestion.suggest import suggest_each
from occ_constraints_pkg.suggestion.text import suggestion_text

from experiments.results import markdown_table, write_results
from experiments.robot_kinds import ROBOTS, write_robot

TOLERATED = 0.02
_DRIVES = 5
_MOST_RULES = 3
# A fault lasts for a quarter of its drive.
_TOLD = 0.125


def run_any_robot(
    output: Path,
    *,
    kinds: Sequence[str] = (),
    seconds: Sequence[float] = (40.0, 120.0),
    progress: Callable[[int, int], None] = lambda *_: None,
) -> dict[str, Any]:
    """Run the experiment and write ``any_robot.json`` and ``any_robot.md``.

    Args:
        output: directory for the files; made if needed.
        kinds: of robots; empty for all.
        seconds: lengths of drives to try.
        progress: called with (kinds done, kinds in all).
    """
    make_directory(output)
    chosen = tuple(kinds) or tuple(ROBOTS)
    result: dict[str, Any] = {'drives': _DRIVES, 'seconds': {}}
    for place, length in enumerate(seconds):
        found = result['seconds'][f'{length:g}'] = {}
        for done, kind in enumerate(chosen):
            progress(place * len(chosen) + done, len(seconds) * len(chosen))
            with tempfile.TemporaryDirectory() as folder:
                found[kind] = try_kind(Path(folder), kind, range(1, _DRIVES + 1), length)
    write_results(output, 'any_robot', result, _markdown(result))
    return result


def try_kind(folder: Path, kind: str, seeds: Sequence[int], seconds: float) -> dict[str, Any]:
    """Learn from each of some drives of a kind of robot, and judge the others and the faults.

    Args:
        folder: for the recordings.
        kind: one of :data:`.ROBOTS`.
        seeds: of the drives.
        seconds: how long each drive takes.

    Returns:
        The numbers of maps, features and rules of the first drive, the shares of flagged and
        unknown time of each pair of drives, which rules flagged most of it, and the faults that
        were told, and were not.
    """
    drives = [write_robot(folder, kind, seed, seconds=seconds) for seed in seeds]
    faulty = {
        fault: write_robot(folder, kind, max(seeds) + 1, fault, seconds)
        for fault in ROBOTS[kind].faults
    }
    flagged: list[float] = []
    unknown: list[float] = []
    blamed: Counter[str] = Counter()
    told: Counter[str] = Counter()
    sizes: list[tuple[int, int, int]] = []
    for own in drives:
        learned = [(item, _learned(own, item)) for item in suggested_maps(own)]
        sizes.append(
            (
                len(learned),
                sum(len(item.names) for item, _ in learned),
                sum(len(constraints.rules) for _, constraints in learned),
            )
        )
        for feature_map, constraints in learned:
            for other in drives:
                if other is own:
                    continue
                timeline = check_data(extract([other], feature_map), constraints.rule_set)
                flagged.append(round(timeline.shares['VIOLATED'], 4))
                unknown.append(round(timeline.shares['UNKNOWN'], 4))
                blamed.update(_seconds_by_rule(timeline, constraints))
        for fault, word in ROBOTS[kind].faults.items():
            # Of several robots, the last one has the fault.
            feature_map, constraints = learned[-1]
            timeline = check_data(extract([faulty[fault]], feature_map), constraints.rule_set)
            by_rule = _seconds_by_rule(timeline, constraints)
            most = max((by_rule[text] for text in by_rule if re.search(word, text)), default=0.0)
            told[fault] += most > _TOLD * seconds
    maps, features, rules = sizes[0]
    return {
        'maps': maps,
        'features': features,
        'rules': rules,
        'flagged': flagged,
        'unknown': unknown,
        'rules_that_flag': [
            {'rule': text, 'seconds': round(most / len(flagged), 2)}
            for text, most in blamed.most_common(_MOST_RULES)
        ],
        'told': {fault: told[fault] / len(drives) for fault in ROBOTS[kind].faults},
    }


def suggested_maps(path: Path) -> list[FeatureMap]:
    """Return the maps that are suggested for a recording, as they are read from their text."""
    texts = [suggestion_text(suggestion) for suggestion in suggest_each(Recording(path))]
    return [FeatureMap.from_document(parse_yaml(text, 'map'), 'map', text=text) for text in texts]


def _learned(path: Path, feature_map: FeatureMap) -> Constraints:
    return learn_from_files([path], feature_map, OCTreeSettings(), rng=np.random.default_rng(0))


def _seconds_by_rule(timeline: Timeline, constraints: Constraints) -> Counter[str]:
    """Return for how long each rule was violated, by its text without its bound."""
    rules, seconds = constraints.rule_set, Counter[str]()
    for item in timeline.violations:
        words = rules.rules[item.rule].words(rules.space)
        seconds[re.sub(r' (above|below) \S+.*', r' \1', words)] += item.active
    return seconds


def _markdown(result: Mapping[str, Any]) -> str:
    lines = [
        '# One drive of any robot, and the next drives',
        '',
        'Written by `python -m experiments any_robot`. Synthetic drives with random goals, all of',
        'a kind from the same distribution. From one drive a map is suggested and used as it is,',
        f'the default learner learns, and the others are judged: {result["drives"]} drives each',
        'with each, and a drive for each fault. Rules that flag are named with the mean of their',
        'seconds.',
    ]
    for seconds, kinds in result['seconds'].items():
        rows = []
        for kind, found in kinds.items():
            shares = np.array(found['flagged'])
            rows.append(
                (
                    kind.replace('_', ' '),
                    found['features'],
                    found['rules'],
                    f'{np.mean(shares):.2%}',
                    f'{np.median(shares):.2%}',
                    f'{np.max(shares):.2%}',
                    f'{np.mean(shares <= TOLERATED):.0%}',
                    f'{np.mean(list(found["told"].values())):.0%}',
                    ', '.join(
                        f'{item["rule"]} ({item["seconds"]:.2g} s)'
                        for item in found['rules_that_flag']
                    ),
                )
            )
        heads = (
            *('robot', 'features', 'rules', 'flagged: mean', 'median', 'most', 'at most 2 %'),
            *('faults told', 'rules that flag'),
        )
        lines += ['', f'## Drives of {seconds} s', '', markdown_table(heads, rows)]
    return '\n'.join(lines) + '\n'
