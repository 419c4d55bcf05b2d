# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""How a run learns that it is to end, and says that it did."""

from __future__ import annotations

from occ_constraints_pkg.stopping import parent_is_gone, stop_request


class StoppedError(Exception):
    """The run was asked to stop, and has saved what it needs to go on."""


def is_stopped() -> bool:
    """Tell whether the run is to end: it was asked to, or its runner is gone."""
    return stop_request.made or parent_is_gone()
