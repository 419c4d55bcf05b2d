# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""What recorder and player share: the choice of topics, and their quality of service."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

from occ_constraints_pkg.ros.node import OccNode
from occ_constraints_pkg.rosbag.topic_filter import TopicFilter

# What a recorder may fall behind, and what a player keeps for whoever comes later.
_DEPTH = 1000


def topic_filter(node: OccNode, verb: str) -> TopicFilter:
    """Declare the parameters that choose topics, and return the choice, names as they are given.

    Args:
        node: gets the parameters.
        verb: what is done to the topics.

    Raises:
        OccError: a pattern is not valid.
    """
    return TopicFilter(
        node.parameter('topics', [], f'topics to {verb}; none here nor in regex: all'),
        node.parameter('regex', '', f'topics to {verb}: those with this pattern in their name'),
        node.parameter('exclude_topics', [], f'topics not to {verb}'),
        node.parameter('exclude_regex', '', f'pattern of topics not to {verb}'),
    )


def profile_to_record(offered: Sequence[QoSProfile], before: QoSProfile | None) -> QoSProfile:
    """Ask for what every publisher of a topic offers: reliable or latched only when all are.

    Args:
        offered: by each publisher.
        before: what was asked for so far. Never more than that: it would fetch latched messages
            a second time.
    """
    known = [*offered, *([] if before is None else [before])]
    return _profile(
        reliable=all(item.reliability == ReliabilityPolicy.RELIABLE for item in known),
        latched=all(item.durability == DurabilityPolicy.TRANSIENT_LOCAL for item in known),
    )


def profile_to_play(offered: Sequence[Mapping[str, Any]], *, latched: bool) -> QoSProfile:
    """Offer what suits every subscriber that one of the recorded publishers suited.

    Latched messages all stay available, for several publishers may have latched one each.

    Args:
        offered: by the recorded publishers, spelled as in rosbag2 metadata 9.
        latched: whether messages are kept for late subscribers.
    """
    modest = offered and all(item.get('reliability') == 'best_effort' for item in offered)
    return _profile(reliable=not modest, latched=latched)


def _profile(*, reliable: bool, latched: bool) -> QoSProfile:
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST,
        depth=_DEPTH,
        reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
    )
