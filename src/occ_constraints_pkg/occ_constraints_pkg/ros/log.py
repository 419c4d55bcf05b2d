# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""A logger that writes one line for each message, whatever is in it."""

from __future__ import annotations

import os
from typing import Any

from occ_constraints_pkg.ros.rclpy_internals import Logger, skip_in_caller_search
from occ_constraints_pkg.terminal import printable

skip_in_caller_search(os.path.realpath(__file__))


class OneLineLogger(Logger):
    """Escapes control characters: names come from files and from other nodes."""

    def log(self, message: str, severity: Any, **kwargs: Any) -> bool:
        """Log a message as rclpy's logger does."""
        return super().log(printable(str(message)), severity, **kwargs)
