# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Feature values of recordings, row by row, ready to learn from or to check."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from occ_constraints_pkg.errors import DataError

# When a row's pace message was recorded, and which row of that message it is.
ORIGIN = np.dtype([('time_ns', np.int64), ('row', np.int32)])


@dataclass(frozen=True, eq=False)
class Dataset:
    """Rows of features with where each came from.

    Attributes:
        names: the features, in order (k of them).
        values: (n, k) float64; NaN where a value was missing or stale.
        stamps_ns: (n,) int64, the header stamp of the row's pace message, else its arrival; of a
            table file, the number of the row in the file, from 0.
        episodes: (n,) int64, the same number for rows of one recording, robot and episode.
        true_cost: (n,) float64, the simulated world's own cost, NaN for rows of recordings that
            lack it; None when all lack it.
        times_ns: (n,) int64, ns from the first message of the row's recording to the arrival of its
            pace message; where that is a table, from the first table, by their stamps, which are
            simulated time. None for table files.
        origins: (n,) of :data:`ORIGIN`; None for table files.
        recordings: (n,) int64, which of the sources each row comes from; None: all from the first.
        sources: :meth:`Recording.fingerprint` of each recording; of a table file ``name``,
            ``sha256`` and ``rows``.
        warnings: one sentence for each thing that was missing or damaged in a recording.

    Raises:
        OccError: the shapes do not fit together.
    """

    names: tuple[str, ...]
    values: np.ndarray
    stamps_ns: np.ndarray
    episodes: np.ndarray
    true_cost: np.ndarray | None = None
    times_ns: np.ndarray | None = None
    origins: np.ndarray | None = None
    recordings: np.ndarray | None = None
    sources: tuple[dict[str, Any], ...] = ()
    warnings: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        rows = len(self.stamps_ns)
        columns = [self.stamps_ns, self.episodes]
        more = (self.true_cost, self.times_ns, self.recordings, self.origins)
        columns += [column for column in more if column is not None]
        if self.values.shape != (rows, len(self.names)) or any(c.shape != (rows,) for c in columns):
            raise DataError(
                f'a dataset of {len(self.names)} features and {rows} stamps got values of shape '
                f'{self.values.shape} and columns of shapes {[c.shape for c in columns]}'
            )

    def __len__(self) -> int:
        return len(self.stamps_ns)

    def select(self, rows: np.ndarray) -> Dataset:
        """Return the rows of a (n,) bool mask, or of an array of row numbers."""
        columns = ('values', 'stamps_ns', 'episodes', 'true_cost')
        columns += ('times_ns', 'recordings', 'origins')
        chosen = {name: getattr(self, name) for name in columns}
        return replace(self, **{name: None if c is None else c[rows] for name, c in chosen.items()})

    @property
    def independent(self) -> np.ndarray:
        """(n,) int64, the same number for rows of episodes that depend on each other.

        Robots that were recorded at the same time meet the same traffic. So where any two episodes
        of a recording overlap in time, all of the recording is one; else, and in table files, each
        episode is one. Of a single recording only the episodes can be counted.
        """
        names, numbers = np.unique(self.episodes, return_inverse=True)
        if self.times_ns is None or self.recordings is None or len(self.sources) < 2:
            return numbers
        starts, ends = np.full(len(names), np.iinfo(np.int64).max), np.full(len(names), -1)
        np.minimum.at(starts, numbers, self.times_ns)
        np.maximum.at(ends, numbers, self.times_ns)
        recordings = np.zeros(len(names), dtype=np.int64)
        recordings[numbers] = self.recordings
        together = np.arange(len(names))
        for recording in np.unique(recordings):
            own = np.flatnonzero(recordings == recording)
            own = own[np.argsort(starts[own], kind='stable')]
            if (starts[own][1:] < np.maximum.accumulate(ends[own])[:-1]).any():
                together[own] = own[0]
        return together[numbers]

    def origin(self, row: int) -> dict[str, int]:
        """Return where a row came from, as plain values.

        ``source`` is a position in :attr:`sources`. Of a table file there is ``row``, its number
        in the file, from 0. Of a recording there are ``time_ns``, when the pace message was
        recorded, and ``row``, which row of the message it is.
        """
        source = 0 if self.recordings is None else int(self.recordings[row])
        if self.origins is None:
            return {'source': source, 'row': int(self.stamps_ns[row])}
        return {
            'source': source,
            'time_ns': int(self.origins['time_ns'][row]),
            'row': int(self.origins['row'][row]),
        }


