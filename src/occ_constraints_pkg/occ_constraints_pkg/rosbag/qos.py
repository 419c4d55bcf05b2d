# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Offered quality of service in the spelling of rosbag2 metadata, version 9."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from functools import lru_cache
from itertools import accumulate
from typing import Any

from occ_constraints_pkg.documents import parse_yaml
from occ_constraints_pkg.errors import OccError

# Longer text is not read: a hundred publishers fit, and what takes seconds to parse does not.
_MOST_CHARACTERS = 1 << 16
# Profiles nest three levels deep; thousands of open brackets take the parser seconds.
_MOST_LEVELS = 10

# The numbers of rmw/types.h, which metadata before version 9 used instead of names.
_NAMES = {
    'history': ('system_default', 'keep_last', 'keep_all', 'unknown'),
    'reliability': ('system_default', 'reliable', 'best_effort', 'unknown', 'best_available'),
    'durability': ('system_default', 'transient_local', 'volatile', 'unknown', 'best_available'),
    'liveliness': (
        'system_default',
        'automatic',
        'manual_by_node',
        'manual_by_topic',
        'unknown',
        'best_available',
    ),
}


def from_profile(profile: Any) -> dict[str, Any]:
    """Return the metadata entry of a ``rclpy.qos.QoSProfile`` (or anything with its attributes)."""
    entry: dict[str, Any] = {'history': profile.history.name.lower(), 'depth': profile.depth}
    for key in ('reliability', 'durability'):
        entry[key] = getattr(profile, key).name.lower()
    for key in ('deadline', 'lifespan'):
        entry[key] = _duration(getattr(profile, key).nanoseconds)
    entry['liveliness'] = profile.liveliness.name.lower()
    entry['liveliness_lease_duration'] = _duration(profile.liveliness_lease_duration.nanoseconds)
    entry['avoid_ros_namespace_conventions'] = bool(profile.avoid_ros_namespace_conventions)
    return entry


def parse_profiles(stored: str | Sequence[Mapping[str, Any]] | None) -> tuple[dict[str, Any], ...]:
    """Read ``offered_qos_profiles`` of any metadata version.

    Args:
        stored: a list of mappings (version 9) or YAML text of such a list (before, and in the
            channel metadata of an MCAP file); policies by name or by number.

    Returns:
        The profiles with policies by name; what cannot be read counts as not stated, since a
        bag's messages are worth reading without it.
    """
    if isinstance(stored, str):
        return _parsed(stored) if len(stored) <= _MOST_CHARACTERS else ()
    if not isinstance(stored, list | tuple):
        return ()
    return tuple(_named(profile) for profile in stored if isinstance(profile, Mapping))


# The topics of a recording mostly have the same text.
@lru_cache(maxsize=256)
def _parsed(text: str) -> tuple[dict[str, Any], ...]:
    levels = accumulate(1 if mark in '[{' else -1 for mark in re.findall(r'[][{}]', text))
    if max(levels, default=0) > _MOST_LEVELS:
        return ()
    try:
        profiles = parse_yaml(text, 'offered_qos_profiles')
    except OccError:
        return ()
    return () if isinstance(profiles, str) else parse_profiles(profiles)


def _named(profile: Mapping[str, Any]) -> dict[str, Any]:
    entry = dict(profile)
    for key, names in _NAMES.items():
        value = entry.get(key)
        if isinstance(value, int):
            entry[key] = names[value] if 0 <= value < len(names) else 'unknown'
    return entry


def _duration(nanoseconds: int) -> dict[str, int]:
    seconds, rest = divmod(nanoseconds, 1_000_000_000)
    return {'sec': seconds, 'nsec': rest}
