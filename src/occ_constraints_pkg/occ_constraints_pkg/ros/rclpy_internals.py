# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""What rclpy 7.1 keeps private and this package needs: here and nowhere else, each with its reason.

A new release of rclpy is checked against this one module.
"""

from __future__ import annotations

from rclpy.impl import rcutils_logger
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.lifecycle import LifecycleNodeMixin
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.subscription import Subscription

RCLError = rclpy_implementation.RCLError
"""Raised when the layers below rclpy refuse something, such as a second type on a topic.

It has no public name, and its base class is RuntimeError, which would catch too much.
"""

Logger = rcutils_logger.RcutilsLogger
"""What a node logs with; the public functions return it but do not name its class."""


def skip_in_caller_search(file: str) -> None:
    """Let log lines seem to come from whoever calls the functions of a file.

    rclpy throttles by the line of the call, so with a wrapper all calls would be one. It has no
    public way to name a wrapper.
    """
    rcutils_logger._internal_callers.append(file)


def parameter_overrides(node: Node) -> dict[str, Parameter]:
    """Return what was given for the parameters of a node, declared or not; changes count.

    The public ways show declared parameters only, whereas a misspelled one has to be refused.
    """
    return node._parameter_overrides


def lifecycle_state(node: LifecycleNodeMixin) -> tuple[int, str]:
    """Return number and label of the present state.

    The public way is the node's own service, which it cannot call within a callback.
    """
    return node._state_machine.current_state


def lifecycle_transitions(node: LifecycleNodeMixin) -> dict[int, str]:
    """Return number and label of the transitions that the present state has; as for the state."""
    return {item[0]: item[1] for item in node._state_machine.available_transitions}


def take(subscription: Subscription) -> tuple[bytes, dict[str, int]] | None:
    """Return the oldest message that waits on a subscription made with ``raw=True``; None for none.

    The public way is an executor, which wakes Python for each message of a topic. Whoever looks a
    few times a second only, and at the newest message, saves that.

    Returns:
        The serialized message and when it was sent and received: ``source_timestamp`` and
        ``received_timestamp`` in ns of the system's clock, 0 where the middleware does not know.
    """
    return subscription.handle.take_message(subscription.msg_type, True)
