# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Families: which features measure the same in different places, by how they behave."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from itertools import combinations

from occ_constraints_pkg.suggestion.candidate import Candidate

# Ends of the ranges of members differ by at most this share of the family's range: of positions,
# and of absolute values.
_ALIKE_POSITIONS, _ALIKE_SIZES = 0.1, 0.35


def form_families(items: Sequence[Candidate]) -> None:
    """Give candidates of one group and of like ranges one family, and so one pair of bounds.

    The bounds of a family are those of its widest member. Joints that move in other ranges, as
    elbow and wrist do, get families of their own, or none.

    Args:
        items: candidates with a group, whose values were looked at.
    """
    groups: dict[tuple[str, str, str], list[Candidate]] = defaultdict(list)
    for item in items:
        groups[item.topic.name, item.group, item.entry['unit']].append(item)
    for (_, group, _), members in groups.items():
        families = _alike(members)
        shared = [family for family in families if len(family) > 1]
        for family in shared:
            name = group if len(families) == 1 else f'{group}_{_tail(family[0], group)}'
            seen = tuple(part for item in family for part in item.seen)
            for item in family:
                item.entry['family'] = name
                item.family_seen = seen


def coupled_pairs(items: Sequence[Candidate]) -> list[tuple[str, str]]:
    """Return what the dynamics of one joint or sensor tie together, by features or families.

    A joint that moves lags behind its command, and effort moves it: combinations that never come
    are no constraint of the robot's task.

    Args:
        items: all that are in use.
    """
    pairs: dict[tuple[str, str], None] = {}
    for first, second in combinations(items, 2):
        names = [str(item.entry.get('family', item.entry['name'])) for item in (first, second)]
        is_tied = first.coupled and first.coupled == second.coupled and names[0] != names[1]
        if is_tied and (names[1], names[0]) not in pairs:
            pairs[names[0], names[1]] = None
    return list(pairs)


def _alike(members: Sequence[Candidate]) -> list[list[Candidate]]:
    families: list[list[Candidate]] = []
    for item in sorted(members, key=lambda item: _ends(item)[0] - _ends(item)[1]):
        for family in families:
            (low, high), (own_low, own_high) = _ends(family[0]), _ends(item)
            is_size = item.role is not None and item.role.is_magnitude
            most = (_ALIKE_SIZES if is_size else _ALIKE_POSITIONS) * (high - low)
            if abs(own_low - low) <= most and abs(own_high - high) <= most:
                family.append(item)
                break
        else:
            families.append([item])
    return families


def _ends(item: Candidate) -> tuple[float, float]:
    low, high = min(part.low for part in item.seen), max(part.high for part in item.seen)
    if item.role is not None and item.role.is_magnitude:
        return 0.0, max(abs(low), abs(high))
    return low, high


def _tail(item: Candidate, group: str) -> str:
    return str(item.entry['name']).removeprefix(f'{group}_')
