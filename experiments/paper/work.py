# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The process of one run: ``python -m experiments.paper.work RUN WORKSPACE``."""

from __future__ import annotations

import sys
from pathlib import Path

from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.stopping import parent_is_gone, stop_request

from experiments.paper.jobs import perform

STOPPED = 130
"""Exit code of a run that was stopped; it goes on when it is started again."""


class StoppedError(Exception):
    """The run was asked to stop, and has saved what it needs to go on."""


def is_stopped() -> bool:
    """Tell whether the run is to end: it was asked to, or its runner is gone."""
    return stop_request.made or parent_is_gone()


def _main(text: str, workspace: str) -> int:
    with stop_request.listening():
        try:
            perform(text, Path(workspace))
        except StoppedError:
            return STOPPED
        except OccError as error:
            print(f'error: {error}', file=sys.stderr)
            return 2
    return 0


if __name__ == '__main__':
    sys.exit(_main(*sys.argv[1:]))
