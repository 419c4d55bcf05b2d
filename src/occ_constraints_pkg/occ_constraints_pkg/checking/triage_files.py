# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Triage of files: what is read, and what is written of those that stand out."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from urllib.parse import quote, urlencode

import numpy as np

from occ_constraints_pkg.checking.peaks import peak_space, peaks_of
from occ_constraints_pkg.checking.triage import Ranked, Triage, Unit
from occ_constraints_pkg.checking.triage_text import reason
from occ_constraints_pkg.checking.unchanged import unchanged_for, with_raw_values
from occ_constraints_pkg.datasets.dataset import Dataset
from occ_constraints_pkg.datasets.each import in_processes
from occ_constraints_pkg.datasets.extraction import extract
from occ_constraints_pkg.datasets.folders import named_sources
from occ_constraints_pkg.datasets.manifest import Selection, dump_manifest
from occ_constraints_pkg.datasets.table_files import are_table_files, read_tables
from occ_constraints_pkg.errors import ConfigurationError, DataError, OccError
from occ_constraints_pkg.features.feature_map import FeatureMap
from occ_constraints_pkg.rosbag.clips import write_clip
from occ_constraints_pkg.rosbag.recording import Recording
from occ_constraints_pkg.rules.space import FeatureSpace
from occ_constraints_pkg.terminal import printable

CLIP_SECONDS = 3.0
"""How much of a recording a clip shows before and after the worst moment."""

# What the next learning leaves out around a stretch that leaves the rules.
_AROUND_NS = 1_000_000_000
# A recording of which a larger share is to be left out is left out as a whole.
_MOST_LEFT_OUT = 0.5
_VIEWER = 'https://app.foxglove.dev/~/view'


@dataclass(frozen=True, eq=False)
class Found:
    """What was read.

    Attributes:
        units: recordings, or episodes of tables.
        space: their features.
        peaks: the features of their peaks; ``None`` where there are none.
        unreadable: name and path of what cannot be used, and why.
        sources: by path, what was selected of it.
        are_tables: whether they are tables.
    """

    units: tuple[Unit, ...]
    space: FeatureSpace
    peaks: FeatureSpace | None
    unreadable: tuple[tuple[str, str, str], ...]
    sources: tuple[tuple[str, Path | Selection], ...]
    are_tables: bool


def read_units(
    paths: Sequence[str | Path],
    feature_map: FeatureMap | None,
    *,
    processes: int,
    progress: Callable[[int, int], None] | None = None,
) -> Found:
    """Read recordings or tables, each once; what cannot be used is put aside.

    Args:
        paths: recordings, tables, manifests, and folders of them.
        feature_map: what to extract; of tables, ``None`` reads every column.
        processes: how many work at a time.
        progress: called with (files done, files in all).

    Raises:
        OccError: a path leads nowhere, tables and recordings are mixed, recordings have no feature
            map, or nothing can be used.
    """
    sources = tuple(source for path in paths for source in named_sources(path))
    are_tables = are_table_files([source for _, source in sources])
    if not are_tables and feature_map is None:
        raise DataError('recordings need a feature map: -m FILE or a name')
    unreadable: list[tuple[str, str, str]] = []
    units: list[Unit] = []
    space = None if feature_map is None else feature_map.space
    if are_tables:
        for place, (name, path) in enumerate(sources):
            try:
                data, space = read_tables([path], space)
            except OccError as error:
                unreadable.append((name, str(path), str(error)))
            else:
                units += _episodes(name, str(path), data, space)
            if progress is not None:
                progress(place + 1, len(sources))
    else:
        assert feature_map is not None
        read = in_processes(
            partial(_read_recording, feature_map=feature_map), sources, processes, progress
        )
        for (name, source), found in zip(sources, read, strict=True):
            if isinstance(found, str):
                unreadable.append((name, str(Path(source)), found))
            else:
                units.append(found)
    if space is None:
        name, _, sentence = unreadable[0]
        raise DataError(f'nothing can be used; {name}: {sentence}')
    peaks = None if are_tables or feature_map is None else peak_space(feature_map)
    return Found(tuple(units), space, peaks, tuple(unreadable), sources, are_tables)


def _read_recording(named: tuple[str, Path | Selection], feature_map: FeatureMap) -> Unit | str:
    """Read a recording; return a sentence if it cannot be used."""
    name, source = named
    path = str(Path(source))
    try:
        data = extract([source], with_raw_values(feature_map), provenance=False)
        peaks = peaks_of(source, data, feature_map)
    except OccError as error:
        return str(error)
    except OSError as error:
        return f'cannot read {path}: {error.strerror or error}'
    return Unit(name, path, data, unchanged_for(data, feature_map.space), peaks)