def joined(parts: Sequence[Dataset]) -> Dataset:
    """Return data of the same features and kind, one below the other.

    Episodes and sources are numbered on; a true cost that a part lacks is NaN.

    Args:
        parts: at least one; each with times and origins, or none of them.
    """
    numbers, episodes, sources, rows = [], [], 0, 0
    for part in parts:
        own = np.zeros(len(part), dtype=np.int64) if part.recordings is None else part.recordings
        numbers.append(own + sources)
        sources += len(part.sources)
        # Within a part, episodes need not be numbered without gaps.
        _, own = np.unique(part.episodes, return_inverse=True)
        episodes.append(own.reshape(-1) + rows)
        rows = int(episodes[-1].max(initial=rows - 1)) + 1
    has_cost = any(part.true_cost is not None for part in parts)

    def column(name: str) -> np.ndarray | None:
        columns = [getattr(part, name) for part in parts]
        return None if columns[0] is None else np.concatenate(columns)

    costs = [
        np.full(len(part), np.nan) if part.true_cost is None else part.true_cost for part in parts
    ]
    return Dataset(
        parts[0].names,
        np.concatenate([part.values for part in parts]),
        np.concatenate([part.stamps_ns for part in parts]),
        np.concatenate(episodes),
        np.concatenate(costs) if has_cost else None,
        column('times_ns'),
        column('origins'),
        np.concatenate(numbers),
        tuple(source for part in parts for source in part.sources),
        tuple(warning for part in parts for warning in part.warnings),
    )


def without_repeats(data: Dataset, earlier: Dataset | None = None) -> tuple[Dataset, list[str]]:
    """Leave out rows that a source of the same content gave before.

    Counted twice, an episode would weigh twice, and could be both held out and learned from.
    Whether a source is the same is told by its hash, not by its name; two stretches of one
    recording that overlap share their rows only.

    Args:
        data: rows of recordings or tables, with the hashes of the sources.
        earlier: rows that count as given before.

    Returns:
        The rest, which may be empty, and a sentence for each source with repeated rows.
    """
    before = () if earlier is None else earlier.sources
    hashes = [source['sha256'] for source in (*before, *data.sources)]
    if len(set(hashes)) == len(hashes):
        return data, []
    given: dict[str, list[tuple[str, np.ndarray]]] = {}
    for index, source in enumerate(before):
        _remember(given, source, _identities(earlier)[_rows_of(earlier, index)])
    keep, sentences = np.ones(len(data), dtype=bool), []
    identities = _identities(data)
    for index, source in enumerate(data.sources):
        rows = np.flatnonzero(_rows_of(data, index))
        repeated = np.zeros(len(rows), dtype=bool)
        for _, known in given.get(source['sha256'], ()):
            repeated |= np.isin(identities[rows], known)
        if repeated.any():
            keep[rows[repeated]] = False
            name = given[source['sha256']][0][0]
            same = 'is given twice' if name == source['name'] else f'has the content of {name}'
            sentences.append(
                f'{source["name"]} {same}; its {int(repeated.sum())} repeated rows are left out'
            )
        _remember(given, source, identities[rows])
    if keep.all():
        return data, sentences
    rest = data.select(keep)
    numbers = np.zeros(len(rest), dtype=np.int64) if rest.recordings is None else rest.recordings
    left, numbers = np.unique(numbers, return_inverse=True)
    sources = tuple(data.sources[index] for index in left)
    return replace(rest, sources=sources, recordings=numbers.astype(np.int64)), sentences


def _remember(given: dict[str, list], source: dict, identities: np.ndarray) -> None:
    given.setdefault(source['sha256'], []).append((source['name'], identities))


def _rows_of(data: Dataset, source: int) -> np.ndarray:
    """Tell which rows come from a source: (n,) bool."""
    return np.ones(len(data), dtype=bool) if data.recordings is None else data.recordings == source


def _identities(data: Dataset) -> np.ndarray:
    """Return what tells a row from the others of its source: (n,)."""
    return data.stamps_ns if data.origins is None else data.origins
