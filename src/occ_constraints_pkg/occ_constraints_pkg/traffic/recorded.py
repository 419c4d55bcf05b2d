# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Recorded traffic on one or more carriageways, and the ten features of each vehicle in it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from occ_constraints_pkg.traffic.trajectories import Trajectories

GAPS = tuple(f'p_rel{place}' for place in range(6))
FEATURES = ('v_x', 'v_y', *GAPS, 'd_left', 'd_right')
"""The features of the built-in feature map ``highway``, in its order."""

FARTHEST = 500.0
"""Gap in metres that stands for no neighbour; none is farther."""

# Tracking from above now and then sees one vehicle twice.
_MOST_INSIDE = 0.05


@dataclass(frozen=True, eq=False)
class Traffic:
    """Vehicles in the frame of their road, row by row.

    Attributes:
        vehicle: (n,) int64, the number that the source gives the vehicle.
        time: (n,) float64, seconds by the clock of the source.
        v_x: (n,) m/s along the road, in the direction of travel.
        v_y: (n,) m/s, to the left.
        gaps: (n, 6) metres between the boxes of the vehicle and of its neighbours p_rel0 to 5;
            below 0 where the two overlap along the road, infinite where there is none.
        inside: (n,) bool, whether the vehicle is at the place of another one.
        d_left: (n,) metres from the centre to the left edge of the leftmost lane.
        d_right: (n,) metres to the right edge of the rightmost lane.
        source: what the bag says of its origin, by key.
        warnings: one sentence for each thing that was left out.
    """

    vehicle: np.ndarray
    time: np.ndarray
    v_x: np.ndarray
    v_y: np.ndarray
    gaps: np.ndarray
    inside: np.ndarray
    d_left: np.ndarray
    d_right: np.ndarray
    source: Mapping[str, str] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()


def trajectories_of(traffic: Traffic, where: str, *, keep_gaps: bool = False) -> Trajectories:
    """Return the trajectories of the vehicles with their features.

    The gaps are left out, with a warning, where vehicles are at the place of others in more than
    5 % of the rows: such a recording shows vehicles together that were not on the road together,
    so its gaps are none.

    Args:
        traffic: at least one row.
        where: what the warning calls the recording.
        keep_gaps: keep them nevertheless.
    """
    order = np.lexsort((traffic.time, traffic.vehicle))
    gaps = np.clip(traffic.gaps, 0.0, FARTHEST)
    table = dict(
        zip(
            FEATURES,
            (traffic.v_x, traffic.v_y, *gaps.T, traffic.d_left, traffic.d_right),
            strict=True,
        )
    )
    warnings = list(traffic.warnings)
    inside = float(traffic.inside.mean())
    if inside > _MOST_INSIDE:
        sentence = (
            f'{where}: in {inside:.0%} of the rows a vehicle is at the place of another one, '
            'so they were not on the road at the same time'
        )
        if keep_gaps:
            sentence += f'; the gaps {GAPS[0]} to {GAPS[-1]} are kept as asked, but show nothing'
        else:
            sentence += f'; the gaps {GAPS[0]} to {GAPS[-1]} are left out'
            table = {name: column for name, column in table.items() if name not in GAPS}
        warnings.append(sentence)
    return Trajectories(
        names=tuple(table),
        values=np.stack(list(table.values()), axis=1)[order],
        vehicle=traffic.vehicle[order],
        time=traffic.time[order],
        source=traffic.source,
        warnings=tuple(warnings),
    )
