# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The formats of recorded traffic that can be imported."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Format:
    """A format that can be imported.

    Attributes:
        reader: function of the module of the same name without ``read_``.
        shows_traffic: whether it shows all vehicles of a road, and not one car alone.
        input: what there is to read, for people.
        licence: under what the data of this format are published.
    """

    reader: str
    shows_traffic: bool
    input: str
    licence: str


FORMATS = {
    'commonroad': Format(
        'read_commonroad',
        True,
        'scenario of a highway, XML 2018b or 2020a',
        'that of the source; CommonRoad publishes its scenarios under BSD-3-Clause',
    ),
    'ngsim-sqlite': Format(
        'read_ngsim_sqlite',
        True,
        'traffic history of SMARTS made from NGSIM, .shf',
        'that of the source; NGSIM is public domain, SMARTS is under MIT',
    ),
    'comma2k19': Format(
        'read_comma2k19',
        False,
        'directory of a segment',
        'that of the source; comma2k19 is published under MIT',
    ),
    'highd': Format(
        'read_highd',
        True,
        'XX_tracks.csv, the other two files beside it',
        'that of the source; highD is for non-commercial use and must not be passed on',
    ),
}
"""What ``occ import`` reads, by the name it has there."""
