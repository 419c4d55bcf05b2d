# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""A node's log, in which a message is one line whatever it tells of."""

from __future__ import annotations

import os
from typing import Any

from rclpy.impl import rcutils_logger

from occ_constraints_pkg.terminal import printable

# rclpy throttles by the place of the call; without this all calls would seem to come from here.
rcutils_logger._internal_callers.append(os.path.realpath(__file__))


class OneLineLogger(rcutils_logger.RcutilsLogger):
    """Writes control characters of messages out: names come from files and from other nodes."""

    def log(self, message: str, severity: Any, **kwargs: Any) -> bool:
        """Log a message as :meth:`RcutilsLogger.log` does."""
        return super().log(printable(str(message)), severity, **kwargs)
