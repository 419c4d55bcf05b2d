# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Rules learned from real drivers on two highways, evaluated on drivers held back.

- US-101: the vehicles of CommonRoad's scenarios made from NGSIM, with the ten features of the map
  ``highway``.
- I-80: the vehicles of a traffic history in which all begin at one moment, many at one place; gaps
  between them mean nothing, so the map is ``highway_road``, of four features.

A vehicle that is in several scenarios counts once. For each seed, a fifth of the vehicles is
held back, rules are learned from the others, and the share of the held-back time that is not SAFE
is measured: rows are 0.1 s each. Nobody crashes, so all of it is safe. Each
scenario is held back as a whole, too, which asks whether the rules hold at another time of day.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.features.feature_map import FeatureMap, load_feature_map
from occ_constraints_pkg.learning.learn import is_safe, learn
from occ_constraints_pkg.learning.settings import OCTreeSettings
from occ_constraints_pkg.rules.ruleset import RuleSet
from occ_constraints_pkg.traffic.convert import read_trajectories
from occ_constraints_pkg.traffic.rules_text import rule_rows, rules_table

from experiments.results import data_folder, markdown_table, write_results

CONTAMINATION = 0.01
# Without splits, which is the default, and as the tree's article advises.
ALPHAS = (0.0, 0.5)
TOLERATED = 0.05
_HELD_BACK = 0.2


@dataclass(frozen=True)
class Highway:
    """Where recordings of one highway are, and what can be learned from them."""

    name: str
    format: str
    pattern: str
    map: str


HIGHWAYS = (
    Highway('US-101', 'commonroad', 'ngsim_us101/*.xml', 'highway'),
    # The smaller file beside it holds some of the same vehicles.
    Highway('I-80', 'ngsim-sqlite', 'ngsim_i80/200_actors_*.shf', 'highway_road'),
)


@dataclass(frozen=True, eq=False)
class _Drivers:
    """Rows of features, and which vehicle and which recording each is of."""

    values: np.ndarray
    vehicle: np.ndarray
    recording: np.ndarray
    recordings: tuple[str, ...]
    repeated: int


def run_ngsim(
    output: Path,
    *,
    folder: Path | None = None,
    seeds: int = 10,
    progress: Callable[[int, int], None] = lambda *_: None,
) -> dict[str, Any]:
    """Run the experiment and write ``ngsim.json`` and ``ngsim.md``.

    Args:
        output: directory for the files; made if needed.
        folder: where ``ngsim_us101`` and ``ngsim_i80`` are; default: ``driving``, see
            :func:`.data_folder`.
        seeds: number of random splits.
        progress: called with (trees learned, trees in all).

    Raises:
        OccError: there are no recordings, or one cannot be read.
    """
    folder = folder or data_folder('driving')
    drivers = {highway.name: _read(folder, highway) for highway in HIGHWAYS}
    total = sum(len(ALPHAS) * seeds + len(_held(item)) + 1 for item in drivers.values())
    done = 0

    def counted(*_: Any) -> None:
        nonlocal done
        done += 1
        progress(done, total)

    result = {
        'contamination': CONTAMINATION,
        'held_back': _HELD_BACK,
        'highways': {
            highway.name: _run(drivers[highway.name], highway, seeds, counted)
            for highway in HIGHWAYS
        },
    }
    write_results(output, 'ngsim', result, markdown(result))
    return result


def _read(folder: Path, highway: Highway) -> _Drivers:
    files = sorted(folder.glob(highway.pattern))
    if not files:
        raise OccError(f'there is no {folder / highway.pattern}; allowed are one or more files')
    seen: set[tuple[str, int]] = set()
    blocks, vehicles, places, repeated = [], [], [], 0
    for place, file in enumerate(files):
        drives = read_trajectories(highway.format, file)
        # USA_US101-1_1_T-1 and USA_US101-1_2_T-1 show the same traffic to different planners.
        traffic = file.stem.rsplit('_', 2)[0]
        for rows in np.split(np.arange(len(drives.time)), drives.beginnings[1:]):
            person = (traffic, int(drives.vehicle[rows[0]]))
            if person in seen:
                repeated += 1
                continue
            blocks.append(drives.values[rows])
            vehicles.append(np.full(len(rows), len(seen)))
            places.append(np.full(len(rows), place))
            seen.add(person)
    return _Drivers(
        np.concatenate(blocks),
        np.concatenate(vehicles),
        np.concatenate(places),
        tuple(file.stem for file in files),
        repeated,
    )


