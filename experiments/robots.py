# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Rules learned from recordings of real and simulated robots, tried on recordings held back.

The recordings are named after what happens in them: ``safe_KIND_...``, ``contact_KIND_...`` and
``bump_KIND_...``. For each kind of robot:

- The feature map is the one that is suggested for the first safe recording, as it is.
- Each safe recording is held back in turn; rules learned from the others judge it.
- Rules learned from all safe recordings judge those with contact, and those in which the bumper
  fired, once with the bumper among the features and once without.

What is flagged is everything but SAFE. A recording counts as leaving the demonstrated range when
more than 5 % of its time is flagged, and most of that has a value beyond all that the others
showed.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from occ_constraints_pkg.datasets.dataset import Dataset
from occ_constraints_pkg.datasets.extraction import extract
from occ_constraints_pkg.documents import parse_yaml
from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.features.feature_map import FeatureMap
from occ_constraints_pkg.files import FEATURE_MAP, make_directory, write_text
from occ_constraints_pkg.learning.learn import learn
from occ_constraints_pkg.learning.settings import OCTreeSettings
from occ_constraints_pkg.rosbag.recording import Recording
from occ_constraints_pkg.rules.constraints_file import Constraints
from occ_constraints_pkg.rules.verdict import Judgement, Verdict
from occ_constraints_pkg.suggestion.suggest import suggest
from occ_constraints_pkg.suggestion.text import suggestion_text

from experiments.results import data_folder, markdown_table, write_results

KINDS = ('tb3', 'neato')
# Share of the safe samples that may lie outside.
_CONTAMINATION = 0.01
# A recording that is flagged for more of its time is looked at: does it leave the range?
_TOLERATED = 0.05
_MOST_RULES = 3
_BUMPER = 'bump'


@dataclass(frozen=True)
class Recorded:
    """One recording's features.

    Attributes:
        name: of the recording.
        data: its features.
        seconds: (n,) how long each row is valid.
    """

    name: str
    data: Dataset
    seconds: np.ndarray


def run_robots(
    output: Path,
    *,
    folder: Path | None = None,
    kinds: Sequence[str] = (),
    progress: Callable[[int, int], None] = lambda *_: None,
) -> dict[str, Any]:
    """Run the experiment and write ``robots.json``, ``robots.md`` and the maps.

    Args:
        output: directory for the files; made if needed.
        folder: where the recordings are; default: ``robots``, see :func:`.data_folder`.
        kinds: of robots; empty for all of :data:`KINDS`.
        progress: called with (kinds done, kinds in all).

    Raises:
        OccError: there are fewer than three safe recordings of a kind, or one cannot be read.
    """
    folder = folder or data_folder('robots')
    chosen = tuple(kinds) or KINDS
    make_directory(output)
    result: dict[str, Any] = {'contamination': _CONTAMINATION, 'kinds': {}}
    for done, kind in enumerate(chosen):
        progress(done, len(chosen))
        result['kinds'][kind], text = _run_kind(folder, kind)
        write_text(output / f'robots_{kind}.yaml', FEATURE_MAP, text)
    write_results(output, 'robots', result, _markdown(result))
    return result


def _run_kind(folder: Path, kind: str) -> tuple[dict[str, Any], str]:
    """Return the results for one kind of robot, and its map as text."""
    paths = safe_recordings(folder, kind)
    full_map, text = suggested_map(paths[0], kind)
    safe = [read_recorded(path, full_map) for path in paths]
    contact = [read_recorded(path, full_map) for path in sorted(folder.glob(f'contact_{kind}_*'))]
    bump = [read_recorded(path, full_map) for path in sorted(folder.glob(f'bump_{kind}_*'))]
    bumper = [place for place, name in enumerate(full_map.names) if name.startswith(_BUMPER)]
    variants = {'all features': list(range(len(full_map.names)))}
    if bumper:
        rest = [place for place in variants['all features'] if place not in bumper]
        variants['without the bumper'] = rest
    result: dict[str, Any] = {'map_from': paths[0].name, 'features': list(full_map.names)}
    for title, places in variants.items():
        part = replace(full_map, features=tuple(full_map.features[place] for place in places))
        result[title] = {
            'held_back': [_held_back(item, safe, part, places) for item in safe],
            'contact': [_tried(item, learn_safe(safe, part, places), places) for item in contact],
            'bump': [
                _bumped(item, learn_safe(safe, part, places), places, bumper) for item in bump
            ],
        }
    return result, text


