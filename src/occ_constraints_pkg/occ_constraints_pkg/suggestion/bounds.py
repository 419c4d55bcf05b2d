# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""How finely a quantity is told, and on which side of what was seen a rule may lie."""

from __future__ import annotations

import math
from collections.abc import Sequence

from occ_constraints_pkg.suggestion.candidate import Candidate
from occ_constraints_pkg.suggestion.meanings import ROLES, Role, words_of
from occ_constraints_pkg.suggestion.nice_numbers import nice_above, nice_below, nice_between
from occ_constraints_pkg.suggestion.statistics import FeatureStatistics

# What changes by less is noise, for example of a simulation, and not a movement.
NOISE = 0.002
RESOLUTIONS = {'m/s': 0.01, 'rad/s': 0.01, 'm/s^2': 0.5, 'm': 0.01, 'rad': 0.01}
# Values are told apart in so many steps over their range.
_STEPS = 20
# A limit above is not told more finely than to this part of the usual value.
_FINEST = 50
# For a bound that is further from what was seen, there may be as few steps over the range; and
# this part of the range is room enough.
_FEWEST_STEPS, _MOST_ROOM = 4, 0.2
# A rule begins half a step beyond the rounded end of what was seen, which should not be less than
# the end itself; a little less, for rounding of floats.
_LEAST_ROOM = 0.499
# A drained battery is told below what was seen by this share of the usual value, and more.
_DRAIN_SHARE = 0.02


def is_hardly_known(item: Candidate) -> bool:
    """Tell whether a quantity went to and fro too seldom to know how far it goes."""
    if item.is_flag or 'sectors' in item.entry or (item.role is not None and item.role.left):
        return False
    return sum(seen.swings for seen in item.seen) + 2 < 1.0 / _MOST_ROOM


def settle_bounds(item: Candidate) -> None:
    """Give a candidate that was looked at the steps and bounds that its values ask for."""
    if item.kind == 'Range':
        _cap(item)
    elif item.is_flag:
        item.entry.setdefault('bounds', [0, None])
    elif item.role is not None and item.role.left:
        _allow_to_drain(item, item.role)
    elif item.role is not None:
        _limit(item, item.role)
    elif 'sectors' not in item.entry and item.kind != 'table':
        _round(item)


def _cap(item: Candidate) -> None:
    """Make all that is further off than usual the same, so that no rule forbids open space."""
    low, median = min(seen.low for seen in item.seen), item.seen[0].median
    high = max(seen.high for seen in item.seen)
    cap = nice_below((median + high) / 2.0)
    if math.isfinite(high) and 'bounds' in item.entry:
        step = max(nice_above((high - low) / _STEPS), RESOLUTIONS['m'])
        step = _roomy(step, ROLES['distance'], item.seen, low, high)
        item.entry |= {'transform': [{'round': step}, {'clip': [0, cap]}], 'bounds': [0, cap]}
        item.remark += f', and more than {cap:g} m as {cap:g} m'


def _round(item: Candidate) -> None:
    """Give a measured quantity a resolution, so that no bound is a matter of noise."""
    low, high = min(seen.low for seen in item.seen), max(seen.high for seen in item.seen)
    steps = item.entry.get('transform', [])
    if not high - low > NOISE or any(isinstance(step, dict) for step in steps):
        return
    # A jolt at the start, as of a simulation, says nothing of how finely values are to be told.
    usual = max(seen.spread for seen in item.seen)
    known = RESOLUTIONS.get(item.entry['unit'], 0.0)
    role = Role(item.entry['unit'], 'above' if 'abs' in steps else 'both')
    step = max(known, nice_above((usual or high - low) / _STEPS))
    step = _roomy(step, role, item.seen, low, high)
    item.entry['transform'] = [*steps, {'round': step}]
    if item.name.endswith('speed') and 'abs' not in steps:
        _allow_to_rest(item, step, low)


def _allow_to_rest(item: Candidate, step: float, low: float) -> None:
    """Let no rule forbid to stand still, where the robot did not in what was seen.

    What flies by its wings is the exception.
    """
    if round(low / step) <= 0 or 'airspeed' in words_of(item.entry['field']):
        return
    end = _on_grid(item.seen[0].median, step, item.seen[0].high, 'above')
    item.entry['transform'] = [*item.entry['transform'], {'clip': [end, None]}]
    _note(
        item,
        f'it never stood still here, and may: less than {end:g} counts as {end:g}, so that no rule '
        'is about values below',
    )


