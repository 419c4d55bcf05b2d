# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""What costly demonstrations do to the rules that are learned from them.

Demonstrations are episodes of a world's expert, made worse in one of three ways:

- ``samples``: costly states of a driver that ignores hazards take the place of single samples;
- ``stretches``: whole passes of that driver through a hazard take the place of samples;
- ``episodes``: its costliest episodes take the place of whole episodes.

The rules are judged by the true cost on other episodes of that driver.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from occ_constraints_pkg.agents.drivers import DRIVERS, find_driver
from occ_constraints_pkg.errors import ConfigurationError
from occ_constraints_pkg.features.feature_map import load_feature_map
from occ_constraints_pkg.learning.learn import learn
from occ_constraints_pkg.learning.scoring import score_flags
from occ_constraints_pkg.learning.settings import OCTreeSettings
from occ_constraints_pkg.rules.verdict import Verdict
from occ_constraints_pkg.worlds.registry import make_world

from benchmarks.conditions import machine, versions
from experiments.results import earlier_results, markdown_table, write_results
from experiments.states import drive_states
from experiments.truth import without_costliest

WORLDS = ('PointGoal1', 'CarGoal1')
"""Worlds with hazards, an expert and a driver that ignores hazards."""

SEEDS = (1, 2, 3, 4, 5)
"""Seeds that results are reported on; nothing was tuned on them."""

KINDS = ('samples', 'stretches', 'episodes')
"""How demonstrations are made worse."""

SHARES = (0.0, 0.01, 0.05, 0.1)
"""Shares of costly samples that are aimed at."""

# Shares that are stated for bad episodes, as multiples of the true one.
_STATED = (0.2, 0.5, 1.0, 1.5)
_UNSTATED = 'none'
# Episodes of the expert besides those that are learned from, and of the other driver.
_MORE, _IGNORING = 40, 80
_FORMAT = 1


def run_contamination(
    output: Path,
    *,
    names: Sequence[str] = (),
    demonstrations: int = 20,
    seeds: Sequence[int] = SEEDS,
    progress: Callable[[int, int], None] = lambda *_: None,
) -> dict[str, Any]:
    """Run what ``output/contamination.json`` lacks yet; write that file and ``contamination.md``.

    Args:
        output: directory of the results.
        names: the worlds to run; all if empty.
        demonstrations: episodes to learn from.
        seeds: of the demonstrations, one line each.
        progress: called with (lines done, lines in all).

    Raises:
        ConfigurationError: a world is not known.
    """
    for name in names:
        if name not in WORLDS:
            raise ConfigurationError(
                f'there is no contamination in {name!r}; allowed are {", ".join(WORLDS)}'
            )
    settings = {'format': _FORMAT, 'demonstrations': demonstrations}
    lines = earlier_results(output / 'contamination.json', settings).get('lines', {})
    wanted = [
        (world, kind, share, seed)
        for world in names or WORLDS
        for kind in KINDS
        for share in SHARES
        for seed in seeds
        # Without any costly sample, all kinds are the same.
        if share or kind == KINDS[0]
    ]
    result: dict[str, Any] = {}
    drives: _Drives | None = None
    for done, task in enumerate(wanted):
        world, key = task[0], ', '.join(map(str, task))
        if key not in lines:
            if drives is None or drives.world != world:
                drives = _Drives(world, demonstrations)
            lines[key] = drives.line(*task[1:])
        result = {
            'settings': settings,
            'lines': lines,
            'machine': machine(),
            'versions': versions(('numpy', 'scipy', 'mujoco')),
        }
        write_results(output, 'contamination', result, markdown(lines))
        progress(done + 1, len(wanted))
    return result


