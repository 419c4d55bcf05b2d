# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The view without a screen: a plain line for each change, like a log."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable

from occ_constraints_pkg.fleet.model import Change, Fleet
from occ_constraints_pkg.stopping import parent_is_gone, stop_request
from occ_constraints_pkg.terminal import printable

# How often changes are looked for.
LOOK_SECONDS = 0.2
_QUIET_SECONDS = 5.0


def follow(poll: Callable[[], None], fleet: Fleet, write: Callable[[Change, float], None]) -> None:
    """Hand on each change until the process is asked to end.

    Args:
        poll: brings the fleet up to date.
        fleet: whose changes are handed on.
        write: gets a change and its wall time in seconds.
    """
    begin, is_told = time.monotonic(), False
    while not (stop_request.made or parent_is_gone()):
        next_look = time.monotonic() + LOOK_SECONDS
        poll()
        now = time.monotonic()
        if not (is_told or fleet.robots) and now - begin > _QUIET_SECONDS:
            is_told = True
            fleet.note(now, '-', 'note', NOBODY)
        for change in fleet.fresh_changes():
            write(change, time.time() - (time.monotonic() - change.time))
        # In small steps, for a signal only sets a flag.
        while not stop_request.made and (left := next_look - time.monotonic()) > 0:
            time.sleep(min(left, LOOK_SECONDS / 2))


NOBODY = (
    'no monitor is heard in this ROS domain; start one (occ node monitor), or see what is wrong '
    'with occ doctor'
)


def line_of(change: Change, wall: float) -> str:
    """Return a change as one line of plain text.

    Args:
        change: what has changed.
        wall: when, in seconds of the system's clock.
    """
    clock = time.strftime('%H:%M:%S', time.localtime(wall))
    return printable(
        f'{clock}.{int(wall * 100) % 100:02d}  {change.source}  {change.kind}: {change.text}'
    )


def document_of(change: Change, wall: float) -> dict[str, object]:
    """Return a change for machines."""
    return {
        'time': round(wall, 3),
        'source': change.source,
        'kind': change.kind,
        'text': change.text,
    }


def is_plain(environment: dict[str, str]) -> bool:
    """Return whether only plain text is wanted, or can be shown."""
    return (
        not (sys.stdin.isatty() and sys.stdout.isatty())
        or bool(environment.get('NO_COLOR'))
        or environment.get('TERM', 'dumb') in ('', 'dumb', 'unknown')
        or (sys.stdout.encoding or '').lower().replace('-', '') != 'utf8'
    )
