# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The same recording given twice: its rows are counted once."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from occ_constraints_pkg.datasets.dataset import Dataset


def without_repeats(data: Dataset, earlier: Dataset | None = None) -> tuple[Dataset, list[str]]:
    """Leave out rows that a source of the same content gave before.

    Counted twice, a drive would weigh twice, and lie among the held-out episodes and among those
    that are learned from. Whether a source is the same is told by its hash, not by its name; two
    stretches of one recording that overlap share their rows only.

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
    for place, source in enumerate(before):
        _remember(given, source, _identities(earlier)[_rows_of(earlier, place)])
    keep, sentences = np.ones(len(data), dtype=bool), []
    identities = _identities(data)
    for place, source in enumerate(data.sources):
        rows = np.flatnonzero(_rows_of(data, place))
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
    sources = tuple(data.sources[place] for place in left)
    return replace(rest, sources=sources, recordings=numbers.astype(np.int64)), sentences


def _remember(given: dict[str, list], source: dict, identities: np.ndarray) -> None:
    given.setdefault(source['sha256'], []).append((source['name'], identities))


def _rows_of(data: Dataset, place: int) -> np.ndarray:
    """Tell which rows come from a source: (n,) bool."""
    return np.ones(len(data), dtype=bool) if data.recordings is None else data.recordings == place


def _identities(data: Dataset) -> np.ndarray:
    """Return what tells a row from the others of its source: (n,)."""
    return data.stamps_ns if data.origins is None else data.origins
