# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Data that never was a bag: ``.npz``, ``.csv`` and ``.parquet`` files as a :class:`Dataset`."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from os import PathLike, fspath
from pathlib import Path

import numpy as np

from occ_constraints_pkg.archives import array_names, read_arrays
from occ_constraints_pkg.datasets.csv_cells import parse_cells, parse_quickly
from occ_constraints_pkg.datasets.dataset import Dataset
from occ_constraints_pkg.documents import did_you_mean
from occ_constraints_pkg.errors import DataError, OccError
from occ_constraints_pkg.files import open_regular, sha256_of
from occ_constraints_pkg.rules.space import Feature, FeatureSpace

# Columns that are no features. Tables of a simulation call the cost `true_cost`, as its topics do.
_EPISODE, _COSTS = 'episode', ('cost', 'true_cost')
_NPZ_ARRAYS = ('features', 'names', 'units', 'families', 'bounds', _EPISODE, *_COSTS)
# Arrays that say of features what their values do not, with one entry for each.
_DESCRIBING = {
    'names': 'text',
    'bounds': 'the smallest and largest possible value, infinite for none',
    'families': 'the same text for all directions of one sensor, empty for none',
}


@dataclass(frozen=True, eq=False)
class _Content:
    """The part of one file that was asked for.

    Attributes:
        features: name of each column that is a feature, with what the file knows of it; the unit
            is empty where the file does not say.
        values: (n, k) float64.
        episode: (n,) float64, None where the file does not tell episodes apart.
        cost: (n,) float64, None where the file has none.
        missing: keys of :data:`_DESCRIBING` that an archive lacks.
    """

    features: tuple[Feature, ...]
    values: np.ndarray
    episode: np.ndarray | None
    cost: np.ndarray | None
    missing: tuple[str, ...] = ()


def is_table_file(path: str | PathLike[str]) -> bool:
    """Tell by its name whether a path is a table file and not a recording."""
    return Path(path).suffix in _READERS and not Path(path).is_dir()


def are_table_files(paths: Sequence[str | PathLike[str]]) -> bool:
    """Tell whether data are table files (True) or recordings (False).

    Raises:
        OccError: some are tables and some are not.
    """
    tables = [path for path in paths if is_table_file(path)]
    if tables and len(tables) < len(paths):
        other = next(path for path in paths if path not in tables)
        raise DataError(
            f'got the table {fspath(tables[0])} and the recording {fspath(other)}; '
            'allowed are tables only or recordings only'
        )
    return bool(tables)


def read_tables(
    paths: Sequence[str | PathLike[str]], space: FeatureSpace | None = None
) -> tuple[Dataset, FeatureSpace]:
    """Read table files, one below the other.

    ``.npz``: ``features`` of shape (rows, k) or (episodes, rows, k); optional ``names``, ``units``
    and ``families`` (k), ``bounds`` (k, 2) with infinities for none, ``cost`` of one number per
    row, and, where ``features`` has two axes, ``episode`` of one number per row. Without names the
    features are called x0, x1 and so on. Pickled objects are refused. ``.csv`` and ``.parquet``:
    every column is a feature but ``episode`` and ``cost``; an empty cell is a missing value. A
    cost may be called ``true_cost`` too. A file that does not tell episodes apart is one episode.

    Args:
        paths: files that end in .npz, .csv or .parquet.
        space: the features to look for, by name; other columns are not read. None: all columns
            of the first file, which every other must have too.

    Returns:
        The rows, and the feature space of its columns: ``space``, or that of the first file. The
        stamp of a row is its number in its file, from 0. Without ``space``, a warning says what
        describes the features of an archive that does not name them.

    Raises:
        OccError: a file cannot be read, lacks a feature, holds text where a number should be, has
            no rows, or states another unit than ``space``.
    """
    episodes, contents, warnings = [], [], []
    for path in map(Path, paths):
        content = _read(path, None if space is None else space.names)
        if not len(content.values):
            raise DataError(f'{path} has no rows; allowed are one or more')
        if space is None:
            space = _space(content.features, path)
            warnings += _not_named(content, path)
        contents.append(_in_order(content, space, path))
        numbers = np.zeros(len(content.values)) if content.episode is None else content.episode
        if not np.isfinite(numbers).all():
            raise DataError(f'{path} has values that are not finite in the column {_EPISODE!r}')
        unique, inverse = np.unique(numbers, return_inverse=True)
        first = 0 if not episodes else int(episodes[-1].max()) + 1
        episodes.append(inverse.reshape(-1).astype(np.int64) + first)
    if space is None:
        raise DataError('there are no tables to read; allowed are one or more')
    counts = [len(content.values) for content in contents]
    costs = [
        np.full(count, np.nan) if content.cost is None else content.cost
        for content, count in zip(contents, counts, strict=True)
    ]
    data = Dataset(
        names=space.names,
        # One file, which may be large, needs no copy.
        values=contents[0].values
        if len(contents) == 1
        else np.concatenate([content.values for content in contents]),
        stamps_ns=np.concatenate([np.arange(count, dtype=np.int64) for count in counts]),
        episodes=np.concatenate(episodes),
        true_cost=np.concatenate(costs) if any(c.cost is not None for c in contents) else None,
        recordings=np.repeat(np.arange(len(counts)), counts),
        sources=tuple(
            {'name': Path(path).name, 'sha256': sha256_of([Path(path)]), 'rows': count}
            for path, count in zip(paths, counts, strict=True)
        ),
        warnings=tuple(warnings),
    )
    return data, space


