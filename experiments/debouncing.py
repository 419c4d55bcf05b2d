# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""How verdicts should be debounced before a gate stops: false stops against missed obstacles.

Verdicts on recordings of robots go through several candidates. On a safe recording, judged by rules
learned from the others, stops are false; on those with contact, or in which the bumper fired, the
first stop should follow the first violation soon. An obstacle that only every third or tenth scan
shows must stop the robot, and keep it stopped.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from occ_constraints_pkg.rules.gating import Debounce, GateSettings
from occ_constraints_pkg.rules.verdict import Verdict

from experiments.results import data_folder, markdown_table, write_results
from experiments.robots import (
    KINDS,
    learn_safe,
    other_recordings,
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
class _Judged:
    """The verdicts on one recording.

    Attributes:
        is_safe: whether nothing happened in it.
        verdict: (n,) the verdicts.
        seconds: (n,) how long each is valid.
    """

    is_safe: bool
    verdict: np.ndarray
    seconds: np.ndarray


def run_debouncing(
    output: Path,
    *,
    folder: Path | None = None,
    progress: Callable[[int, int], None] = lambda *_: None,
) -> dict[str, Any]:
    """Run the experiment and write ``debouncing.json`` and ``debouncing.md``.

    Args:
        output: directory for the files; made if needed.
        folder: where the recordings are; default: ``robots``, see :func:`.data_folder`.
        progress: called with (kinds of robots read, kinds in all).

    Raises:
        OccError: there are fewer than three safe recordings of a kind, or one cannot be read.
    """
    items: list[_Judged] = []
    for done, kind in enumerate(KINDS, start=1):
        items += _judged(folder or data_folder('robots'), kind)
        progress(done, len(KINDS))
    result: dict[str, Any] = {
        'safe_recordings': sum(item.is_safe for item in items),
        'other_recordings': sum(not item.is_safe for item in items),
        'candidates': {
            name: {**_recorded(items, make), **_patterns(make)} for name, make in CANDIDATES.items()
        },
    }
    write_results(output, 'debouncing', result, _markdown(result))
    return result


def _judged(folder: Path, kind: str) -> Iterator[_Judged]:
    paths = safe_recordings(folder, kind)
    feature_map, _ = suggested_map(paths[0], kind)
    features = list(range(len(feature_map.names)))
    safe = [read_recorded(path, feature_map) for path in paths]
    for item in safe:
        rules = learn_safe([other for other in safe if other is not item], feature_map, features)
        yield _Judged(True, rules.rule_set.judge(item.data.values).verdict, item.seconds)
    rules = learn_safe(safe, feature_map, features)
    for path in other_recordings(folder, kind):
        item = read_recorded(path, feature_map)
        yield _Judged(False, rules.rule_set.judge(item.data.values).verdict, item.seconds)


def _recorded(
    items: Sequence[_Judged], make: Callable[[], Debounce | _Leaky]
) -> dict[str, float | int]:
    stops, stopped, total = 0, 0.0, 0.0
    delays = []
    for item in items:
        tripped = _tripped(make(), item.verdict != Verdict.SAFE)
        if item.is_safe:
            stops += int(np.count_nonzero(np.diff(tripped, prepend=False) & tripped))
            stopped += float(item.seconds[tripped].sum())
            total += float(item.seconds.sum())
        else:
            violated = int(np.argmax(item.verdict == Verdict.VIOLATED))
            delays.append(float(item.seconds[violated : int(np.argmax(tripped))].sum()))
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
    heads = ['debouncing', 'false stops', 'safe time stopped', 'time to stop']
    for pattern in PATTERNS:
        heads += [f'{pattern} stops at', 'stopped for']
    rows = []
    for name, found in result['candidates'].items():
        row = [name, found['false_stops'], f'{found["share_of_safe_time_stopped"]:.1%}']
        row.append(f'{found["seconds_to_stop"]:g} s')
        for pattern in PATTERNS:
            stops_at, share = found[pattern]['stops_at'], found[pattern]['share_stopped']
            row += [stops_at or 'never', f'{share:.0%}']
        rows.append(row)
    return (
        '# Debouncing of the gate\n\n'
        'Written by `python -m experiments debouncing`. Stops on '
        f'{result["safe_recordings"]} safe recordings of robots, each judged by rules learned from '
        f'the others, and the longest time from the first violation to the stop on '
        f'{result["other_recordings"]} with contact or bumper. V is VIOLATED, S is SAFE; "N of M" '
        'are violated verdicts of the last M; "leaky, T, L": a violation adds 1, a safe verdict '
        f'takes L away, T stops.\n\n{markdown_table(heads, rows)}\n'
    )
