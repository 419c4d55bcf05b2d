# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""One line of the examination."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from occ_constraints_pkg.errors import OccError

OK, NOTE, PROBLEM = 'ok', 'note', 'problem'


@dataclass(frozen=True)
class Finding:
    """What was found of one thing.

    Attributes:
        name: of the thing.
        level: ``ok``; ``note``, which not everybody minds; or ``problem``.
        text: what was found.
        advice: what to do; empty where nothing is to be done.
    """

    name: str
    level: str
    text: str
    advice: str = ''


def examined(name: str, examine: Callable[[], Finding]) -> Finding:
    """Return a finding; what cannot even be looked at is a problem."""
    try:
        return examine()
    except OccError as error:
        text, _, advice = str(error).partition('; ')
        return Finding(name, PROBLEM, text, advice)
    except OSError as error:
        return Finding(name, PROBLEM, f'cannot be examined: {error}')
