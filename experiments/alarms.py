# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Whether the false-alarm guarantee holds: rules of an expert on fresh episodes of that expert."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from occ_constraints_pkg.agents.drivers import find_driver
from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.features.feature_map import FeatureMap, load_feature_map
from occ_constraints_pkg.learning.learn import is_safe, learn
from occ_constraints_pkg.learning.scoring import score_flags
from occ_constraints_pkg.worlds.registry import make_world

from benchmarks.conditions import machine, versions
from experiments.results import markdown_table, write_results
from experiments.states import drive_states
from experiments.truth import worlds_with_truth

GUARANTEES = (0.2, 0.1, 0.05)
"""Probabilities of a false alarm that are guaranteed; beside them, no guarantee at all."""

_JUDGED_EPISODES = 50


@dataclass(frozen=True)
class AlarmSettings:
    """What is drawn.

    Attributes:
        world: a world whose true cost is known.
        demonstrations: episodes to learn from, those held out included.
        episodes: of the expert, in all.
        draws: how often they are divided anew.
        seed: of everything random.
    """

    world: str = 'PointGoal1'
    demonstrations: int = 50
    episodes: int = 400
    draws: int = 100
    seed: int = 0

    def __post_init__(self) -> None:
        allowed = worlds_with_truth()
        if self.world not in allowed:
            raise OccError(
                f'there is no world {self.world!r} with a known truth; allowed are '
                f'{", ".join(allowed)}'
            )
        if self.demonstrations >= self.episodes:
            raise OccError(
                f'{self.demonstrations} demonstrations of {self.episodes} episodes leave none '
                'that is fresh; allowed are fewer demonstrations'
            )


def run_alarms(
    output: Path,
    settings: AlarmSettings,
    *,
    progress: Callable[[int, int], None] = lambda *_: None,
) -> dict[str, Any]:
    """Learn with and without the guarantee, and count fresh episodes with an alarm.

    Two kinds of guarantee: calibrated on held-out demonstrations, which is about episodes like
    those, whatever happened in them; and calibrated on half of the other episodes without true
    cost, which is about episodes without true cost.

    Args:
        output: directory for ``alarms.json`` and ``alarms.md``.
        settings: what to draw.
        progress: called with (draws done, draws in all).

    Returns:
        ``lines``: per kind and guarantee the mean and the standard deviation over draws of the
        margin that bounds moved by and of the share of fresh episodes with an alarm, and the mean
        precision and recall on states of a driver that ignores hazards.
    """
    feature_map = load_feature_map(settings.world)
    values, costly = _drive(settings, 'expert', settings.episodes, settings.seed)
    ignoring = 'straightv' if settings.world == 'PointGoal1' else 'random'
    judged = _drive(settings, ignoring, _JUDGED_EPISODES, 10_000 + settings.seed)
    rng = np.random.default_rng(settings.seed)
    rows: dict[tuple[str, float | None], list[tuple[float, ...]]] = {}
    for draw in range(settings.draws):
        order = rng.permutation(len(values))
        learned, others = order[: settings.demonstrations], order[settings.demonstrations :]
        harmless = others[~costly[others].any(axis=1)]
        half = len(harmless) // 2
        for kind, calibrated, fresh in (
            ('demonstrated', None, others),
            ('without true cost', harmless[:half], harmless[half:]),
        ):
            for guaranteed in (None, *GUARANTEES):
                row = _once(
                    feature_map,
                    values[learned],
                    None if calibrated is None or guaranteed is None else values[calibrated],
                    values[fresh],
                    judged,
                    guaranteed,
                    rng,
                )
                rows.setdefault((kind, guaranteed), []).append(row)
        progress(draw + 1, settings.draws)
    result = {
        'settings': {**asdict(settings), 'heedless': ignoring},
        'episodes_with_true_cost': float(costly.any(axis=1).mean()),
        'lines': [_line(*key, found) for key, found in rows.items()],
        'machine': machine(),
        'versions': versions(('numpy', 'scipy', 'mujoco')),
    }
    write_results(output, 'alarms', result, markdown(result))
    return result


def markdown(result: Mapping[str, Any]) -> str:
    """Return the lines as a Markdown table."""
    heads = ('episodes', 'guaranteed', 'bound', 'moved by', 'fresh with an alarm')
    rows = [
        (
            line['episodes'],
            '-' if line['promised'] is None else f'{line["promised"]:g}',
            _digits(line['bound'], 3),
            f'{line["margin"]["mean"]:.4f} ± {line["margin"]["std"]:.4f}',
            f'{line["alarm_rate"]["mean"]:.3f} ± {line["alarm_rate"]["std"]:.3f}',
            _digits(line['precision']['mean'], 2),
            _digits(line['recall']['mean'], 2),
        )
        for line in result['lines']
    ]
    return markdown_table((*heads, 'precision', 'recall'), rows) + '\n'


def _digits(value: float | None, digits: int) -> str:
    return '-' if value is None else f'{value:.{digits}f}'


def _drive(
    settings: AlarmSettings, driver: str, episodes: int, seed: int
) -> tuple[np.ndarray, np.ndarray]:
    world = make_world(settings.world, 1)
    drive = find_driver(world, driver, np.random.default_rng(seed), explore=True)
    feature_map = load_feature_map(settings.world)
    values, costly = drive_states(settings.world, drive, feature_map, episodes, seed)
    world.close()
    return values.astype(np.float64), costly


def _once(
    feature_map: FeatureMap,
    demonstrations: np.ndarray,
    calibrated: np.ndarray | None,
    fresh: np.ndarray,
    judged: tuple[np.ndarray, np.ndarray],
    guaranteed: float | None,
    rng: np.random.Generator,
) -> tuple[float, ...]:
    """Return margin moved, bound, share of fresh episodes with an alarm, precision, recall."""
    constraints = learn(
        *_flat(demonstrations),
        feature_map.space,
        rng=rng,
        false_alarm=guaranteed,
        safe_episodes=None if calibrated is None else _flat(calibrated),
    )
    calibration = constraints.learner.get('calibration', {'margin': 0.0, 'bound': np.nan})
    safe = is_safe(constraints.rule_set, _flat(fresh)[0]).reshape(fresh.shape[:2])
    states, costly = judged
    score = score_flags(~is_safe(constraints.rule_set, _flat(states)[0]), costly.ravel()).ratios()
    return (
        calibration['margin'],
        calibration['bound'],
        float((~safe).any(axis=1).mean()),
        score['precision'],
        score['recall'],
    )


def _flat(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the states of (episodes, steps, k) as (n, k), and the (n,) episode of each."""
    episodes, steps, features = values.shape
    return values.reshape(-1, features), np.repeat(np.arange(episodes), steps)


def _line(kind: str, guaranteed: float | None, found: list[tuple[float, ...]]) -> dict[str, Any]:
    table = np.array(found)
    names = ('margin', 'bound', 'alarm_rate', 'precision', 'recall')
    spread = {name: _spread(column) for name, column in zip(names, table.T, strict=True)}
    bound = spread.pop('bound')['mean']
    return {'episodes': kind, 'promised': guaranteed, 'bound': bound, **spread}


def _spread(column: np.ndarray) -> dict[str, float | None]:
    """Return mean and standard deviation over the draws that have a value."""
    # There is no precision where nothing is flagged.
    known = column[np.isfinite(column)]
    return {
        'mean': float(known.mean()) if len(known) else None,
        'std': float(known.std(ddof=1)) if len(known) > 1 else None,
    }
