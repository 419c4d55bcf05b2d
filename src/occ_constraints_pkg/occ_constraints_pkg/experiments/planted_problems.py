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


PROBLEMS: dict[str, Callable[[str, int], Problem]] = {
    'A2': clearance_by_speed,
    'A3': speed_limits_of_modes,
    'A4': following,
    'A5': two_regimes,
    'A6': correlated,
    'A7': bad_rows,
    'A8': triple_in_twenty,
}
"""Every problem by its name: (size, seed) to the problem."""
