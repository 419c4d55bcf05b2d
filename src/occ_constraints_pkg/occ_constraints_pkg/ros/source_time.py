# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""When a message was published, as the middleware tells it beside the message."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any


def with_source_time(callback: Callable[[Any, int], None]) -> Callable[..., None]:
    """Return a callback for a subscription out of one that takes a message and its source time.

    rclpy hands over what the middleware tells of a message if a callback has two parameters.

    Args:
        callback: takes the message, and when it was published by the publisher's system clock, in
            ns; 0 if the middleware does not say.
    """

    def call(message: Any, info: Any) -> None:
        callback(message, info['source_timestamp'])

    return call
