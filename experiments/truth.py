# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""How well the true cost is recovered from demonstrations, with the learner's defaults.

The true cost of the Safety-Gym tasks is known: a state is costly where it is too near a hazard.
The learner never sees it. Demonstrations are episodes of a world's expert, without the costliest of
them if more than 1 % of the samples are costly: who collects demonstrations leaves out what went
wrong. At the second level, episodes of a driver that ignores hazards are mixed in, the costliest
first, until enough of the samples are costly. The rules are judged on other episodes of that driver
and of one with random actions. The driver that ignores hazards is a scripted one that goes straight
to the goal, or, where there is none, the expert with its hazard lidar covered up.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.features.feature_map import FeatureMap, load_feature_map
from occ_constraints_pkg.learning.learn import learn
from occ_constraints_pkg.learning.scoring import score_flags
from occ_constraints_pkg.learning.settings import OCTreeSettings
from occ_constraints_pkg.rules.ruleset import RuleSet
from occ_constraints_pkg.rules.verdict import Verdict
from occ_constraints_pkg.worlds.registry import WORLDS, make_world

from benchmarks.conditions import machine, versions
from experiments.results import earlier_results, markdown_table, write_results
from experiments.states import drive_states, driver_of, heedless_driver_name
from experiments.truth_picture import draw_truth

LEVELS = {'expert': None, 'mixed': 0.045}
"""Names of the levels, and the share of costly samples that is mixed to."""

MOST_COSTLY = 0.01
"""Largest share of costly samples in the demonstrations of an expert."""

_FEWEST_SAMPLES = 1000
_JUDGED_EPISODES = 200
# Draws share no episode as long as that takes no more than these.
_MOST_EPISODES = 500
_FORMAT = 2


def worlds_with_truth() -> list[str]:
    """Return the worlds with hazards to learn, an expert, and a feature map of their own."""
    return [name for name in WORLDS if name.endswith(('Goal1', 'Push1'))]


def run_truth(
    output: Path,
    *,
    samples: int = 100_000,
    draws: int = 5,
    seed: int = 0,
    names: Sequence[str] = (),
    progress: Callable[[int, int], None] = lambda *_: None,
) -> dict[str, Any]:
    """Run what ``output/truth.json`` lacks yet; write that file, ``truth.md`` and ``truth.png``.

    The files are brought up to date after each world, so a stopped run can be continued, and
    worlds or larger numbers of samples be added.

    Args:
        output: directory of the results.
        samples: largest number of demonstrated samples; the others are powers of ten from 1000.
        draws: demonstrations drawn per line. The largest share no episode if that takes 500 at
            most; else they are drawn from twice as many episodes as one needs.
        seed: of everything random.
        names: the worlds to run; all if empty.
        progress: called with (lines done, lines in all).

    Raises:
        OccError: a name is unknown, a number is too small, or the directory holds results of
            other settings.
    """
    known = worlds_with_truth()
    for name in names:
        if name not in known:
            raise OccError(
                f'there is no world {name!r} with a known truth; allowed are {", ".join(known)}'
            )
    if draws < 2 or samples < _FEWEST_SAMPLES:
        raise OccError(
            f'samples is {samples} and draws is {draws}; allowed are {_FEWEST_SAMPLES} and 2 or '
            'more'
        )
    settings = {'format': _FORMAT, 'draws': draws, 'seed': seed, 'mixed': LEVELS['mixed']}
    lines = earlier_results(output / 'truth.json', settings).get('lines', {})
    sizes = [10**power for power in range(3, 9) if 10**power <= samples]
    worlds = names or known
    done = 0
    for world in worlds:
        todo = [
            (level, size)
            for level in LEVELS
            for size in sizes
            if f'{world}, {level}, {size}' not in lines
        ]
        done += len(LEVELS) * len(sizes) - len(todo)
        episodes = _Episodes(world, max(sizes), draws, seed) if todo else None
        for level, size in todo:
            # Not hash(): that differs from process to process.
            rng = np.random.default_rng([seed, size, *f'{world} {level}'.encode()])
            lines[f'{world}, {level}, {size}'] = episodes.line(level, size, draws, rng)
            done += 1
            progress(done, len(worlds) * len(LEVELS) * len(sizes))
        result = {
            'settings': settings,
            'lines': lines,
            'machine': machine(),
            'versions': versions(('numpy', 'scipy', 'mujoco')),
        }
        write_results(output, 'truth', result, markdown(lines))
        draw_truth(output / 'truth.png', lines)
    return result


