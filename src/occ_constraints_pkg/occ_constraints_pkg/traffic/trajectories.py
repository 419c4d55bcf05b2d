# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Trajectories of recorded vehicles, and their way into a bag: one episode for each vehicle."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from occ_constraints_pkg.errors import DataError, OccError
from occ_constraints_pkg.features.table_messages import TABLE_TYPE, TableSerializer
from occ_constraints_pkg.rosbag.writer import BagWriter

TOPIC, FRAME = '/observation', 'road'
# Written beside the features: who drove, and when, by the clock of the source.
OWN_COLUMNS = ('vehicle', 'time', 'episode')
_PAUSE_NS = 10**9
_REPORT_EVERY = 2000


@dataclass(frozen=True, eq=False)
class Trajectories:
    """What vehicles did, row by row, each vehicle's rows together and in order of time.

    Attributes:
        names: the features (k of them).
        values: (n, k) float64; all finite.
        vehicle: (n,) int64, the number that the source gives the vehicle.
        time: (n,) float64, seconds by the clock of the source.
        source: what the bag says of its origin, by key.
        warnings: one sentence for each thing that was left out.
        start_ns: stamp of the first row. Without a date in the source it is 1 s, since 0 means
            that there is no stamp.
    """

    names: tuple[str, ...]
    values: np.ndarray
    vehicle: np.ndarray
    time: np.ndarray
    source: Mapping[str, str] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()
    start_ns: int = 10**9

    def __post_init__(self) -> None:
        rows = len(self.vehicle)
        if self.values.shape != (rows, len(self.names)) or self.time.shape != (rows,):
            raise DataError(
                f'trajectories of {rows} rows and {len(self.names)} features got values of shape '
                f'{self.values.shape} and times of shape {self.time.shape}'
            )

    @property
    def beginnings(self) -> np.ndarray:
        """(vehicles,) int64: the first row of each vehicle."""
        return np.flatnonzero(np.diff(self.vehicle, prepend=self.vehicle[:1] - 1))

    @property
    def stamps_ns(self) -> np.ndarray:
        """(n,) int64: the vehicles one after the other, as one robot would drive its episodes.

        Within a vehicle they are as far apart as in the source; a second passes between two.
        """
        ends = np.append(self.beginnings[1:], len(self.time))
        stamps = np.empty(len(self.time), dtype=np.int64)
        clock = self.start_ns
        for begin, end in zip(self.beginnings, ends, strict=True):
            since = np.round((self.time[begin:end] - self.time[begin]) * 1e9).astype(np.int64)
            stamps[begin:end] = clock + since
            clock = int(stamps[end - 1]) + _PAUSE_NS
        return stamps


def write_trajectories(
    trajectories: Trajectories,
    directory: Path,
    *,
    progress: Callable[[int, int], None] | None = None,
) -> None:
    """Write trajectories to a new bag, which is there as a whole or not at all.

    Every row is one message of the topic ``observation``: a table with the features and
    :data:`OWN_COLUMNS`. What :attr:`Trajectories.source` says stands under ``custom_data`` in the
    bag's metadata.

    Args:
        trajectories: at least one row.
        directory: of the bag; it must not exist.
        progress: called with (rows written, rows in all).

    Raises:
        OccError: the directory exists or cannot be written.
    """
    directory = Path(directory)
    if directory.exists() or directory.is_symlink():
        raise DataError(
            f'{directory} exists already; allowed is a new directory for each recording'
        )
    # A bag's files are named after its directory, so it is written under its own name elsewhere.
    aside = directory.absolute().parent / f'.{directory.name}.{os.getpid()}'
    try:
        aside.mkdir(parents=True)
        _write(trajectories, aside / directory.name, progress)
        os.rename(aside / directory.name, directory)
    except OSError as error:
        raise DataError(f'cannot write {directory}: {error.strerror or error}') from error
    except OccError as error:
        # The writer says that what it wrote is kept, which is not so here.
        reason = getattr(error.__cause__, 'strerror', None)
        raise DataError(f'cannot write {directory}: {reason}') if reason else error from error
    finally:
        shutil.rmtree(aside, ignore_errors=True)


def _write(
    trajectories: Trajectories, directory: Path, progress: Callable[[int, int], None] | None
) -> None:
    episode = np.zeros(len(trajectories.time))
    episode[trajectories.beginnings[1:]] = 1.0
    own = np.stack([trajectories.vehicle, trajectories.time, np.cumsum(episode)], axis=1)
    rows = np.concatenate([trajectories.values, own], axis=1)
    serializer = TableSerializer((*trajectories.names, *OWN_COLUMNS), FRAME)
    stamps = trajectories.stamps_ns.tolist()
    with BagWriter(directory, custom_data=trajectories.source) as bag:
        for number, (row, stamp) in enumerate(zip(rows, stamps, strict=True)):
            bag.write(TOPIC, TABLE_TYPE, serializer.serialize(row, stamp), stamp)
            if progress is not None and number % _REPORT_EVERY == 0:
                progress(number, len(rows))
    if progress is not None:
        progress(len(rows), len(rows))
