# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""What an event store loses when its writer is killed, and how fast it keeps and reads."""

from __future__ import annotations

import signal
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.events.event import Event, Stamps
from occ_constraints_pkg.events.store import STORE_NAME, EventReader, EventStore

_KILLS, _EVENTS = 50, 100_000
_MOST_AT_ONCE = 12
_START_SECONDS = 60.0
_TIMED, _SHOWN = 300, 50


@dataclass(frozen=True)
class Endurance:
    """What became of the events of writers that were killed.

    Attributes:
        events: acknowledged.
        lost: those of them that the store does not have as they were acknowledged.
        twice: those that it has more than once.
        interrupted: events that went on at a kill and were closed at the next start.
        unopened: starts at which the store could not be opened.
        kills: writers that were killed.
    """

    events: int
    lost: int
    twice: int
    interrupted: int
    unopened: int
    kills: int


def run(seconds: float = 60.0) -> dict[str, Any]:
    """Kill 50 writers at random moments, then fill the store and measure it.

    Args:
        seconds: of writing, all writers together.
    """
    with tempfile.TemporaryDirectory() as folder:
        directory = Path(folder)
        endured = endure(directory, kills=_KILLS, seconds=seconds)
        begun = time.perf_counter()
        store = EventStore(directory)
        opened = time.perf_counter() - begun
        taken = []
        for number in range(_TIMED):
            begun = time.perf_counter()
            store.keep([_event(endured.events * 10 + number)], now=number)
            taken.append(time.perf_counter() - begun)
        begun, missing = time.perf_counter(), max(0, _EVENTS - len(store))
        for first in range(0, missing, 1000):
            many = range(first, min(missing, first + 1000))
            store.keep([_event(10**9 + number) for number in many], now=first)
        filled = time.perf_counter() - begun
        size, count = store.used_bytes, len(store)
        store.close()
        reader = EventReader(directory / STORE_NAME)
        begun = time.perf_counter()
        reader.events(newest=_SHOWN)
        listed = time.perf_counter() - begun
        begun = time.perf_counter()
        reader.events()
        read = time.perf_counter() - begun
        reader.close()
    return {
        'metrics': {
            'acknowledged_events': endured.events,
            'lost_events': endured.lost,
            'events_twice': endured.twice,
            'interrupted_events': endured.interrupted,
            'failed_starts': endured.unopened,
            'keep_median_ms': float(np.median(taken)) * 1e3,
            'keep_p99_ms': float(np.quantile(taken, 0.99)) * 1e3,
            'keep_in_batches_events_per_s': missing / filled if missing else 0.0,
            'events_in_store': count,
            'bytes_per_event': size / count,
            'open_s': opened,
            'list_newest_s': listed,
            'read_all_s': read,
        },
        'peers': {},
        'settings': {'kills': endured.kills, 'writing_s': seconds, 'newest': _SHOWN},
    }


def endure(directory: Path, *, kills: int, seconds: float) -> Endurance:
    """Kill one writer of a store after another, and compare the store with what was acknowledged.

    Args:
        directory: of the store.
        kills: how many writers.
        seconds: of writing, all of them together.

    Raises:
        OccError: a writer does not start, or ends by itself.
    """
    rng = np.random.default_rng(0)
    acknowledged: dict[str, str] = {}
    first = unopened = interrupted = 0
    for _ in range(kills):
        after = float(rng.uniform(0.1, 1.9)) * seconds / kills
        lines = _write_until_killed(directory, first, after)
        for line in lines:
            number, phase = line.split()
            acknowledged[_id(int(number))] = phase
            first = max(first, int(number) + 1)
        # What was being written is not acknowledged, and may be there or not.
        first += 2 * _MOST_AT_ONCE
        try:
            store = EventStore(directory)
        except OccError:
            unopened += 1
            continue
        unopened += store.damaged is not None
        interrupted += len(store.interrupted)
        for event in store.interrupted:
            acknowledged[event.id] = 'ended'
        store.close()
    store = EventStore(directory)
    kept = store.events()
    store.close()
    ids = {item.event.id for item in kept}
    ended = {item.event.id for item in kept if item.event.ended is not None}
    lost = sum(
        key not in (ended if phase == 'ended' else ids) for key, phase in acknowledged.items()
    )
    twice = len(kept) - len(ids)
    return Endurance(len(acknowledged), lost, twice, interrupted, unopened, kills)


def _write_until_killed(directory: Path, first: int, seconds: float) -> list[str]:
    """Return the lines that a writer had written before it was killed."""
    process = subprocess.Popen(
        [sys.executable, '-m', 'benchmarks.events', str(directory), str(first)],
        stdout=subprocess.PIPE,
        text=True,
        cwd=Path(__file__).parents[1],
    )
    assert process.stdout is not None
    begun = process.stdout.readline()
    time.sleep(seconds)
    process.send_signal(signal.SIGKILL)
    text = process.stdout.read()
    if not begun or process.wait(_START_SECONDS) != -signal.SIGKILL:
        raise OccError(f'a writer of {directory} ended with {process.returncode}')
    # A line is acknowledged once it is whole.
    return text[: text.rfind('\n') + 1].splitlines()


def write(directory: Path, first: int) -> None:
    """Begin and end events for ever; print the number of each once the store has it."""
    store = EventStore(directory)
    rng = np.random.default_rng(first)
    print('begun', flush=True)
    while True:
        events = [_event(first + place) for place in range(rng.integers(1, _MOST_AT_ONCE))]
        for phase in ('began', 'ended'):
            if phase == 'ended':
                events = [replace(event, ended=event.began + 10**9) for event in events]
            store.keep(events, now=events[0].began)
            print(*(f'{first + place} {phase}' for place in range(len(events))), sep='\n')
            sys.stdout.flush()
        first += len(events)


def _id(number: int) -> str:
    return f'{number:024x}'


def _event(number: int) -> Event:
    began = 1_796_000_000_000_000_000 + number * 1_000_000_000
    return Event(
        id=_id(number),
        kind='violation',
        robot='/robot1',
        text='clearance_front below 0.35 m and speed above 0.6 m/s',
        began=began,
        worst=began,
        rule=f'R{number % 20:05x}',
        values={'clearance_front': 0.31, 'speed': 0.72},
        bounds=(
            {'feature': 'clearance_front', 'operator': '<', 'bound': 0.35},
            {'feature': 'speed', 'operator': '>', 'bound': 0.6},
        ),
        margin=-0.08,
        rule_set='959b352b13bc',
        stamps=Stamps(began, began, began),
    )


if __name__ == '__main__':
    write(Path(sys.argv[1]), int(sys.argv[2]))