def safe_recordings(folder: Path, kind: str) -> list[Path]:
    """Return the safe recordings of a kind of robot.

    Raises:
        OccError: there are fewer than three.
    """
    paths = sorted(folder.glob(f'safe_{kind}_*'))
    if len(paths) < 3:
        raise OccError(
            f'{folder} holds {len(paths)} recordings safe_{kind}_*; allowed are three or more'
        )
    return paths


def other_recordings(folder: Path, kind: str) -> list[Path]:
    """Return the recordings of a kind of robot with contact, or in which the bumper fired."""
    return sorted([*folder.glob(f'bump_{kind}_*'), *folder.glob(f'contact_{kind}_*')])


def suggested_map(path: Path, kind: str) -> tuple[FeatureMap, str]:
    """Return the map that is suggested for a recording, and its text."""
    text = suggestion_text(suggest(Recording(path)))
    return FeatureMap.from_document(parse_yaml(text, kind), kind), text


def read_recorded(path: Path, feature_map: FeatureMap) -> Recorded:
    """Return a recording's features.

    Raises:
        OccError: it cannot be read.
    """
    data = extract([path], feature_map)
    steps = np.diff(data.stamps_ns) * 1e-9
    usual = float(np.median(steps)) if len(steps) else 1.0
    # A row is valid until the next one comes; not over a gap or a clock that was set back.
    steps = np.where((steps > 0) & (steps < 10 * usual), steps, usual)
    return Recorded(path.name, data, np.append(steps, usual))


def learn_safe(items: Sequence[Recorded], part: FeatureMap, places: list[int]) -> Constraints:
    """Learn rules from safe recordings.

    Args:
        items: the recordings.
        part: the map of the features to use.
        places: where these stand in the recordings.
    """
    values = np.concatenate([item.data.values[:, places] for item in items])
    episodes = np.repeat(np.arange(len(items)), [len(item.data) for item in items])
    return learn(
        values,
        episodes,
        part.space,
        OCTreeSettings(contamination=_CONTAMINATION),
        rng=np.random.default_rng(0),
        held_out_share=0.0,
        feature_map=part.to_document(),
    )


def _tried(item: Recorded, constraints: Constraints, places: list[int]) -> dict[str, Any]:
    """Judge a recording; return shares of time and the rules that took most of it."""
    judgement = constraints.rule_set.judge(item.data.values[:, places])
    total = item.seconds.sum()
    rules = [
        {
            'rule': rule.words(constraints.rule_set.space),
            'share': _share(item.seconds[judgement.rule == place].sum(), total),
        }
        for place, rule in enumerate(constraints.rule_set.rules)
        if (judgement.rule == place).any()
    ]
    rules.sort(key=lambda entry: -entry['share'])
    return {
        'bag': item.name,
        'seconds': round(float(total), 2),
        'flagged': _share(item.seconds[judgement.verdict != Verdict.SAFE].sum(), total),
        'unknown': _share(item.seconds[judgement.verdict == Verdict.UNKNOWN].sum(), total),
        'rules': rules,
    }


def _held_back(
    item: Recorded, safe: Sequence[Recorded], part: FeatureMap, places: list[int]
) -> dict[str, Any]:
    """Judge a safe recording by rules learned from the others."""
    constraints = learn_safe([other for other in safe if other is not item], part, places)
    result = _tried(item, constraints, places)
    lows, highs = constraints.rule_set.demonstrated.T
    values = item.data.values[:, places]
    beyond = ((values < lows) | (values > highs)).any(axis=1)
    share = _share(item.seconds[beyond].sum(), item.seconds.sum())
    flagged = result['flagged']
    return {**result, 'beyond': share, 'leaves': flagged > _TOLERATED and 2 * share > flagged}


