# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Demonstrations that keep a known rule, made from nothing but a seed.

A problem has demonstrations in whole episodes, fresh episodes of the same demonstrator (whatever
is flagged there is a false alarm), and test states with the true violation. A null has no rule
to find, so no test states.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

SIZES = {'1e3': (1_000, 10), '1e4': (10_000, 50), '1e5': (100_000, 200)}
"""Samples and episodes of each size."""

TEST_STATES = 20_000

# A column of a problem as it is drawn: (steps, episodes).
Column = np.ndarray


@dataclass(frozen=True, eq=False)
class Problem:
    """One planted problem.

    Attributes:
        name: which problem.
        names: of the k features.
        values: (n, k) demonstrations.
        episodes: (n,) the episode of each.
        fresh: (m, k) samples of fresh safe episodes.
        states: (t, k) test states; none for a null.
        violated: (t,) bool, which of them truly violate the rule.
        families: positions of features that belong together.
        limits: (k, 2) physical bounds, infinite where there is none.
    """

    name: str
    names: tuple[str, ...]
    values: np.ndarray
    episodes: np.ndarray
    fresh: np.ndarray
    states: np.ndarray
    violated: np.ndarray
    families: tuple[tuple[int, ...], ...] = ()
    limits: np.ndarray | None = None

    @property
    def is_null(self) -> bool:
        """Whether there is no rule to find."""
        return len(self.states) == 0


def generator(*key: object) -> np.random.Generator:
    """Return a generator that a key determines, in every process alike."""
    return np.random.default_rng([zlib.crc32(str(part).encode()) for part in key])


def wander(
    rng: np.random.Generator, steps: int, episodes: int, steadiness: float, spread: float = 1.0
) -> Column:
    """Return a stationary Ornstein-Uhlenbeck process per episode: (steps, episodes).

    Args:
        rng: draws it.
        steps: of each episode.
        episodes: how many.
        steadiness: correlation time in steps.
        spread: standard deviation.
    """
    keep = np.exp(-1.0 / steadiness)
    kick = np.sqrt(1 - keep * keep)
    now = rng.normal(size=episodes)
    out = np.empty((steps, episodes))
    for step in range(steps):
        out[step] = now
        now = keep * now + kick * rng.normal(size=episodes)
    return spread * out


def switching(
    rng: np.random.Generator, steps: int, episodes: int, kinds: int, often: float
) -> Column:
    """Return a mode, 0 to ``kinds`` - 1, that is drawn anew with a chance in each step."""
    now = rng.integers(0, kinds, episodes)
    out = np.empty((steps, episodes))
    for step in range(steps):
        now = np.where(rng.random(episodes) < often, rng.integers(0, kinds, episodes), now)
        out[step] = now
    return out


def squash(values: np.ndarray) -> np.ndarray:
    """Return the logistic function."""
    return 1 / (1 + np.exp(-values))


def _rows(columns: Sequence[Column]) -> tuple[np.ndarray, np.ndarray]:
    """Return (n, k) values, episode after episode, and (n,) the episode of each."""
    steps, episodes = columns[0].shape
    values = np.stack([column.T.reshape(-1) for column in columns], axis=1)
    return values, np.repeat(np.arange(episodes), steps)