def _episodes(name: str, path: str, data: Dataset, space: FeatureSpace) -> list[Unit]:
    """Return the episodes of a table; all of it if it does not tell any apart."""
    numbers = np.unique(data.episodes)
    units = []
    for place, number in enumerate(numbers.tolist()):
        own = data if len(numbers) == 1 else data.select(data.episodes == number)
        title = name if len(numbers) == 1 else f'{name} episode {place}'
        nothing = np.empty((len(own), 0))
        units.append(Unit(title, path, own, unchanged_for(own, space), nothing))
    return units


def clip_of(item: Ranked, rank: int, folder: Path, seconds: float) -> Path:
    """Write what was recorded around a recording's worst moment; return the MCAP file.

    Raises:
        OccError: the recording is damaged there, or the clip exists or cannot be written.
    """
    assert item.log_time_ns is not None
    name = re.sub(r'[^\w.-]+', '_', item.name)
    around = round(seconds * 1e9)
    path, _ = write_clip(
        Recording(item.path),
        folder / f'{rank:02}_{name}_{item.moment:.0f}s',
        item.log_time_ns - around,
        item.log_time_ns + around,
    )
    return path


def foxglove_link(base: str, path: Path, time_ns: int) -> str:
    """Return the address that opens Foxglove on a file at a moment.

    Args:
        base: where the files are served, by a server that knows byte ranges and CORS.
        path: of the file, as seen from there.
        time_ns: since the epoch.
    """
    seconds, rest = divmod(time_ns, 10**9)
    time = f'{datetime.fromtimestamp(seconds, UTC):%Y-%m-%dT%H:%M:%S}.{rest:09}Z'
    url = f'{base.rstrip("/")}/{quote(path.as_posix().lstrip("/"))}'
    return f'{_VIEWER}?{urlencode({"ds": "remote-file", "ds.url": url, "time": time})}'


def file_at(item: Ranked) -> Path:
    """Return the storage file of a recording that holds its worst moment."""
    assert item.log_time_ns is not None
    return Recording(item.path).file_at(item.log_time_ns)


def manifest_without(found: Found, result: Triage, folder: Path) -> str:
    """Return a manifest of what to learn from: all but what stands out, or cannot be used.

    Of a recording that stands out, the stretches that leave the rules are excluded, with a second
    on both sides; all of it where that is more than half.

    Args:
        found: what was read.
        result: the ranking.
        folder: where the manifest will be, which its paths are relative to.

    Raises:
        ConfigurationError: there are tables, which manifests do not list, or nothing is left.
    """
    if found.are_tables:
        raise ConfigurationError(
            'manifests list recordings and no tables; allowed with tables is the list that --json '
            'prints'
        )
    ranked = {(item.path, item.name): item for item in result.ranked}
    left_out = [f'{name}: {sentence}' for name, _, sentence in result.unreadable]
    selections, notes = [], []
    for name, source in found.sources:
        item = ranked.get((str(Path(source)), name))
        if item is None:
            continue
        selection = source if isinstance(source, Selection) else Selection(source)
        if item.stands_out:
            told = f'score {item.score:.3g}, {reason(item, result)}'
            more = _stretches(item)
            lasting = sum(high - low for low, high in more) * 1e-9
            if not more or lasting > _MOST_LEFT_OUT * item.duration:
                left_out.append(f'{name}: {told}')
                continue
            selection = replace(selection, exclude=(*selection.exclude, *more))
        selections.append(selection)
        notes.append(f'triage: {told}' if item.stands_out else '')
    if not selections:
        raise ConfigurationError('the manifest would be empty: everything is to be left out')
    comments = ['Written by occ triage: what to learn from.']
    comments += [f'left out: {text}' for text in left_out]
    header = ''.join(f'# {printable(text)}\n' for text in comments)
    return header + dump_manifest(selections, notes, folder)


def _stretches(item: Ranked) -> list[tuple[int, int]]:
    """Return what to leave out of a recording, in ns from its first message."""
    start = Recording(item.path).start_ns
    wanted = sorted(
        (max(0, event.first_ns - start - _AROUND_NS), event.last_ns - start + _AROUND_NS)
        for event in item.events
        if event.first_ns is not None and event.last_ns is not None
    )
    merged: list[tuple[int, int]] = []
    for low, high in wanted:
        if merged and low <= merged[-1][1]:
            merged[-1] = merged[-1][0], max(high, merged[-1][1])
        else:
            merged.append((low, high))
    return merged