def _bumped(
    item: Recorded, constraints: Constraints, places: list[int], bumper: list[int]
) -> dict[str, Any]:
    """Judge a recording in which the bumper fired, and each interval in which it did."""
    judgement = constraints.rule_set.judge(item.data.values[:, places])
    fired = (item.data.values[:, bumper] > 0.0).any(axis=1)
    edges = np.flatnonzero(np.diff(np.concatenate(([0], fired, [0]))))
    intervals = [
        _interval(item, constraints, judgement, slice(start, end))
        for start, end in zip(edges[::2], edges[1::2], strict=True)
    ]
    return {**_tried(item, constraints, places), 'intervals': intervals}


def _interval(
    item: Recorded, constraints: Constraints, judgement: Judgement, rows: slice
) -> dict[str, Any]:
    seconds = (item.data.stamps_ns[rows] - item.data.stamps_ns[0]) * 1e-9
    first = judgement.rule[rows][judgement.rule[rows] >= 0][:1]
    rule = constraints.rule_set.rules[first[0]] if len(first) else None
    return {
        'from_s': round(float(seconds[0]), 2),
        'to_s': round(float(seconds[-1]), 2),
        'flagged': _share(np.sum(judgement.verdict[rows] != Verdict.SAFE), len(seconds)),
        'first_rule': rule.words(constraints.rule_set.space) if rule else None,
    }


def _share(part: float, total: float) -> float:
    return round(float(part / total), 4)


def _overall(bags: Sequence[Mapping[str, Any]]) -> float:
    seconds = sum(bag['seconds'] for bag in bags)
    return sum(bag['flagged'] * bag['seconds'] for bag in bags) / seconds if seconds else 0.0


def _markdown(result: Mapping[str, Any]) -> str:
    lines = [
        '# Rules of robots, tried on recordings held back',
        '',
        'Written by `python -m experiments robots`. Contamination '
        f'{result["contamination"]:g}; the maps beside this page are as suggested.',
    ]
    for kind, found in result['kinds'].items():
        lines += ['', f'## {kind}', '', f'Map suggested from `{found["map_from"]}`.']
        for title, part in found.items():
            if isinstance(part, dict):
                lines += ['', f'### {kind}, {title}', *_tables(part)]
    return '\n'.join(lines) + '\n'


def _tables(part: Mapping[str, Any]) -> list[str]:
    held = part['held_back']
    staying = [bag for bag in held if not bag['leaves']]
    lines = [
        '',
        markdown_table(
            ('safe recording, held back', 'flagged time', 'beyond the others', 'first rules'),
            [
                (
                    bag['bag'] + (' (leaves the range)' if bag['leaves'] else ''),
                    f'{bag["flagged"]:.1%}',
                    f'{bag["beyond"]:.1%}',
                    _rules(bag),
                )
                for bag in held
            ],
        ),
        '',
        f'Flagged in all: {_overall(held):.1%} of the time; without those that leave the range: '
        f'{_overall(staying):.1%} of {len(staying)} recordings.',
    ]
    if part['contact']:
        rows = [(bag['bag'], f'{bag["flagged"]:.1%}', _rules(bag)) for bag in part['contact']]
        lines += ['', markdown_table(('with contact', 'flagged time', 'first rules'), rows)]
    if part['bump']:
        rows = [
            (
                bag['bag'],
                f'{item["from_s"]:g} to {item["to_s"]:g} s',
                f'{item["flagged"]:.0%}',
                item['first_rule'] or 'none',
            )
            for bag in part['bump']
            for item in bag['intervals']
        ]
        heads = ('bumper fired', 'interval', 'flagged rows of it', 'first rule')
        lines += ['', markdown_table(heads, rows)]
    return lines


def _rules(bag: Mapping[str, Any]) -> str:
    texts = [f'{item["rule"]} ({item["share"]:.1%})' for item in bag['rules'][:_MOST_RULES]]
    if bag['unknown']:
        texts.append(f'UNKNOWN ({bag["unknown"]:.1%})')
    return ', '.join(texts) or 'none'
