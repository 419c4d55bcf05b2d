# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""How verdicts should be debounced before a gate stops: false stops against missed obstacles.

Verdicts on recordings of robots go through several candidates. On a safe recording, judged by rules
learned from the others, stops are false; on those with contact, or in which the bumper fired, the
first stop should follow the first violation soon. An obstacle that only every third or tenth scan
shows must stop the robot, and keep it stopped.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from occ_constraints_pkg.files import make_directory, replacing
from occ_constraints_pkg.rules.gating import Debounce, GateSettings
from occ_constraints_pkg.rules.verdict import Verdict

from experiments.robots import (
    KINDS,
    data_folder,
    learn_safe,
    read_recorded,
    safe_recordings,
    suggested_map,
)

PATTERNS = ('VSS', 'VSSSSSSSSS')
_PATTERN_REPEATS = 40
_RELEASE = GateSettings().release_count


class _Leaky:
    """A count that a violation raises by 1 and a safe verdict lowers by ``leak``."""

    def __init__(self, threshold: float, leak: float) -> None:
        self.tripped = False
        self._threshold, self._leak = threshold, leak
        self._level, self._good_in_a_row = 0.0, 0

    def add(self, is_bad: bool) -> None:
        change = 1.0 if is_bad else -self._leak
        self._level = min(self._threshold, max(0.0, self._level + change))
        self._good_in_a_row = 0 if is_bad else self._good_in_a_row + 1
        if is_bad and self._level >= self._threshold:
            self.tripped = True
        elif self._good_in_a_row >= _RELEASE:
            self.tripped = False


CANDIDATES: dict[str, Callable[[], Debounce | _Leaky]] = {
    '1 of 1': lambda: Debounce(1, 1, _RELEASE),
    '2 of 3': lambda: Debounce(2, 3, _RELEASE),
    '2 of 10': lambda: Debounce(2, 10, _RELEASE),
    '2 of 20': lambda: Debounce(2, 20, _RELEASE),
    '3 of 30': lambda: Debounce(3, 30, _RELEASE),
    'leaky, 1.5, 0.05': lambda: _Leaky(1.5, 0.05),
    'leaky, 2, 0.05': lambda: _Leaky(2.0, 0.05),
}


@dataclass(frozen=True)
class _Drive:
    """The verdicts on one recording.

    Attributes:
        is_safe: whether nothing happened in it.
        verdict: (n,) the verdicts.
        seconds: (n,) how long each stands.
    """

    is_safe: bool
    verdict: np.ndarray
    seconds: np.ndarray


def run_debouncing(output: Path, *, folder: Path | None = None) -> dict[str, Any]:
    """Run the experiment and write ``debouncing.json`` and ``debouncing.md``.

    Args:
        output: directory for the files; made if needed.
        folder: where the recordings are; None for
            :func:`~experiments.robots.data_folder`.

    Raises:
        OccError: there are fewer than three safe recordings of a kind, or one cannot be read.
    """
    folder = data_folder() if folder is None else folder
    drives = [drive for kind in KINDS for drive in _drives(folder, kind)]
    make_directory(output)
    result: dict[str, Any] = {
        'safe_recordings': sum(drive.is_safe for drive in drives),
        'other_recordings': sum(not drive.is_safe for drive in drives),
        'candidates': {
            name: {**_recorded(drives, make), **_patterns(make)}
            for name, make in CANDIDATES.items()
        },
    }
    for name, text in (
        ('debouncing.json', json.dumps(result, indent=2) + '\n'),
        ('debouncing.md', _markdown(result)),
    ):
        with replacing(output / name) as draft:
            draft.write_text(text, encoding='utf-8')
    return result


def _drives(folder: Path, kind: str) -> Iterator[_Drive]:
    paths = safe_recordings(folder, kind)
    feature_map, _ = suggested_map(paths[0], kind)
    features = list(range(len(feature_map.names)))
    safe = [read_recorded(path, feature_map) for path in paths]
    for item in safe:
        rules = learn_safe([other for other in safe if other is not item], feature_map, features)
        yield _Drive(True, rules.rule_set.judge(item.data.values).verdict, item.seconds)
    rules = learn_safe(safe, feature_map, features)
    others = [*folder.glob(f'contact_{kind}_*'), *folder.glob(f'bump_{kind}_*')]
    for path in sorted(others):
        item = read_recorded(path, feature_map)
        yield _Drive(False, rules.rule_set.judge(item.data.values).verdict, item.seconds)


def _recorded(
    drives: Sequence[_Drive], make: Callable[[], Debounce | _Leaky]
) -> dict[str, float | int]:
    stops, stopped, total = 0, 0.0, 0.0
    delays = []
    for drive in drives:
        tripped = _tripped(make(), drive.verdict != Verdict.SAFE)
        if drive.is_safe:
            stops += int(np.count_nonzero(np.diff(tripped, prepend=False) & tripped))
            stopped += float(drive.seconds[tripped].sum())
            total += float(drive.seconds.sum())
        else:
            violated = int(np.argmax(drive.verdict == Verdict.VIOLATED))
            delays.append(float(drive.seconds[violated : int(np.argmax(tripped))].sum()))
    return {
        'false_stops': stops,
        'share_of_safe_time_stopped': round(stopped / total, 4),
        'seconds_to_stop': round(max(delays), 2),
    }


def _patterns(make: Callable[[], Debounce | _Leaky]) -> dict[str, dict[str, float | int | None]]:
    """Return after how many verdicts of a pattern it stops, and for which share it is stopped."""
    found = {}
    for pattern in PATTERNS:
        bad = np.array([letter == 'V' for letter in pattern * _PATTERN_REPEATS])
        tripped = _tripped(make(), bad)
        later = tripped[len(tripped) // 2 :]
        found[pattern] = {
            'stops_at': int(np.argmax(tripped)) + 1 if tripped.any() else None,
            'share_stopped': round(float(later.mean()), 3),
        }
    return found


def _tripped(switch: Debounce | _Leaky, bad: np.ndarray) -> np.ndarray:
    """Return for (n,) samples whether the switch is on after each; it is off before."""
    states = []
    for is_bad in bad.tolist():
        switch.add(is_bad)
        states.append(switch.tripped)
    return np.array(states)


def _markdown(result: dict[str, Any]) -> str:
    titles = ' | '.join(f'{pattern} stops at | stopped for' for pattern in PATTERNS)
    lines = [
        '# Debouncing of the gate',
        '',
        'Written by `occ experiment debouncing`. Stops on '
        f'{result["safe_recordings"]} safe recordings of robots, each judged by rules learned from '
        f'the others, and the longest time from the first violation to the stop on '
        f'{result["other_recordings"]} with contact or bumper. V is VIOLATED, S is SAFE; "N of M" '
        'are violated verdicts of the last M; "leaky, T, L": a violation adds 1, a safe verdict '
        'takes L away, T stops.',
        '',
        f'| debouncing | false stops | safe time stopped | time to stop | {titles} |',
        f'|{"---|" * (4 + 2 * len(PATTERNS))}',
    ]
    for name, found in result['candidates'].items():
        patterns = ' | '.join(
            f'{found[pattern]["stops_at"] or "never"} | {found[pattern]["share_stopped"]:.0%}'
            for pattern in PATTERNS
        )
        lines.append(
            f'| {name} | {found["false_stops"]} | {found["share_of_safe_time_stopped"]:.1%} '
            f'| {found["seconds_to_stop"]:g} s | {patterns} |'
        )
    return '\n'.join(lines) + '\n'