class _Episodes:
    """Episodes in one world, to learn from and to judge on."""

    def __init__(self, world: str, samples: int, draws: int, seed: int) -> None:
        self.world = world
        self.map: FeatureMap = load_feature_map(world)
        self.ignoring_name = heedless_driver_name(world)
        steps = make_world(world, 1).max_episode_steps + 1
        needed = -(-samples // steps)
        episodes = max(2 * needed, min(draws * needed, _MOST_EPISODES))
        rng = np.random.default_rng([seed, *world.encode()])

        def drive(name: str, count: int, number: int) -> tuple[np.ndarray, np.ndarray]:
            driver = driver_of(make_world(world, 1), name, rng)
            return drive_states(world, driver, self.map, count, 10_000 * number + seed)

        self.expert = without_costliest(*drive('expert', episodes, 1))
        self.ignoring = drive(self.ignoring_name, max(needed, _JUDGED_EPISODES), 2)
        self.unseen = drive('expert', _JUDGED_EPISODES, 3)
        self.judged = {
            name: drive(name, _JUDGED_EPISODES, 4 + number)
            for number, name in enumerate((self.ignoring_name, 'random'))
        }

    def line(
        self, level: str, samples: int, draws: int, rng: np.random.Generator
    ) -> dict[str, Any]:
        """Learn and judge ``draws`` times; return means and standard deviations."""
        order = rng.permutation(len(self.expert[0]))
        count = max(1, samples // self.expert[0].shape[1])
        found = [
            self._once(level, order.take(np.arange(count) + number * count, mode='wrap'), rng)
            for number in range(draws)
        ]
        table = np.array([list(item.values()) for item in found], dtype=np.float64)
        summary = {
            name: {'mean': _rounded(mean), 'std': _rounded(deviation)}
            for name, mean, deviation in zip(
                found[0], table.mean(axis=0), table.std(axis=0, ddof=1), strict=True
            )
        }
        return {
            'world': self.world,
            'level': level,
            'samples': samples,
            'heedless_driver': self.ignoring_name,
            **summary,
        }

    def _once(self, level: str, drawn: np.ndarray, rng: np.random.Generator) -> dict[str, float]:
        values, costly, episodes = self._demonstrations(LEVELS[level], drawn, rng)
        rule_set = learn(
            values, episodes, self.map.space, OCTreeSettings(), rng=rng, held_out_share=0.0
        ).rule_set
        flagged = _flags(rule_set, values)
        safe = ~self.unseen[1].any(axis=1)
        row = {
            'costly_share': float(costly.mean()),
            'flagged_share': float(flagged.mean()),
            'coverage': float(1.0 - _flags(rule_set, self.unseen[0][safe]).mean())
            if safe.any()
            else float('nan'),
        }
        for place, (states, truth) in zip(('', 'random_'), self.judged.values(), strict=True):
            score = score_flags(_flags(rule_set, states), truth.ravel())
            row |= {f'{place}{name}': value for name, value in score.ratios().items()}
        return row

    def _demonstrations(
        self, share: float | None, drawn: np.ndarray, rng: np.random.Generator
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return (n, k) states, (n,) whether they are costly, and (n,) the episode of each.

        There are as many episodes as drawn.
        """
        values, costly = self.expert
        count = len(drawn)
        parts = [(values[drawn], costly[drawn])]
        if share is not None:
            other, other_costly = self.ignoring
            # Which episodes there are is random; of these the costliest come first.
            chosen = rng.permutation(len(other))[: max(1, min(len(other), 2 * count))]
            chosen = chosen[np.argsort(-other_costly[chosen].mean(axis=1), kind='stable')]
            for number in range(1, len(chosen) + 1):
                picked = chosen[:number]
                kept = drawn[: max(0, count - number)]
                parts = [(values[kept], costly[kept]), (other[picked], other_costly[picked])]
                reached = np.concatenate([part.ravel() for _, part in parts]).mean()
                following = chosen[min(number, len(chosen) - 1)]
                if reached >= share or number >= count or other_costly[following].mean() < share:
                    break
        states = np.concatenate([part for part, _ in parts]).astype(np.float64)
        return (
            states.reshape(-1, states.shape[-1]),
            np.concatenate([part.ravel() for _, part in parts]),
            np.repeat(np.arange(len(states)), states.shape[1]),
        )


def without_costliest(values: np.ndarray, costly: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the episodes in their order, without the costliest while too much is costly in all."""
    shares = costly.mean(axis=1)
    ascending = np.argsort(shares, kind='stable')
    means = np.cumsum(shares[ascending]) / np.arange(1, len(shares) + 1)
    kept = np.sort(ascending[means <= MOST_COSTLY])
    if not len(kept):
        raise OccError(
            f'in the best episode {shares.min():.1%} of the samples are costly; '
            f'allowed are {MOST_COSTLY:.0%}'
        )
    return values[kept], costly[kept]


def _flags(rule_set: RuleSet, states: np.ndarray) -> np.ndarray:
    """Return for states of shape (..., k) whether they are not SAFE, flat."""
    rows = states.reshape(-1, states.shape[-1]).astype(np.float64)
    return rule_set.judge(rows).verdict != Verdict.SAFE


def _rounded(value: float) -> float | None:
    return round(float(value), 4) if np.isfinite(value) else None


def markdown(lines: Mapping[str, Mapping[str, Any]]) -> str:
    """Return the lines as a Markdown table, mean ± standard deviation in each place."""
    heads = {
        'costly_share': 'costly',
        'flagged_share': 'flagged',
        'coverage': 'coverage',
        'precision': 'precision',
        'recall': 'recall',
        'f1': 'F1',
        'random_f1': 'F1 on random',
    }
    rows = [
        [
            line['world'],
            line['level'],
            line['samples'],
            *(_spread(line.get(name)) for name in heads),
        ]
        for line in lines.values()
    ]
    return markdown_table(['world', 'level', 'samples', *heads.values()], rows) + '\n'


def _spread(value: Mapping[str, float | None] | None) -> str:
    if value is None or value['mean'] is None:
        return '-'
    return f'{value["mean"]:.3f} ± {value["std"]:.3f}'
