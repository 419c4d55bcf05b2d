# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""CSV files with a header, of which some columns are needed; errors name line and column."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import NoReturn, TextIO

import numpy as np

from occ_constraints_pkg.datasets.csv_cells import is_blank, parse_cells, parse_quickly
from occ_constraints_pkg.documents import did_you_mean
from occ_constraints_pkg.errors import DataError
from occ_constraints_pkg.files import open_regular
from occ_constraints_pkg.traffic.plausible import LARGEST

_REPORT_EVERY = 10_000


class CsvFile:
    """The needed columns of a CSV file.

    Attributes:
        path: the file.

    Args:
        path: the file; UTF-8 with a header, separated by commas.
        numbers: columns of numbers.
        integers: columns of whole numbers.
        texts: columns of text.
        progress: called with (bytes read, bytes in all).

    Raises:
        OccError: the file cannot be read, lacks a column, has no rows, or a cell is wrong.
    """

    def __init__(
        self,
        path: Path,
        *,
        numbers: Sequence[str] = (),
        integers: Sequence[str] = (),
        texts: Sequence[str] = (),
        progress: Callable[[int, int], None] | None = None,
    ) -> None:
        self.path = path
        self._columns: dict[str, np.ndarray] = {}
        self._texts: dict[str, list[str]] = {}
        names = (*numbers, *integers)
        try:
            with (
                open_regular(path) as binary,
                io.TextIOWrapper(binary, encoding='utf-8-sig', newline='') as stream,
            ):
                header = [name.strip() for name in next(csv.reader(stream), [])]
                for name in (*names, *texts):
                    self._require(name, header)
                places = [header.index(name) for name in names]
                if texts:
                    rows = [row for row in csv.reader(stream) if not is_blank(row)]
                    table = None
                else:
                    table = parse_quickly(_counted(stream, path, progress), len(header))
                if table is None:
                    stream.seek(0)
                    table = parse_cells(csv.reader(stream), header, places, path)
                else:
                    table = table[:, places]
        except OSError as error:
            raise DataError(f'cannot read {path}: {error.strerror}') from error
        except (UnicodeDecodeError, csv.Error) as error:
            reason = 'it is not UTF-8 text' if isinstance(error, UnicodeDecodeError) else error
            raise DataError(f'cannot read {path}: {reason}') from error
        if not len(table):
            raise DataError(f'{path} has no rows; allowed are one or more')
        for name in texts:
            self._texts[name] = [row[header.index(name)] for row in rows]
        for name, column in zip(names, table.T, strict=True):
            self._columns[name] = self._checked(name, column, whole=name in integers)

    def __getitem__(self, name: str) -> np.ndarray:
        """Return a column of numbers (rows,) float64, or int64 if it is one of whole numbers."""
        return self._columns[name]

    def text(self, name: str, row: int) -> str:
        """Return a cell of text."""
        return self._texts[name][row]

    def fail(self, row: int, column: str, sentence: str) -> NoReturn:
        """Raise an error that names the line and the column of a cell.

        Raises:
            OccError: always.
        """
        raise DataError(f'{self.path}, line {self._line(row)}, column {column!r}: {sentence}')

    def check(self, wrong: np.ndarray, column: str, allowed: str) -> None:
        """Refuse the first row of a (rows,) bool mask.

        Raises:
            OccError: there is one.
        """
        if wrong.any():
            row = int(np.argmax(wrong))
            self.fail(row, column, f'got {self._columns[column][row]:.10g}; allowed {allowed}')

    def _require(self, name: str, header: Sequence[str]) -> None:
        if header.count(name) != 1:
            hint = did_you_mean(name, header) or ';'
            what = 'not one column' if name in header else 'no column'
            # What is no header at all may be long, and a quoted name may hold a line break.
            columns = ' '.join(', '.join(header).split())[:300]
            raise DataError(
                f'{self.path}, line 1: there is {what} {name!r}{hint} the columns are {columns}'
            )

    def _checked(self, name: str, column: np.ndarray, *, whole: bool) -> np.ndarray:
        strange = ~(np.abs(column) <= LARGEST)
        if strange.any():
            row = int(np.argmax(strange))
            got = 'nothing' if np.isnan(column[row]) else f'{column[row]:g}'
            self.fail(row, name, f'got {got}; allowed is a number of at most {LARGEST:g}')
        if not whole:
            return column
        strange = column != np.floor(column)
        if strange.any():
            row = int(np.argmax(strange))
            self.fail(row, name, f'got {column[row]:.10g}; allowed is a whole number')
        return column.astype(np.int64)

    def _line(self, row: int) -> int:
        """Return the line of a row, from 1; looked up, as there may be blank lines."""
        with self.path.open(encoding='utf-8-sig', newline='') as stream:
            rows = csv.reader(stream)
            next(rows)
            for cells in rows:
                row -= not is_blank(cells)
                if row < 0:
                    break
            return rows.line_num


def _counted(
    stream: TextIO, path: Path, progress: Callable[[int, int], None] | None
) -> Iterator[str]:
    """Yield the lines of a stream and report how much of it was read."""
    total, done = path.stat().st_size, 0
    for number, line in enumerate(stream):
        done += len(line)
        if progress is not None and number % _REPORT_EVERY == 0:
            progress(min(done, total), total)
        yield line
