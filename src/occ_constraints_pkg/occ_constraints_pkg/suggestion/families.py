# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Families: which features measure the same in different places, by how they behave."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence

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
    groups: dict[tuple[str, str], list[Candidate]] = defaultdict(list)
    for item in items:
        groups[item.topic.name, item.group].append(item)
    for (_, group), members in groups.items():
        families = _alike(members)
        shared = [family for family in families if len(family) > 1]
        for family in shared:
            name = group if len(families) == 1 else f'{group}_{_tail(family[0], group)}'
            seen = tuple(part for item in family for part in item.seen)
            for item in family:
                item.entry['family'] = name
                item.family_seen = seen


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
