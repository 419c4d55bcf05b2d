# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Manifests: lists of recordings with the parts to use, so that no bag need ever be rewritten."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from occ_constraints_pkg.datasets.table_files import is_table_file
from occ_constraints_pkg.documents import dump_yaml, load_schema, parse_yaml, read_text, validate
from occ_constraints_pkg.errors import ConfigurationError

SCHEMA = load_schema(__package__, 'manifest.schema.json')
_SUFFIXES = ('.yaml', '.yml')
_ENDLESS_NS = 2**63 - 1

Interval = tuple[int, int]
"""From and to, in ns from the first message; the end does not belong to it."""


@dataclass(frozen=True)
class Selection:
    """A recording and the parts of it to use.

    Attributes:
        path: the recording.
        include: the intervals to use; empty for all of it.
        exclude: intervals to leave out of these.
        episodes: ns from the first message at which a new episode begins.
    """

    path: Path
    include: tuple[Interval, ...] = ()
    exclude: tuple[Interval, ...] = ()
    episodes: tuple[int, ...] = ()

    def __fspath__(self) -> str:
        return str(self.path)

    def stretches(self, times_ns: np.ndarray) -> np.ndarray:
        """Tell which stretch each time lies in.

        A stretch is what is used without a gap and without the beginning of a new episode.

        Args:
            times_ns: (n,) int64, from the first message of the recording.

        Returns:
            (n,) int64: the stretch, from 0, or -1 where the recording is not used.
        """
        edges = {0, *self.episodes}
        edges.update(edge for interval in (*self.include, *self.exclude) for edge in interval)
        ordered = sorted(edges)
        numbers, number, used_before = [], -1, False
        for edge in ordered:
            used = self._uses(edge)
            number += used and (not used_before or edge in self.episodes)
            numbers.append(number if used else -1)
            used_before = used
        return np.array(numbers)[np.searchsorted(ordered, times_ns, side='right') - 1]

    def _uses(self, time: int) -> bool:
        included = not self.include or any(low <= time < high for low, high in self.include)
        return included and not any(low <= time < high for low, high in self.exclude)

    def to_document(self) -> dict[str, Any]:
        """Return what restricts the recording, as a manifest says it; empty for all of it."""
        document: dict[str, Any] = {}
        for key in ('include', 'exclude'):
            intervals = [
                [low / 1e9, None if high == _ENDLESS_NS else high / 1e9]
                for low, high in getattr(self, key)
            ]
            document.update({key: intervals} if intervals else {})
        if self.episodes:
            document['episodes'] = [time / 1e9 for time in self.episodes]
        return document


def select(paths: Sequence[str | Path | Selection]) -> list[Selection]:
    """Return the recordings that paths name, those that a manifest lists in its place.

    Args:
        paths: recordings, and manifests (files that end in .yaml or .yml); what is a selection
            already stays one.

    Raises:
        OccError: a manifest cannot be read or is wrong.
    """
    selections = []
    for path in paths:
        if isinstance(path, Selection):
            selections.append(path)
        elif Path(path).suffix in _SUFFIXES and not os.path.isdir(path):
            selections += load_manifest(path)
        else:
            selections.append(Selection(Path(path)))
    return selections


def dump_manifest(selections: Sequence[Selection], notes: Sequence[str], folder: Path) -> str:
    """Return the text of a manifest.

    Args:
        selections: the recordings, and the parts of them to use.
        notes: a note on each, empty for none.
        folder: where the manifest will be, which its paths are relative to.
    """
    entries = [
        {
            'path': Path(os.path.relpath(selection.path, folder)).as_posix(),
            **selection.to_document(),
            **({'note': note} if note else {}),
        }
        for selection, note in zip(selections, notes, strict=True)
    ]
    return dump_yaml({'schema_version': 1, 'recordings': entries})


def load_manifest(path: str | Path) -> list[Selection]:
    """Load a manifest.

    Raises:
        OccError: it cannot be read, breaks the schema, or lists what is no recording.
    """
    text = read_text(path)
    document = parse_yaml(text, str(path))
    if isinstance(document, dict) and 'rosbag2_bagfile_information' in document:
        raise ConfigurationError(
            f'{path} is the metadata of a recording, not a manifest; give its directory instead'
        )
    if isinstance(document, dict) and {'features', 'rules'} & document.keys():
        raise ConfigurationError(
            f'{path} is not a recording, nor a manifest that lists some, but '
            + ('constraints (-c)' if 'rules' in document else 'a feature map (-m)')
        )
    validate(document, SCHEMA, str(path), text=text)
    return [
        _selection(entry, Path(path).parent, f'{path}: recordings[{number}]')
        for number, entry in enumerate(document['recordings'])
    ]


def _selection(entry: Mapping[str, Any], folder: Path, where: str) -> Selection:
    path = folder / entry['path']
    if is_table_file(path) or path.suffix in _SUFFIXES:
        raise ConfigurationError(
            f'{where}.path: got {entry["path"]!r}; allowed are rosbag2 directories and files '
            'that end in .mcap or .db3'
        )
    times = [time for key in ('include', 'exclude') for item in entry.get(key, ()) for time in item]
    if any(time is not None and math.isnan(time) for time in (*times, *entry.get('episodes', ()))):
        raise ConfigurationError(f'{where}: got nan for a time; allowed are seconds from 0 to 1e9')
    intervals = {}
    for key in ('include', 'exclude'):
        intervals[key] = tuple(
            (0 if low is None else _ns(low), _ENDLESS_NS if high is None else _ns(high))
            for low, high in entry.get(key, ())
        )
        for number, (low, high) in enumerate(intervals[key]):
            if low >= high:
                got = entry[key][number]
                raise ConfigurationError(
                    f'{where}.{key}[{number}]: got {got}; allowed is an end after the beginning'
                )
    return Selection(path, **intervals, episodes=tuple(map(_ns, entry.get('episodes', ()))))


def _ns(seconds: float) -> int:
    return round(seconds * 1e9)
