# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""A process that performs one run after another: ``python -m experiments.paper.work WORKSPACE``.

It reads runs from its input, a line each, and answers each with a line of JSON. Torch takes longer
to import than many a run to perform, so a process is not started for every run.
"""

from __future__ import annotations

import json
import os
import sys
import traceback
from pathlib import Path

from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.stopping import stop_request

from experiments.paper.jobs import perform
from experiments.paper.stopping import StoppedError, is_stopped


def _answer(text: str, workspace: Path) -> dict[str, str]:
    """Perform a run; return nothing if it is done, else why it is not."""
    try:
        perform(text, workspace)
    except StoppedError:
        return {'stopped': 'saved'}
    except OccError as error:
        return {'error': str(error)}
    except Exception as error:
        traceback.print_exc()
        return {'error': f'{type(error).__name__}: {error}'}
    return {}


def _main(workspace: str) -> None:
    # What a library prints is no answer.
    answers = os.fdopen(os.dup(1), 'w', encoding='utf-8')
    os.dup2(2, 1)
    with stop_request.listening():
        for text in sys.stdin:
            print(json.dumps(_answer(text, Path(workspace))), file=answers, flush=True)
            if is_stopped():
                return


if __name__ == '__main__':
    _main(*sys.argv[1:])
