# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Loads damaged YAML and JSON documents: ``python -m fuzz_documents FIRST COUNT``, in ``tests``."""

from __future__ import annotations

import json
import sys
import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
from fuzzing import damaged_text, watch
from occ_constraints_pkg.agents.training import read_metrics
from occ_constraints_pkg.datasets.manifest import load_manifest
from occ_constraints_pkg.documents import dump_yaml, parse_yaml
from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.features.feature_map import FeatureMap, load_feature_map, map_of
from occ_constraints_pkg.learning.evidence import describe_why, why_document
from occ_constraints_pkg.learning.learn import learn
from occ_constraints_pkg.learning.rules_text import describe_rules
from occ_constraints_pkg.rules.constraints_file import load_constraints
from occ_constraints_pkg.rules.persistent_counts import PersistentCounts, read_counts
from occ_constraints_pkg.terminal import printable

MAP = """\
schema_version: 1
pace: observation
max_age: 0.5
features:
- {name: v_x, topic: odom, field: twist.twist.linear.x, unit: m/s}
- {name: d_front, topic: /scan, field: 'ranges[0:20]', reduce: min, unit: m, bounds: [0, null],
   missing: max_range}
- {name: yaw, topic: odom, field: pose.pose.orientation, transform: yaw, unit: rad}
"""
MANIFEST = """\
schema_version: 1
recordings:
- path: drive_1
  include: [[0, 30.5], [40, null]]
  exclude:
  - [12.0, 13.5]
  episodes: [15, 45.0]
- {path: drive_2.mcap, note: calm}
"""


@cache
def documents() -> tuple[tuple[str, Callable[[Path], object]], ...]:
    """Return the text of each kind of document, and what loads it."""
    rng = np.random.default_rng(0)
    feature_map = FeatureMap.from_document(parse_yaml(MAP, 'map'), 'map')
    values = rng.normal(size=(300, 3)) + [0.0, 4.0, 0.0]
    constraints = learn(
        values,
        np.arange(300) // 30,
        feature_map.space,
        rng=rng,
        feature_map=feature_map.to_document(),
    )

    def load_rules(path: Path) -> None:
        loaded = load_constraints(path)
        text = describe_rules(loaded, counters=True)
        for rule in loaded.rule_set.rules:
            text += describe_why(why_document(loaded, rule.id))
        assert printable(text, keep_lines=True) == text
        loaded.rule_set.judge(values)
        map_of(loaded, str(path))
        dump_yaml(loaded.feature_map)

    def load_map(path: Path) -> None:
        loaded = load_feature_map(path)
        assert FeatureMap.from_document(loaded.to_document(), 'again') == loaded

    def load_list(path: Path) -> None:
        for selection in load_manifest(path):
            assert (selection.stretches(np.arange(5) * 10**10) >= -1).all()

    with tempfile.TemporaryDirectory() as place:
        counts = PersistentCounts(constraints.rule_set, Path(place) / 'counts.json')
        counts.add(constraints.rule_set.judge(values))
        counts.keep()
        counted = (Path(place) / 'counts.json').read_text()
    line = json.dumps({'updates': 1, 'steps': 64, 'mean_return': 1.5, 'mean_cost': None})
    return (
        (MAP, load_map),
        (constraints.dumps(), load_rules),
        (MANIFEST, load_list),
        (counted, lambda path: read_counts(path, constraints.rule_set)),
        (f'{line}\n' * 3, read_metrics),
    )


def call(number: int, path: Path) -> Callable[[], str]:
    """Write the damaged document of a number; return the call that loads it."""
    kinds = documents()
    text, load = kinds[number % len(kinds)]
    text = damaged_text(text, np.random.default_rng(number))
    path.write_bytes(text.encode('utf-8', 'surrogatepass'))

    def run() -> str:
        try:
            load(path)
        except OccError as error:
            if '\n' in str(error) or not str(error):
                raise AssertionError(f'not one sentence: {error}') from error
            return 'refused'
        return 'loaded'

    return run


if __name__ == '__main__':
    with tempfile.TemporaryDirectory() as place:
        file = Path(place) / 'document.yaml'
        watch(lambda number: call(number, file), int(sys.argv[1]), int(sys.argv[2]))
