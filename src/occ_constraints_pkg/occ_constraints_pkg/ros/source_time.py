# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""When a message was published, as the middleware tells it beside the message."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from typing import Any

_MESSAGE_AND_INFO = inspect.Signature(
    [inspect.Parameter(name, inspect.Parameter.POSITIONAL_ONLY) for name in ('message', 'info')]
)


def with_source_time(callback: Callable[[Any, int], None]) -> Callable[..., None]:
    """Return a callback for a subscription out of one that takes a message and its source time.

    rclpy hands over what the middleware tells of a message if a callback has two parameters. Its
    events executor hands both over as one tuple, other executors as two arguments.

    Args:
        callback: takes the message, and when it was published by the publisher's system clock, in
            ns; 0 if the middleware does not say.
    """

    def call(*args: Any) -> None:
        message, info = args if len(args) == 2 else args[0]
        callback(message, info['source_timestamp'])

    call.__signature__ = _MESSAGE_AND_INFO
    return call
