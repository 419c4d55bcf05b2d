# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Quality of service of our topics, each open to overrides by parameter."""

from __future__ import annotations

from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.qos import (
    DurabilityPolicy,
    HistoryPolicy,
    QoSPolicyKind,
    QoSProfile,
    ReliabilityPolicy,
)
from rclpy.qos_overriding_options import QoSOverridingOptions

# Tables of steps: reliable, with room for a subscriber that falls behind for a while.
STEPS = QoSProfile(
    history=HistoryPolicy.KEEP_LAST, depth=100, reliability=ReliabilityPolicy.RELIABLE
)

# Verdicts: reliable, so that none is missed, and as deep as the tables they belong to.
VERDICTS = STEPS

# The current rule set: a late subscriber gets it too.
LATCHED = QoSProfile(
    history=HistoryPolicy.KEEP_LAST,
    depth=1,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
)

# Sensors of any robot: a best-effort subscription matches every publisher.
SENSORS = QoSProfile(
    history=HistoryPolicy.KEEP_LAST, depth=10, reliability=ReliabilityPolicy.BEST_EFFORT
)

# Velocity commands: only the newest counts.
COMMANDS = QoSProfile(
    history=HistoryPolicy.KEEP_LAST, depth=1, reliability=ReliabilityPolicy.RELIABLE
)

# Checks of the number of subscribers, 0.05 s apart, that must agree before the first message. A
# publisher learns of a subscriber a moment before the subscriber learns of it, and what is
# published within that moment is lost; no call shows when it is over.
SETTLED_CHECKS = 8


# What any topic lets users change.
_POLICIES = (QoSPolicyKind.HISTORY, QoSPolicyKind.DEPTH, QoSPolicyKind.RELIABILITY)
# What a publisher may promise besides, by which a subscriber notices that it is dead.
_PROMISES = (
    QoSPolicyKind.DURABILITY,
    QoSPolicyKind.DEADLINE,
    QoSPolicyKind.LIVELINESS,
    QoSPolicyKind.LIVELINESS_LEASE_DURATION,
)


def overridable(*, with_promises: bool = False) -> QoSOverridingOptions:
    """Let users change history, depth and reliability by parameter (``qos_overrides...``).

    Args:
        with_promises: whether also durability, deadline, liveliness and its lease; of a publisher
            of verdicts or commands, whose subscribers may want to notice that it is dead. A
            deadline or a lease of its own makes a subscriber ask for one incompatible with a
            publisher that offers none, so none is offered unasked.
    """
    return QoSOverridingOptions(_POLICIES + _PROMISES * with_promises)


def no_events() -> SubscriptionEventCallbacks:
    """Return what a subscription needs that is destroyed while its node spins.

    The events executor may crash when an event of a destroyed subscription is still under way
    (rclpy issue 1644).
    """
    return SubscriptionEventCallbacks(use_default_callbacks=False)
