# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Runs the live view: on a screen where there is one, else as plain lines."""

from __future__ import annotations

import os
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from occ_constraints_pkg.errors import OccError, missing_extra
from occ_constraints_pkg.fleet.model import Change, Fleet
from occ_constraints_pkg.fleet.network import Network
from occ_constraints_pkg.stopping import stop_request
from occ_constraints_pkg.watch.lines import follow


def run_lines(write: Callable[[Change, float], None]) -> int:
    """Hand on each change until the process is asked to end; see :func:`watch.lines.follow`.

    Raises:
        OccError: ROS cannot be listened to.
    """
    with stop_request.listening():
        fleet = Fleet()
        network = Network(fleet)
        try:
            follow(network.poll, fleet, write)
        finally:
            network.close()
    return 0


def run_screen() -> int:
    """Show the view on the terminal until it is left.

    Raises:
        OccError: textual is not installed, or ROS cannot be listened to.
    """
    try:
        from occ_constraints_pkg.watch.view import WatchApp
    except ModuleNotFoundError as error:
        if (told := missing_extra('the live view', error)) is None:
            raise
        raise told from error
    with stop_request.listening(), _quiet_stderr():
        fleet = Fleet()
        network = Network(fleet)
        app = WatchApp(fleet, network)
        try:
            app.run()
        finally:
            network.close()
    if app.error is not None:
        raise OccError(str(app.error)) from app.error
    return app.return_code or 0


@contextmanager
def _quiet_stderr() -> Iterator[None]:
    """Keep what the middleware writes to stderr from the screen; it follows at the end.

    Textual draws on what Python calls ``sys.__stderr__``, and gets the terminal itself for it.
    """
    sys.stderr.flush()
    terminal, before = sys.__stderr__, os.dup(2)
    with tempfile.TemporaryFile() as kept, open(os.dup(1), 'w', encoding='utf-8') as screen:
        os.dup2(kept.fileno(), 2)
        sys.__stderr__ = screen
        try:
            yield
        finally:
            sys.__stderr__ = terminal
            os.dup2(before, 2)
            os.close(before)
            kept.seek(0)
            sys.stderr.write(kept.read().decode(errors='replace'))