def _problem(
    name: str,
    size: str,
    seed: int,
    names: Sequence[str],
    draw: Callable[[np.random.Generator, int, int], Sequence[Column]],
    judge: Callable[[np.random.Generator, np.ndarray], np.ndarray] | None = None,
    *,
    spoil: Callable[[np.random.Generator, np.ndarray], None] | None = None,
    key: str = '',
    families: tuple[tuple[int, ...], ...] = (),
    limits: np.ndarray | None = None,
) -> Problem:
    """Draw demonstrations, fresh episodes and test states.

    Args:
        name: of the problem.
        size: key of :data:`SIZES`.
        seed: of all chance, with name and size.
        names: of the features.
        draw: (rng, steps, episodes) to the columns.
        judge: (rng, states) changes states that were taken from fresh episodes in place, and
            returns which violate the rule; ``None`` for a null.
        spoil: (rng, values) makes some demonstrations bad, in place.
        key: problems of the same key are drawn alike; by default the name.
        families: see :class:`Problem`.
        limits: see :class:`Problem`.
    """
    samples, episodes = SIZES[size]
    steps = samples // episodes
    rng = generator(key or name, size, seed)
    values, of_episode = _rows(draw(rng, steps, episodes))
    fresh, _ = _rows(draw(rng, steps, max(50, episodes // 2)))
    states, violated = np.empty((0, len(names))), np.empty(0, dtype=bool)
    if judge is not None:
        states = fresh[rng.integers(len(fresh), size=TEST_STATES)].copy()
        violated = judge(rng, states)
    if spoil is not None:
        spoil(rng, values)
    return Problem(
        name, tuple(names), values, of_episode, fresh, states, violated, families, limits
    )


def _stopping(rng: np.random.Generator, steps: int, episodes: int) -> list[Column]:
    """Return speed and clearance of one who can always stop before the obstacle."""
    brake, rest = 1.0, 0.3
    wanted = np.abs(wander(rng, steps, episodes, 40, 0.55) + 0.75).clip(0, 1.5)
    care = rng.uniform(0.75, 1.0, episodes)
    clearance, speed = rng.uniform(1.0, 6.0, episodes), np.zeros(episodes)
    speeds, clearances = np.empty((2, steps, episodes))
    for step in range(steps):
        turn = (rng.random(episodes) < 0.03) | (clearance < 0.45)
        clearance = np.where(turn, rng.uniform(0.6, 6.0, episodes), clearance - speed * 0.1)
        clearance = np.maximum(clearance, rest + 0.02)
        most = np.sqrt(2 * brake * (clearance - rest)) * care
        speed = np.minimum(speed + 0.15, np.minimum(wanted[step], most))
        speeds[step], clearances[step] = speed, clearance
    return [speeds, clearances]


def _clearance_columns(rng: np.random.Generator, steps: int, episodes: int) -> list[Column]:
    motion = _stopping(rng, steps, episodes)
    return [
        *motion,
        wander(rng, steps, episodes, 15, 0.4),
        wander(rng, steps, episodes, 60),
        wander(rng, steps, episodes, 3, 0.2) + 9.8,
        24 + np.cumsum(rng.normal(0, 0.02, (steps, episodes)), axis=0) + rng.normal(0, 1, episodes),
    ]


def _too_close(rng: np.random.Generator, states: np.ndarray) -> np.ndarray:
    states[:, 0] = rng.uniform(0, 1.5, len(states))
    states[:, 1] = rng.uniform(0, 6.0, len(states))
    return states[:, 1] < states[:, 0] ** 2 / 2 + 0.3


_CLEARANCE_NAMES = ('speed', 'clearance', 'turn', 'heading', 'acc_z', 'temp')


def clearance_by_speed(size: str, seed: int) -> Problem:
    """Clearance that grows with the square of the speed."""
    return _problem('A2', size, seed, _CLEARANCE_NAMES, _clearance_columns, _too_close)


def bad_rows(size: str, seed: int) -> Problem:
    """The same with 4 % of the rows bad: speed and clearance are anything."""

    def spoil(rng: np.random.Generator, values: np.ndarray) -> None:
        bad = rng.random(len(values)) < 0.04
        values[bad, 0] = rng.uniform(0, 1.5, bad.sum())
        values[bad, 1] = rng.uniform(0, 6.0, bad.sum())

    return _problem(
        'A7', size, seed, _CLEARANCE_NAMES, _clearance_columns, _too_close, spoil=spoil, key='A2'
    )


def speed_limits_of_modes(size: str, seed: int) -> Problem:
    """A speed limit for each of three modes."""
    limits = np.array([1.5, 0.8, 0.2])

    def draw(rng: np.random.Generator, steps: int, episodes: int) -> list[Column]:
        mode = switching(rng, steps, episodes, 3, 0.02)
        share = squash(wander(rng, steps, episodes, 25, 1.5) + 0.8)
        speed = limits[mode.astype(int)] * share * rng.uniform(0.85, 1.0, episodes)
        others = [(15, 0.4), (60, 1.0), (5, 0.2), (30, 2.0)]
        return [speed, mode, *(wander(rng, steps, episodes, *other) for other in others)]

    def judge(rng: np.random.Generator, states: np.ndarray) -> np.ndarray:
        states[:, 0] = rng.uniform(0, 1.6, len(states))
        states[:, 1] = rng.integers(0, 3, len(states))
        return states[:, 0] > limits[states[:, 1].astype(int)]

    names = ('speed', 'mode', 'turn', 'heading', 'pitch', 'x')
    return _problem('A3', size, seed, names, draw, judge)


def following(size: str, seed: int) -> Problem:
    """A gap of 1.5 s and 2 m to the car ahead, among ten features of traffic."""

    def draw(rng: np.random.Generator, steps: int, episodes: int) -> list[Column]:
        headway = rng.uniform(1.6, 3.0, episodes)
        leader = (wander(rng, steps, episodes, 100, 8.0) + 20.0).clip(0, 36)
        free = rng.uniform(18, 36, episodes)
        speed = np.minimum(leader[0], free)
        gap = 2 + headway * speed + rng.exponential(20, episodes)
        speeds, gaps = np.empty((2, steps, episodes))
        for step in range(steps):
            # The leader leaves or another one cuts in, at a safe distance.
            new = rng.random(episodes) < 0.01
            gap = np.where(new, 2.5 + headway * speed + rng.exponential(40, episodes), gap)
            wanted = 2 + headway * speed
            gain = 1.5 * (1 - (speed / free) ** 4 - (wanted / np.maximum(gap, 1)) ** 2)
            speed = np.maximum(speed + gain.clip(-6, 2) * 0.2, 0)
            gap = np.maximum(gap + (leader[step] - speed) * 0.2, 2.2)
            speed = np.minimum(speed, np.maximum(gap - 2.1, 0) / 1.55)
            speeds[step], gaps[step] = speed, gap
        others = [
            np.minimum(np.exp(wander(rng, steps, episodes, 80, 0.8) + 3.8), 500.0) for _ in range(5)
        ]
        # Nothing in sight is told as 500 m.
        others = [
            np.where(wander(rng, steps, episodes, 100) > 1.0, 500.0, other) for other in others
        ]
        lane = rng.integers(0, 3, episodes)
        left = 2 + 4.0 * lane + wander(rng, steps, episodes, 20, 0.3)
        aside = wander(rng, steps, episodes, 6, 0.35)
        ahead = np.minimum(gaps, 500)
        return [speeds, aside, *others[:4], ahead, others[4], left, 12 - left]

    def judge(rng: np.random.Generator, states: np.ndarray) -> np.ndarray:
        states[:, 0] = rng.uniform(0, 34, len(states))
        states[:, 6] = rng.uniform(2.2, 120, len(states))
        return states[:, 6] < 1.5 * states[:, 0] + 2

    names = ('v_x', 'v_y', *(f'p_rel{number}' for number in range(6)), 'd_left', 'd_right')
    return _problem('A4', size, seed, names, draw, judge)


def two_regimes(size: str, seed: int) -> Problem:
    """Either forward, fast and nearly straight; or backward, slow, turning at will."""

    def draw(rng: np.random.Generator, steps: int, episodes: int) -> list[Column]:
        forward = rng.random(episodes) < 0.6
        speed = np.where(
            forward,
            0.8 + 1.2 * squash(wander(rng, steps, episodes, 20, 1.5)),
            -0.4 + 0.3 * squash(wander(rng, steps, episodes, 20, 1.5)),
        )
        turn = np.where(forward, 0.3, 1.0) * np.tanh(wander(rng, steps, episodes, 12, 1.2))
        others = [(15, 0.4), (60, 1.0), (5, 0.2), (30, 2.0)]
        return [speed, turn, *(wander(rng, steps, episodes, *other) for other in others)]

    def judge(rng: np.random.Generator, states: np.ndarray) -> np.ndarray:
        speed = states[:, 0] = rng.uniform(-0.4, 2, len(states))
        turn = states[:, 1] = rng.uniform(-1, 1, len(states))
        ahead = (speed >= 0.8) & (np.abs(turn) <= 0.3)
        return ~(ahead | ((speed >= -0.4) & (speed <= -0.1)))

    return _problem('A5', size, seed, ('v', 'turn', 'f2', 'f3', 'f4', 'f5'), draw, judge)


_NULL_NAMES = ('g0', 'g1', 'g2', 'g3', 'i0', 'i1', 'i2', 'i3', 'm2', 'm4', 's0', 's1')


def _null_columns(rng: np.random.Generator, steps: int, episodes: int) -> list[Column]:
    correlations = np.eye(4)
    correlations[0, 1] = correlations[1, 0] = 0.9
    correlations[1, 2] = correlations[2, 1] = 0.6
    correlations[0, 2] = correlations[2, 0] = 0.6
    mixing = np.linalg.cholesky(correlations)
    free = np.stack([wander(rng, steps, episodes, 20) for _ in range(4)])
    mixed = np.einsum('ij,jte->ite', mixing, free)
    single = [wander(rng, steps, episodes, steadiness) for steadiness in (3, 10, 40, 100)]
    modes = [switching(rng, steps, episodes, kinds, 0.03) for kinds in (2, 4)]
    skewed = [
        np.exp(wander(rng, steps, episodes, 30, 0.8)),
        np.abs(wander(rng, steps, episodes, 30)) ** 1.5,
    ]
    return [*mixed, *single, *modes, *skewed]


def correlated(size: str, seed: int) -> Problem:
    """No rule: correlated, skewed and discrete features."""
    return _problem('A6', size, seed, _NULL_NAMES, _null_columns)


def triple_in_twenty(size: str, seed: int) -> Problem:
    """One rule of three literals among twenty features."""
    steadiness = np.linspace(5, 60, 20)

    def is_bad(*three: np.ndarray) -> np.ndarray:
        return (three[0] > 0.5) & (three[1] < -0.3) & (three[2] > 0.2)

    def free(rng: np.random.Generator, steps: int, episodes: int) -> list[Column]:
        return [wander(rng, steps, episodes, one) for one in steadiness]

    def draw(rng: np.random.Generator, steps: int, episodes: int) -> list[Column]:
        columns = free(rng, steps, episodes)
        bad = is_bad(columns[3], columns[7], columns[11])
        columns[3] = np.where(bad, 1.0 - columns[3], columns[3])
        return columns

    def judge(rng: np.random.Generator, states: np.ndarray) -> np.ndarray:
        samples, episodes = SIZES[size]
        rows, _ = _rows(free(rng, samples // episodes, max(50, episodes // 2)))
        states[:] = rows[rng.integers(len(rows), size=len(states))]
        return is_bad(states[:, 3], states[:, 7], states[:, 11])

    return _problem('A8', size, seed, [f'x{number}' for number in range(20)], draw, judge)


_ROUNDS = 20


def _kept_off(
    columns: dict[str, Column],
    rules: Sequence[Callable[[dict[str, Column]], np.ndarray]],
    escapes: Sequence[tuple[str, float, float]],
) -> None:
    """Move one column out of each forbidden corner, reflected at its edge; changes ``columns``.

    Args:
        columns: by name.
        rules: each tells where it is violated.
        escapes: for each rule the column that gives way, where the corner begins, and how far it
            turns back for each unit that it would have gone in.
    """
    for _ in range(_ROUNDS):
        clean = True
        for rule, (name, edge, turned) in zip(rules, escapes, strict=True):
            bad = rule(columns)
            back = edge - turned * (columns[name] - edge)
            columns[name] = np.where(bad, back, columns[name])
            clean = clean and not bad.any()
        if clean:
            return
    raise AssertionError('the rules leave no way out')


def _by_name(names: Sequence[str], states: np.ndarray) -> dict[str, np.ndarray]:
    return {name: states[:, position] for position, name in enumerate(names)}


def _planted(
    name: str,
    size: str,
    seed: int,
    free: Callable[[np.random.Generator, int, int], dict[str, Column]],
    rules: Sequence[Callable[[dict[str, np.ndarray]], np.ndarray]],
    escapes: Sequence[tuple[str, float, float]],
    scattered: dict[str, Sequence[float]],
    *,
    families: tuple[tuple[int, ...], ...] = (),
    limits: np.ndarray | None = None,
) -> Problem:
    """Draw a problem whose demonstrator turns back at the edge of every forbidden corner.

    Args:
        name: of the problem.
        size: key of :data:`SIZES`.
        seed: of all chance.
        free: what one would do who heeds no rule.
        rules: what is forbidden.
        escapes: see :func:`_kept_off`.
        scattered: features that are anything in test states: a range, or more than two values to
            choose from.
        families: see :class:`Problem`.
        limits: see :class:`Problem`.
    """
    names = tuple(free(np.random.default_rng(0), 1, 1))

    def draw(rng: np.random.Generator, steps: int, episodes: int) -> list[Column]:
        columns = free(rng, steps, episodes)
        _kept_off(columns, rules, escapes)
        return list(columns.values())

    def judge(rng: np.random.Generator, states: np.ndarray) -> np.ndarray:
        for feature, choice in scattered.items():
            column = states[:, names.index(feature)]
            many = len(choice) > 2
            column[:] = (
                rng.choice(choice, len(column)) if many else rng.uniform(*choice, len(column))
            )
        named = _by_name(names, states)
        return np.any([rule(named) for rule in rules], axis=0)

    return _problem(name, size, seed, names, draw, judge, families=families, limits=limits)


def warehouse(size: str, seed: int) -> Problem:
    """A forklift: slow in mode 2, slow with the mast up, no sharp turns with a load."""

    def free(rng: np.random.Generator, steps: int, episodes: int) -> dict[str, Column]:
        return {
            'speed': 1.6 * squash(wander(rng, steps, episodes, 20, 1.5)),
            'mode': switching(rng, steps, episodes, 3, 0.02),
            'mast': 3.0 * squash(wander(rng, steps, episodes, 40, 1.5) - 0.5),
            'load': squash(wander(rng, steps, episodes, 80, 2.0)),
            'steer': np.tanh(wander(rng, steps, episodes, 10, 0.8)),
            'tilt': wander(rng, steps, episodes, 8, 0.5),
            'current': np.exp(wander(rng, steps, episodes, 25, 0.5)),
            'heading': wander(rng, steps, episodes, 60, 1.5),
        }

    rules = (
        lambda c: (c['mode'] == 2) & (c['speed'] > 0.4),
        lambda c: (c['mast'] > 1.5) & (c['speed'] > 0.8),
        lambda c: (c['load'] > 0.6) & (c['steer'] > 0.4),
        lambda c: (c['load'] > 0.6) & (c['steer'] < -0.4),
    )
    escapes = (('mode', 1.0, 1.0), ('mast', 1.5, 0.9), ('steer', 0.4, 0.9), ('steer', -0.4, 0.9))
    scattered = {
        'speed': (0.0, 1.6),
        'mode': (0, 1, 2),
        'mast': (0.0, 3.0),
        'load': (0.0, 1.0),
        'steer': (-1.0, 1.0),
    }
    return _planted('B1', size, seed, free, rules, escapes, scattered)


def near_and_fast(size: str, seed: int) -> Problem:
    """Eight sectors in front and eight behind: nothing near there while driving that way."""
    front = [f'front_{number}' for number in range(8)]
    rear = [f'rear_{number}' for number in range(8)]

    def sectors(rng: np.random.Generator, steps: int, episodes: int) -> list[Column]:
        return [np.clip(0.25 + wander(rng, steps, episodes, 15, 0.22), 0.0, 1.0) for _ in range(8)]

    def free(rng: np.random.Generator, steps: int, episodes: int) -> dict[str, Column]:
        return {
            'speed': 0.4 + wander(rng, steps, episodes, 25, 0.6),
            'turn': wander(rng, steps, episodes, 10, 0.4),
            **dict(zip(front, sectors(rng, steps, episodes), strict=True)),
            **dict(zip(rear, sectors(rng, steps, episodes), strict=True)),
        }

    rules = (
        lambda c: (np.max([c[name] for name in front], axis=0) > 0.7) & (c['speed'] > 0.5),
        lambda c: (np.max([c[name] for name in rear], axis=0) > 0.6) & (c['speed'] < -0.2),
    )
    scattered = {'speed': (-1.0, 1.8), **dict.fromkeys((*front, *rear), (0.0, 0.75))}
    limits = np.full((18, 2), [-np.inf, np.inf])
    limits[2:] = 0.0, 1.0
    families = (tuple(range(2, 10)), tuple(range(10, 18)))
    escapes = (('speed', 0.5, 0.5), ('speed', -0.2, 0.5))
    return _planted(
        'B2', size, seed, free, rules, escapes, scattered, families=families, limits=limits
    )


def drone(size: str, seed: int) -> Problem:
    """A low battery far from home, wind high up, and sinking fast near the ground in mode 3."""

    def free(rng: np.random.Generator, steps: int, episodes: int) -> dict[str, Column]:
        return {
            'battery': squash(wander(rng, steps, episodes, 60, 1.5) + 0.5),
            'distance': 400 * squash(wander(rng, steps, episodes, 40, 1.5) - 0.5),
            'altitude': 120 * squash(wander(rng, steps, episodes, 30, 1.5) - 0.7),
            'wind': np.abs(wander(rng, steps, episodes, 80, 6.0)),
            'climb': wander(rng, steps, episodes, 12, 1.2),
            'mode': switching(rng, steps, episodes, 4, 0.02),
            'yaw': wander(rng, steps, episodes, 50, 1.0),
            'vibration': np.exp(wander(rng, steps, episodes, 4, 0.3)),
            'gps': wander(rng, steps, episodes, 100, 2.0),
        }

    rules = (
        lambda c: (c['battery'] < 0.35) & (c['distance'] > 200),
        lambda c: (c['wind'] > 7) & (c['altitude'] > 50),
        lambda c: (c['mode'] == 3) & (c['altitude'] < 45) & (c['climb'] < -0.5),
    )
    escapes = (('distance', 200.0, 0.9), ('altitude', 50.0, 0.6), ('climb', -0.5, 0.9))
    scattered = {
        'battery': (0.0, 1.0),
        'distance': (0.0, 400.0),
        'altitude': (0.0, 120.0),
        'wind': (0.0, 15.0),
        'climb': (-3.0, 3.0),
        'mode': (0, 1, 2, 3),
    }
    return _planted('B3', size, seed, free, rules, escapes, scattered)


def drifting(size: str, seed: int) -> Problem:
    """Heavy loads are carried slowly and never uphill, while place, battery and heat drift."""

    def free(rng: np.random.Generator, steps: int, episodes: int) -> dict[str, Column]:
        way = np.cumsum(rng.normal(0.5, 0.5, (steps, episodes)), axis=0)
        used = np.linspace(0.0, 0.6, steps)[:, None] * rng.uniform(0.7, 1.3, episodes)
        heat = np.cumsum(rng.normal(0.0, 0.1, (steps, episodes)), axis=0)
        return {
            'speed': 1.5 * squash(wander(rng, steps, episodes, 20, 1.5)),
            'load': squash(wander(rng, steps, episodes, 60, 2.0)),
            'slope': wander(rng, steps, episodes, 30, 0.1),
            'x': way,
            'y': np.cumsum(rng.normal(0.0, 0.5, (steps, episodes)), axis=0),
            'battery': 1.0 - used,
            'heat': 20 + heat + np.linspace(0.0, 8.0, episodes),
        }

    rules = (
        lambda c: (c['load'] > 0.6) & (c['speed'] > 0.7),
        lambda c: (c['load'] > 0.6) & (c['slope'] > 0.05),
    )
    escapes = (('speed', 0.7, 0.8), ('slope', 0.05, 0.9))
    scattered = {'speed': (0.0, 1.5), 'load': (0.0, 1.0), 'slope': (-0.3, 0.3)}
    return _planted('B4', size, seed, free, rules, escapes, scattered)


def spoiled_null(size: str, seed: int) -> Problem:
    """No rule: the features of A6, with 4 % of the rows anything in all of them."""

    def spoil(rng: np.random.Generator, values: np.ndarray) -> None:
        bad = rng.random(len(values)) < 0.04
        low, high = values.min(axis=0), values.max(axis=0)
        values[bad] = rng.uniform(low, high, (int(bad.sum()), values.shape[1]))

    return _problem('N1', size, seed, _NULL_NAMES, _null_columns, spoil=spoil)


def habits(size: str, seed: int) -> Problem:
    """No rule: what is constant in an episode, slow, drifting, or a mode per episode."""

    def draw(rng: np.random.Generator, steps: int, episodes: int) -> list[Column]:
        constant = [np.tile(rng.normal(size=episodes), (steps, 1)) for _ in range(3)]
        kinds = np.tile(rng.integers(0, 3, episodes).astype(float), (steps, 1))
        slow = [wander(rng, steps, episodes, steps) for _ in range(3)]
        walk = [np.cumsum(rng.normal(size=(steps, episodes)), axis=0) for _ in range(2)]
        own = [wander(rng, steps, episodes, 10) * rng.uniform(0.3, 2.0, episodes)]
        return [*constant, kinds, *slow, *walk, *own]

    names = ('c0', 'c1', 'c2', 'kind', 's0', 's1', 's2', 'w0', 'w1', 'own')
    return _problem('N2', size, seed, names, draw)


def geometry(size: str, seed: int) -> Problem:
    """No rule: features that hang together by geometry and dynamics."""

    def draw(rng: np.random.Generator, steps: int, episodes: int) -> list[Column]:
        left = 6 + wander(rng, steps, episodes, 30, 1.5)
        speed = np.abs(wander(rng, steps, episodes, 30)) + 0.2
        turn = wander(rng, steps, episodes, 8, 0.3)
        bearing = wander(rng, steps, episodes, 40, 2.0)
        acceleration = np.gradient(speed, axis=0)
        return [
            left,
            12 - left,
            speed,
            turn,
            speed * turn,
            np.cos(bearing),
            np.sin(bearing),
            acceleration + wander(rng, steps, episodes, 2, 0.05),
            np.minimum(np.exp(wander(rng, steps, episodes, 60, 0.8) + 3), 40.0),
        ]

    names = ('left', 'right', 'speed', 'turn', 'lateral', 'cos', 'sin', 'acc', 'range')
    return _problem('N3', size, seed, names, draw)


MADE_UP: dict[str, Callable[[str, int], Problem]] = {
    'A2': clearance_by_speed,
    'A3': speed_limits_of_modes,
    'A4': following,
    'A5': two_regimes,
    'A6': correlated,
    'A7': bad_rows,
    'A8': triple_in_twenty,
    'B1': warehouse,
    'B2': near_and_fast,
    'B3': drone,
    'B4': drifting,
    'N1': spoiled_null,
    'N2': habits,
    'N3': geometry,
}
"""Problems by name: (size, seed) to the problem."""