def _allow_to_drain(item: Candidate, role: Role) -> None:
    """Bound what falls as long as the robot works, far enough below for the next drive.

    A drive shows a part of the way down; the next one goes on from there, or begins elsewhere.
    """
    low, high = min(seen.low for seen in item.seen), max(seen.high for seen in item.seen)
    median = max(seen.median for seen in item.seen)
    end = min(2.0 * low - high - abs(median) * _DRAIN_SHARE, role.left * low if low > 0.0 else low)
    size = 10.0 ** (math.floor(math.log10(max(abs(end), 1e-9))) - 1)
    end = float(f'{math.floor(end / size) * size:.12g}')
    steps = [*item.entry.get('transform', []), {'clip': [None, end]}]
    item.entry |= {'transform': steps, 'bounds': [None, end]}
    item.remark = (
        f'more than {end:g} counts as {end:g}, for the next drive may begin with less than this '
        'one did; put your own limit there'
    )


def _limit(item: Candidate, role: Role) -> None:
    """Give a quantity a resolution, and leave only the bounds that mean a danger."""
    members = item.family_seen or item.seen
    steps = list(item.entry.get('transform', []))
    low, high = min(seen.low for seen in members), max(seen.high for seen in members)
    median = max(seen.median for seen in members)
    if role.is_magnitude:
        steps = [*(step for step in steps if step != 'abs'), 'abs']
        low, high = (
            (0.0 if low <= 0.0 <= high else min(abs(low), abs(high))),
            max(abs(low), abs(high)),
        )
        median = max(seen.size for seen in members)
    step = max(nice_above((high - low) / role.steps), role.resolution)
    if role.side == 'above':
        step = max(step, nice_above(median / _FINEST))
    step = _roomy(step, role, members, low, high)
    item.entry['transform'] = [*steps, {'round': step}]
    if role.side == 'both':
        if role is ROLES['speed']:
            _allow_to_rest(item, step, low)
        return
    end = _on_grid(median, step, high if role.side == 'above' else low, role.side)
    if role.harmless > end and item.entry['unit'] == role.unit:
        end = float(f'{math.ceil(role.harmless / step - 1e-9) * step:.12g}')
    if role.is_magnitude and end <= 0.0:
        item.entry['bounds'] = [0, None]
        return
    ends = [end, None] if role.side == 'above' else [None, end]
    item.entry['transform'].append({'clip': ends})
    item.entry['bounds'] = ends
    way, other = ('less', 'below') if role.side == 'above' else ('more', 'above')
    _note(item, f'{way} than {end:g} counts as {end:g}, so that no rule is about values {other}')


def _on_grid(value: float, step: float, most: float, side: str) -> float:
    """Return the multiple of a step that is next to a value, and not beyond the largest or least.

    Args:
        value: about where.
        step: of the grid.
        most: the largest value for ``above``, else the least.
        side: on which side of the result values are told apart.
    """
    count = round(value / step)
    if side == 'above' and count * step > most:
        count -= 1
    elif side == 'below' and count * step < most:
        count += 1
    return float(f'{count * step:.12g}')


def _note(item: Candidate, note: str) -> None:
    item.remark = f'{item.remark}. {note[0].upper()}{note[1:]}' if item.remark else note


def _roomy(
    step: float, role: Role, seen: Sequence[FeatureStatistics], low: float, high: float
) -> float:
    """Return a step that leaves room beyond what was seen, as fine as it can be.

    Values are rounded to multiples of it, so a rule begins half a step beyond the last one. How
    much room there should be tells the recording itself: the less often a quantity goes to and fro,
    and the more the parts of the recording differ in how far it goes, the less is known of how far
    it goes in the next one.

    Args:
        step: the finest that is sensible.
        role: of the quantity.
        seen: all of its features.
        low: the least value, of magnitudes the least magnitude.
        high: the greatest.
    """
    span = high - low
    least = span / (2 + sum(item.swings for item in seen))
    wanted = [
        (end, sign, min(max(least, _surprise(seen, role, sign)), _MOST_ROOM * span))
        for end, sign, other in ((high, 1, 'below'), (low, -1, 'above'))
        if role.side != other
    ]

    def share(size: float) -> float:
        """How much of the room a step leaves, on the side with less of it."""
        shares = []
        for end, sign, room in wanted:
            left = (round(end / size) * sign + 0.5) * size - end * sign
            shares.append(left / max(room, _LEAST_ROOM * size))
        return min(shares)

    sizes = nice_between(step, max(span / _FEWEST_STEPS, step))
    return next((size for size in sizes if share(size) >= 1.0), max(sizes, key=share))


def _surprise(seen: Sequence[FeatureStatistics], role: Role, sign: int) -> float:
    """Return by how much the part of a recording that goes furthest does so beyond the others."""
    rooms = []
    for item in seen:
        ends = [
            max(abs(low), abs(high)) if role.is_magnitude else sign * (high if sign > 0 else low)
            for low, high in item.parts
        ]
        if ends:
            rooms.append(max(ends) - sorted(ends)[len(ends) // 2])
    return max(rooms, default=0.0)
