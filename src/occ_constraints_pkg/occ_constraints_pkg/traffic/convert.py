# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""From a recording of traffic in one of the formats to a bag."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from importlib import import_module
from pathlib import Path

from occ_constraints_pkg import __version__
from occ_constraints_pkg.errors import DataError
from occ_constraints_pkg.features.feature_map import load_feature_map
from occ_constraints_pkg.files import sha256_of
from occ_constraints_pkg.traffic.formats import FORMATS
from occ_constraints_pkg.traffic.recorded import trajectories_of
from occ_constraints_pkg.traffic.trajectories import Trajectories, write_trajectories

_MAPS = ('highway', 'highway_road', 'highway_following')


@dataclass(frozen=True)
class Imported:
    """What was written.

    Attributes:
        trajectories: number of vehicles, each an episode.
        rows: number of messages.
        seconds: how long the vehicles were recorded, all together.
        features: their names.
        feature_map: the built-in map of these features.
        warnings: one sentence for each thing that was left out.
    """

    trajectories: int
    rows: int
    seconds: float
    features: tuple[str, ...]
    feature_map: str
    warnings: tuple[str, ...]


def import_trajectories(
    format_name: str,
    path: str | Path,
    output: str | Path,
    *,
    keep_gaps: bool = False,
    progress: Callable[[int, int], None] | None = None,
) -> Imported:
    """Write the trajectories of a recording of traffic to a new bag.

    Args:
        format_name: one of :data:`~occ_constraints_pkg.traffic.formats.FORMATS`.
        path: what is read.
        output: directory of the bag; it must not exist.
        keep_gaps: write gaps between vehicles even if these were not on the road together.
        progress: called with (done, total), first while reading and then while writing.

    Raises:
        OccError: the input is not of that format or is damaged, or the bag cannot be written; then
            nothing is.
    """
    if Path(output).exists():
        raise DataError(f'{output} exists already; allowed is a new directory for each recording')
    trajectories = read_trajectories(format_name, path, keep_gaps=keep_gaps, progress=progress)
    write_trajectories(trajectories, Path(output), progress=progress)
    seconds = (trajectories.stamps_ns[-1] - trajectories.start_ns) / 1e9 - (
        len(trajectories.beginnings) - 1
    )
    return Imported(
        trajectories=len(trajectories.beginnings),
        rows=len(trajectories.time),
        seconds=round(float(seconds), 3),
        features=trajectories.names,
        feature_map=next(
            name for name in _MAPS if load_feature_map(name).names == trajectories.names
        ),
        warnings=trajectories.warnings,
    )


def read_trajectories(
    format_name: str,
    path: str | Path,
    *,
    keep_gaps: bool = False,
    progress: Callable[[int, int], None] | None = None,
) -> Trajectories:
    """Read the trajectories of a recording of traffic.

    Takes the same arguments as :func:`import_trajectories`.

    Raises:
        OccError: the input is not of that format or is damaged.
    """
    if format_name not in FORMATS:
        raise DataError(f'got the format {format_name!r}; allowed are {", ".join(FORMATS)}')
    chosen, path = FORMATS[format_name], Path(path)
    if keep_gaps and not chosen.shows_traffic:
        raise DataError(f'the format {format_name} shows one car, so there are no gaps to keep')
    module = import_module(f'{__package__}.{chosen.reader.removeprefix("read_")}')
    found = getattr(module, chosen.reader)(path, progress)
    trajectories = (
        trajectories_of(found, str(path), keep_gaps=keep_gaps) if chosen.shows_traffic else found
    )
    said = {'format': format_name, 'file': path.absolute().name, 'licence': chosen.licence}
    if path.is_file():
        said['sha256'] = sha256_of([path])
    said['imported_by'] = f'occ_constraints {__version__}'
    return replace(trajectories, source={**said, **trajectories.source})