class _Drives:
    """Episodes in one world, to learn from and to judge on."""

    def __init__(self, world: str, demonstrations: int) -> None:
        self.world = world
        self.demonstrations = demonstrations
        feature_map = load_feature_map(world)
        self.space = feature_map.space
        rng = np.random.default_rng([2, *world.encode()])
        ignoring = next(name for name in ('straightv', 'straight') if name in DRIVERS[world])

        def drive(name: str, count: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
            driver = find_driver(make_world(world, 1), name, rng, explore=True)
            return drive_states(world, driver, feature_map, count, seed)

        self.expert = without_costliest(*drive('expert', demonstrations + _MORE, 51_000))
        self.ignoring = drive(ignoring, _IGNORING, 52_000)
        self.judged = drive(ignoring, _IGNORING, 53_000)

    def line(self, kind: str, share: float, seed: int) -> dict[str, Any]:
        """Learn from one set of demonstrations, with no share stated and with several."""
        rng = np.random.default_rng([seed, *f'{self.world} {kind} {share}'.encode()])
        values, costly = self._worsened(kind, share, rng)
        count, steps = costly.shape
        true = float(costly.mean())
        found = {}
        stated_shares: dict[str, float | None] = {_UNSTATED: None}
        if kind == 'episodes':
            stated_shares |= {f'{multiple:g}': round(multiple * true, 4) for multiple in _STATED}
        for name, stated in stated_shares.items():
            rule_set = learn(
                values.reshape(count * steps, -1).astype(np.float64),
                np.repeat(np.arange(count), steps),
                self.space,
                OCTreeSettings(contamination=stated),
                rng=np.random.default_rng(seed),
            ).rule_set
            rows = self.judged[0].reshape(-1, values.shape[-1]).astype(np.float64)
            score = score_flags(
                rule_set.judge(rows).verdict != Verdict.SAFE, self.judged[1].ravel()
            ).ratios()
            # Without a false alarm and without a hit there is no precision.
            found[name] = {
                ratio: round(score[ratio], 4) if np.isfinite(score[ratio]) else 0.0
                for ratio in ('precision', 'recall', 'f1')
            }
        return {
            'world': self.world,
            'kind': kind if share else 'expert',
            'share': share,
            'seed': seed,
            'costly': round(true, 4),
            'stated': found,
        }

    def _worsened(
        self, kind: str, share: float, rng: np.random.Generator
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return (episodes, steps, k) states and whether they are costly."""
        drawn = rng.permutation(len(self.expert[0]))[: self.demonstrations]
        values, costly = (part[drawn].copy() for part in self.expert)
        wanted = max(0, int(share * costly.size) - int(costly.sum()))
        other, other_costly = self.ignoring
        if kind == 'samples':
            places = rng.choice(np.flatnonzero(~costly), size=wanted, replace=False)
            bad = other[other_costly]
            values.reshape(costly.size, -1)[places] = bad[rng.integers(len(bad), size=wanted)]
            costly.reshape(-1)[places] = True
        elif kind == 'stretches':
            passes = _passes(other_costly)
            while wanted > 0:
                episode, start, end = passes[rng.integers(len(passes))]
                length = min(end - start, wanted)
                place = rng.integers(len(values)), rng.integers(values.shape[1] - length + 1)
                there = slice(place[1], place[1] + length)
                wanted -= length - int(costly[place[0], there].sum())
                values[place[0], there] = other[episode, start : start + length]
                costly[place[0], there] = True
        elif share:
            # Which there are is random; of these, the costliest come first.
            chosen = rng.permutation(len(other))[: 2 * len(values)]
            chosen = chosen[np.argsort(-other_costly[chosen].mean(axis=1), kind='stable')]
            for number, episode in enumerate(chosen[: len(values)]):
                if costly.mean() >= share:
                    break
                values[number], costly[number] = other[episode], other_costly[episode]
        return values, costly


def _passes(costly: np.ndarray) -> list[tuple[int, int, int]]:
    """Return (episode, first step, step after the last) of each run of costly states."""
    padded = np.pad(costly, ((0, 0), (1, 1))).astype(np.int8)
    steps = np.diff(padded, axis=1)
    starts, ends = np.argwhere(steps == 1), np.argwhere(steps == -1)
    return [
        (int(episode), int(start), int(end))
        for (episode, start), (_, end) in zip(starts, ends, strict=True)
    ]


def markdown(lines: dict[str, dict[str, Any]]) -> str:
    """Return means over seeds as a Markdown table."""
    groups: dict[tuple[str, str, float], list[dict[str, Any]]] = {}
    for line in lines.values():
        groups.setdefault((line['world'], line['kind'], line['share']), []).append(line)
    heads = ['world', 'costly', 'seeds', 'share of them', 'precision', 'recall', 'F1', 'least F1']
    heads += [f'F1, {multiple:g} times stated' for multiple in _STATED]
    rows = []
    for (world, kind, _), found in groups.items():
        unstated = [line['stated'][_UNSTATED] for line in found]
        rows.append(
            [
                world,
                kind,
                len(found),
                f'{np.mean([line["costly"] for line in found]):.1%}',
                *(
                    f'{np.mean([item[name] for item in unstated]):.3f}'
                    for name in ('precision', 'recall', 'f1')
                ),
                f'{min(item["f1"] for item in unstated):.3f}',
                *(
                    '-'
                    if kind != 'episodes'
                    else f'{np.mean([line["stated"][f"{multiple:g}"]["f1"] for line in found]):.3f}'
                    for multiple in _STATED
                ),
            ]
        )
    return markdown_table(heads, rows) + '\n'
