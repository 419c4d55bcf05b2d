# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""From recordings or tables and constraints to verdicts in time, in one call."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from occ_constraints_pkg.checking.timeline import (
    BRIDGE_SECONDS,
    TIMEOUT_SECONDS,
    Timeline,
    check_data,
)
from occ_constraints_pkg.datasets.reading import read_for_rules
from occ_constraints_pkg.features.lateness import MAX_LAG_SECONDS
from occ_constraints_pkg.rules.constraints_file import Constraints


def check_files(
    paths: Sequence[str | Path],
    constraints: Constraints,
    where: str = 'the constraints',
    *,
    max_lag: float = MAX_LAG_SECONDS,
    timeout: float = TIMEOUT_SECONDS,
    bridge: float = BRIDGE_SECONDS,
    progress: Callable[[int, int], None] | None = None,
) -> Timeline:
    """Judge recordings or tables; what was damaged in them is told by the timeline's data.

    Args:
        paths: recordings only, or table files only.
        constraints: the rules, and for recordings their feature map.
        where: what errors call the constraints.
        max_lag: seconds that a message may come late until the verdict is UNKNOWN; 0 for any.
        timeout: see :func:`make_timeline`, as for ``bridge``.
        bridge: see there.
        progress: called with (messages read, messages in all); not for tables.

    Raises:
        OccError: see :func:`~occ_constraints_pkg.datasets.reading.read_for_rules`.
    """
    data = read_for_rules(paths, constraints, where, max_lag=max_lag, progress=progress)
    return check_data(data, constraints.rule_set, timeout=timeout, bridge=bridge)