def _read(path: Path, wanted: Collection[str] | None) -> _Content:
    reader = _READERS.get(path.suffix)
    if reader is None:
        raise DataError(f'{path} is not a table; allowed are files that end in {TABLE_ENDINGS}')
    try:
        return reader(path, wanted)
    except OSError as error:
        raise DataError(f'cannot read {path}: {error.strerror or error}') from error


def _space(features: tuple[Feature, ...], path: Path) -> FeatureSpace:
    if any(not feature.name for feature in features):
        raise DataError(
            f'{path} has a column without a name, which would be a feature; '
            'allowed is a name for each, or to delete the column'
        )
    try:
        return FeatureSpace(tuple(replace(item, unit=item.unit or '1') for item in features))
    except OccError as error:
        raise DataError(f'{path}: {error}') from error


def _not_named(content: _Content, path: Path) -> list[str]:
    """Return what would describe the features of an archive that does not name them."""
    if 'names' not in content.missing:
        return []
    count = len(content.features)
    called = 'x0' if count == 1 else f'x0 ... x{count - 1}'
    arrays = '; '.join(f'{name!r}: {_DESCRIBING[name]}' for name in content.missing)
    return [
        f'{path} does not describe its features, here called {called}, so rules know neither '
        f'their physical bounds nor which of them belong together; add arrays to it ({arrays})'
    ]


def _in_order(content: _Content, space: FeatureSpace, path: Path) -> _Content:
    """Return the content with the columns of a space, found by name."""
    names = [feature.name for feature in content.features]
    for feature in space.features:
        _require(feature.name, names, path)
        unit = content.features[names.index(feature.name)].unit
        if unit not in ('', feature.unit):
            raise DataError(
                f'{path} states the unit {unit!r} for the feature {feature.name!r}; '
                f'allowed here is {feature.unit!r}'
            )
    if names == list(space.names):
        return content
    order = [names.index(name) for name in space.names]
    return _Content(space.features, content.values[:, order], content.episode, content.cost)


def _require(name: str, names: Sequence[str], path: Path) -> None:
    if name not in names:
        hint = did_you_mean(name, names) or ';'
        raise DataError(f'{path} has no column {name!r}{hint} its columns are {", ".join(names)}')


def _cost_name(names: Collection[str], path: Path) -> str | None:
    found = [name for name in _COSTS if name in names]
    if len(found) > 1:
        raise DataError(f'{path} has both {_COSTS[0]!r} and {_COSTS[1]!r}; allowed is one of them')
    return found[0] if found else None


def _read_npz(path: Path, _wanted: Collection[str] | None) -> _Content:
    arrays = read_arrays(path, _NPZ_ARRAYS.__contains__)
    if 'features' not in arrays:
        raise DataError(
            f"{path} has no array 'features' of shape (rows, k) or (episodes, rows, k); "
            f'its arrays are {", ".join(array_names(path))}'
        )
    cost = _cost_name(arrays, path)
    values = _numbers(arrays['features'], f"{path}: 'features'")
    if values.ndim not in (2, 3) or not values.shape[-1]:
        raise DataError(
            f"{path}: 'features' has the shape {values.shape}; "
            'allowed are (rows, k) and (episodes, rows, k)'
        )
    shape, width = values.shape[:-1], values.shape[-1]
    features = _npz_features(arrays, width, path)
    columns = {}
    for key in (_EPISODE, cost):
        if key not in arrays:
            continue
        columns[key] = _numbers(arrays[key], f'{path}: {key!r}')
        if columns[key].shape != shape:
            raise DataError(
                f'{path}: {key!r} has the shape {columns[key].shape}; allowed is {shape}, '
                'one number per row'
            )
        columns[key] = columns[key].reshape(-1)
    if len(shape) == 2:
        if _EPISODE in columns:
            raise DataError(
                f"{path} has an array 'episode', but the first axis of 'features' tells episodes "
                'apart already; allowed is one of them'
            )
        columns[_EPISODE] = np.repeat(np.arange(shape[0], dtype=np.float64), shape[1])
    return _Content(
        features,
        values.reshape(-1, width),
        columns.get(_EPISODE),
        columns.get(cost),
        tuple(name for name in _DESCRIBING if name not in arrays),
    )