def _run(
    drivers: _Drivers, highway: Highway, seeds: int, counted: Callable[..., None]
) -> dict[str, Any]:
    feature_map = load_feature_map(highway.map)
    splits = {
        f'alpha {alpha:g}': _splits(drivers, feature_map, alpha, seeds, counted) for alpha in ALPHAS
    }
    by_recording = []
    for place in _held(drivers):
        held = drivers.recording == place
        rules = _learn(drivers, feature_map, ~held, 0.0, counted)
        found = {'recording': drivers.recordings[place], 'rows': int(held.sum())}
        by_recording.append({**found, **_judge(drivers, rules, held)})
    everyone = np.ones(len(drivers.values), dtype=bool)
    rules = _learn(drivers, feature_map, everyone, 0.0, counted)
    ordered = sorted(rules.rules, key=lambda rule: len(rule.literals))
    return {
        'map': highway.map,
        'vehicles': int(drivers.vehicle.max()) + 1,
        'repeated_vehicles': drivers.repeated,
        'rows': len(drivers.values),
        'splits': splits,
        'by_recording': by_recording,
        'rules': rule_rows(ordered, feature_map.space),
        'table': rules_table(ordered, feature_map.space),
    }


def _held(drivers: _Drivers) -> list[int]:
    """Return the places of the recordings to hold back as a whole: none if there is but one."""
    places = np.unique(drivers.recording).tolist()
    return places if len(places) > 1 else []


def _splits(
    drivers: _Drivers,
    feature_map: FeatureMap,
    alpha: float,
    seeds: int,
    counted: Callable[..., None],
) -> dict[str, Any]:
    """Hold back a fifth of the vehicles, once for each seed."""
    vehicles = int(drivers.vehicle.max()) + 1
    found = []
    for seed in range(seeds):
        chosen = np.random.default_rng(seed).permutation(vehicles)
        held = np.isin(drivers.vehicle, chosen[: round(_HELD_BACK * vehicles)])
        rules = _learn(drivers, feature_map, ~held, alpha, counted)
        found.append({'seed': seed, 'rules': len(rules.rules), **_judge(drivers, rules, held)})
    flagged = [item['flagged'] for item in found]
    return {
        'mean': _rounded(np.mean(flagged)),
        'std': _rounded(np.std(flagged, ddof=1)) if seeds > 1 else None,
        'largest': _rounded(np.max(flagged)),
        'splits': found,
    }


def _learn(
    drivers: _Drivers,
    feature_map: FeatureMap,
    rows: np.ndarray,
    alpha: float,
    counted: Callable[..., None],
) -> RuleSet:
    constraints = learn(
        drivers.values[rows],
        drivers.vehicle[rows],
        feature_map.space,
        OCTreeSettings(contamination=CONTAMINATION if alpha else None, alpha=alpha),
        rng=np.random.default_rng(0),
        # Vehicles of one recording meet the same traffic.
        independent=drivers.recording[rows] if len(_held(drivers)) else drivers.vehicle[rows],
        held_out_share=0.0,
        feature_map=feature_map.to_document(),
    )
    counted()
    return constraints.rule_set


def _judge(drivers: _Drivers, rules: RuleSet, held: np.ndarray) -> dict[str, Any]:
    """Return the share of time that is flagged, and that of the vehicle with most of it."""
    flagged = ~is_safe(rules, drivers.values[held])
    counts = np.bincount(drivers.vehicle[held], weights=flagged)
    return {
        'flagged': _rounded(flagged.mean()),
        'of_one_vehicle': _rounded(counts.max() / max(flagged.sum(), 1)),
    }


def _rounded(value: Any) -> float:
    return round(float(value), 4)


def markdown(result: Mapping[str, Any]) -> str:
    """Return the result as a page."""
    lines = [
        '# Rules of real drivers, tried on drivers held back',
        '',
        'Written by `python -m experiments ngsim`. '
        f'{result["held_back"]:.0%} of the vehicles are held back in each split. '
        f'Defaults with alpha 0; contamination {result["contamination"]:g} with others.',
    ]
    for name, found in result['highways'].items():
        lines += ['', f'## {name}', '', *_highway(found)]
    return '\n'.join(lines) + '\n'


def _highway(found: Mapping[str, Any]) -> Iterator[str]:
    again = found['repeated_vehicles']
    yield (
        f'{found["vehicles"]} vehicles, {found["rows"]} rows of 0.1 s, feature map '
        f'`{found["map"]}`'
        + (f'; {again} vehicles that stood there twice count once.' if again else '.')
    )
    yield ''
    rows = []
    for alpha, part in found['splits'].items():
        spread = '' if part['std'] is None else f' ± {part["std"]:.2%}'
        rules = _range([split['rules'] for split in part['splits']])
        rows.append((alpha, f'{part["mean"]:.2%}{spread}', f'{part["largest"]:.2%}', rules))
    heads = ('splits of the tree', 'flagged of the held-back time', 'largest of the splits')
    yield markdown_table((*heads, 'rules'), rows)
    if found['by_recording']:
        yield ''
        yield markdown_table(
            ('recording held back as a whole', 'rows', 'flagged', 'of that, by one vehicle'),
            [
                (
                    item['recording'],
                    item['rows'],
                    f'{item["flagged"]:.2%}',
                    f'{item["of_one_vehicle"]:.0%}' if item['flagged'] else '-',
                )
                for item in found['by_recording']
            ],
        )
    yield ''
    yield 'Rules from all vehicles; each describes a violation:'
    yield ''
    yield found['table']


def _range(numbers: Sequence[int]) -> str:
    low, high = min(numbers), max(numbers)
    return str(low) if low == high else f'{low} to {high}'
