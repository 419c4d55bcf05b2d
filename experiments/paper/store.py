# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The results of runs, one line of JSON each, appended and never rewritten."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from occ_constraints_pkg.errors import DataError, OccError
from occ_constraints_pkg.files import make_directory, read_bytes

_MOST_BYTES = 256 << 20


class Store:
    """A directory with a file ``KIND.jsonl`` for each kind of run.

    A line that a crash has cut off is ignored, and removed before the next one is appended. Of
    several lines of the same run the last one counts.

    Args:
        folder: the directory; made when the first line is appended.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def lines(self) -> dict[str, dict[str, Any]]:
        """Return the newest line of each run, by its id.

        Raises:
            DataError: a file cannot be read, or is damaged before its last line.
        """
        found = {}
        for path in sorted(self.folder.glob('*.jsonl')):
            # Whatever follows the last newline is incomplete.
            texts = read_bytes(path, _MOST_BYTES).split(b'\n')[:-1]
            for number, text in enumerate(texts, start=1):
                line = _parsed(text)
                if line is None:
                    raise DataError(
                        f'{path} is damaged: line {number} is no result of a run; allowed is one '
                        'JSON object for each, with its "id" and its "result"'
                    )
                found[line['id']] = line
        return found

    def append(self, kind: str, line: Mapping[str, Any]) -> None:
        """Append the line of a run and sync it to disk.

        Args:
            kind: of the run; names the file.
            line: plain values, among them ``id`` and ``result``.

        Raises:
            OccError: it cannot be written.
        """
        make_directory(self.folder)
        path = self.folder / f'{kind}.jsonl'
        text = json.dumps(line, ensure_ascii=False, allow_nan=False)
        try:
            with path.open('a+b') as file:
                file.seek(0)
                file.truncate(file.read().rfind(b'\n') + 1)
                file.write(f'{text}\n'.encode())
                file.flush()
                os.fsync(file.fileno())
        except OSError as error:
            raise OccError(f'cannot write {path}: {error.strerror}') from error


def _parsed(text: bytes) -> dict[str, Any] | None:
    try:
        line = json.loads(text)
    except (ValueError, RecursionError):
        return None
    return line if isinstance(line, dict) and {'id', 'result'} <= line.keys() else None