def _npz_features(arrays: dict[str, np.ndarray], width: int, path: Path) -> tuple[Feature, ...]:
    texts = {
        'names': [f'x{index}' for index in range(width)],
        'units': [''] * width,
        'families': [''] * width,
    }
    for key in texts:
        given = arrays.get(key)
        if given is not None:
            if given.shape != (width,) or given.dtype.kind != 'U':
                raise DataError(
                    f'{path}: {key!r} has the shape {given.shape} and type {given.dtype}; '
                    f'allowed is text of shape ({width},), one for each feature'
                )
            texts[key] = given.tolist()
    bounds = np.tile([-np.inf, np.inf], (width, 1))
    if 'bounds' in arrays:
        bounds = _numbers(arrays['bounds'], f"{path}: 'bounds'")
        if bounds.shape != (width, 2):
            raise DataError(
                f"{path}: 'bounds' has the shape {bounds.shape}; allowed is ({width}, 2), the "
                'smallest and largest possible value of each feature'
            )
    return tuple(
        Feature(name, unit, float(low), float(high), family)
        for name, unit, family, (low, high) in zip(*texts.values(), bounds, strict=True)
    )


def _numbers(array: np.ndarray, where: str) -> np.ndarray:
    if array.dtype.kind not in 'biuf':
        raise DataError(f'{where} is of type {array.dtype}; allowed are real numbers')
    return array.astype(np.float64, copy=False)


def _read_csv(path: Path, wanted: Collection[str] | None) -> _Content:
    try:
        # A byte order mark is what spreadsheets put first.
        with (
            open_regular(path) as binary,
            io.TextIOWrapper(binary, encoding='utf-8-sig', newline='') as stream,
        ):
            rows = csv.reader(stream)
            header = [name.strip() for name in next(rows, [])]
            _check_header(header, path)
            chosen, places = _choose(header, wanted, path)
            table = parse_quickly(stream, len(header))
            if table is None:
                stream.seek(0)
                table = parse_cells(csv.reader(stream), header, places, path)
            else:
                table = table[:, places] if len(places) < len(header) else table
    except (UnicodeDecodeError, csv.Error) as error:
        reason = 'it is not UTF-8 text' if isinstance(error, UnicodeDecodeError) else error
        raise DataError(f'cannot read {path}: {reason}') from error
    return _split(chosen, table, path)


def _check_header(header: Sequence[str], path: Path) -> None:
    """Refuse a file without a header: its first row would be lost, and names be numbers."""
    if not header:
        raise DataError(f'{path} is empty; allowed are a line with the names of columns, then rows')
    try:
        numbers = [float(name) for name in header]
    except ValueError:
        return
    raise DataError(
        f'{path}, line 1: got the numbers {", ".join(f"{number:g}" for number in numbers)}; '
        'allowed are the names of the columns'
    )


def _choose(
    header: Sequence[str], wanted: Collection[str] | None, path: Path
) -> tuple[list[str], list[int]]:
    """Return the names and places of the columns to read."""
    apart = (_EPISODE, _cost_name(header, path))
    if wanted is not None:
        for name in wanted:
            _require(name, header, path)
    names = [name for name in header if wanted is None or name in wanted or name in apart]
    for name in names:
        if name and names.count(name) > 1:
            raise DataError(f'{path} has two columns {name!r}; names must be unique')
    if not set(names) - set(apart):
        raise DataError(f'{path} has no column of a feature; its columns are {", ".join(header)}')
    return names, [place for place, name in enumerate(header) if name in names]


def _read_parquet(path: Path, wanted: Collection[str] | None) -> _Content:
    try:
        import pyarrow
        import pyarrow.parquet
    except ModuleNotFoundError as error:
        raise DataError(
            f"reading {path} needs the module 'pyarrow', which is not installed: "
            'pip install pyarrow'
        ) from error
    try:
        with open_regular(path) as stream:
            schema = pyarrow.parquet.read_schema(stream)
        names, _ = _choose(schema.names, wanted, path)
        for name in names:
            kind = schema.field(name).type
            if not (
                pyarrow.types.is_integer(kind)
                or pyarrow.types.is_floating(kind)
                or pyarrow.types.is_boolean(kind)
            ):
                raise DataError(f'{path}, column {name!r}: got {kind}; allowed are numbers')
        content = pyarrow.parquet.read_table(path, columns=names)
    except pyarrow.ArrowInvalid as error:
        raise DataError(f'{path} is not a Parquet file: {str(error).splitlines()[0]}') from error
    table = np.empty((content.num_rows, len(names)))
    for place, name in enumerate(names):
        # Whole numbers beyond 2**53 are rounded, as everywhere else.
        table[:, place] = content[name].cast(pyarrow.float64(), safe=False).to_numpy()
    return _split(names, table, path)


def _split(names: Sequence[str], table: np.ndarray, path: Path) -> _Content:
    """Part the columns that are features from those that are not."""
    cost = _cost_name(names, path)
    is_feature = [name not in (_EPISODE, cost) for name in names]
    apart = {name: table[:, names.index(name)] for name in (_EPISODE, cost) if name in names}
    features = tuple(
        Feature(name, '') for name, chosen in zip(names, is_feature, strict=True) if chosen
    )
    values = table if all(is_feature) else table[:, is_feature]
    return _Content(features, values, apart.get(_EPISODE), apart.get(cost))


_READERS: dict[str, Callable[[Path, Collection[str] | None], _Content]] = {
    '.npz': _read_npz,
    '.csv': _read_csv,
    '.parquet': _read_parquet,
}
TABLE_ENDINGS = ', '.join(_READERS)
"""How the names of table files end, in words."""
