# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Storage files that must be unpacked or copied before they can be read in any order."""

from __future__ import annotations

import shutil
import tempfile
import weakref
from pathlib import Path

import zstandard

from occ_constraints_pkg.errors import DataError

ZSTD_SUFFIXES = ('.zstd', '.zst')
_ZSTD_MAGIC = b'\x28\xb5\x2f\xfd'
_BLOCK_BYTES = 1 << 20
# A file that grows by more than this is taken for damage or for malice, before it fills the disk.
_MOST_GROWTH = 2000


class Unpacked:
    """A folder for temporary files that goes when this object does."""

    def __init__(self) -> None:
        self._folder: Path | None = None
        self._count = 0

    def open(self, path: Path) -> tuple[Path, str]:
        """Return a file that can be read as it is, and a warning if part of it is lost.

        That is the file itself, unless it is compressed as a whole, or is a database beside which
        lies a write-ahead log: to open that one in place would change it.

        Raises:
            OccError: the file cannot be read or unpacked.
        """
        log = path.with_name(f'{path.name}-wal')
        try:
            with path.open('rb') as file:
                compressed = file.read(len(_ZSTD_MAGIC)) == _ZSTD_MAGIC
            if compressed:
                target = self._target(path)
                return target, _decompress(path, target)
            if log.is_file() and log.stat().st_size:
                target = self._target(path)
                shutil.copyfile(path, target)
                shutil.copyfile(log, target.with_name(f'{target.name}-wal'))
                return target, ''
        except OSError as error:
            raise DataError(f'cannot read {path}: {error.strerror}') from error
        return path, ''

    def _target(self, path: Path) -> Path:
        if self._folder is None:
            self._folder = Path(tempfile.mkdtemp(prefix='occ_bag_'))
            weakref.finalize(self, shutil.rmtree, self._folder, ignore_errors=True)
        self._count += 1
        name = path.stem if path.suffix in ZSTD_SUFFIXES else path.name
        return self._folder / f'{self._count}_{name}'


def _decompress(path: Path, target: Path) -> str:
    allowed = path.stat().st_size * _MOST_GROWTH
    written, problem = 0, ''
    with path.open('rb') as source, target.open('wb') as sink:
        reader = zstandard.ZstdDecompressor().stream_reader(source, read_across_frames=True)
        while True:
            try:
                block = reader.read(_BLOCK_BYTES)
            except zstandard.ZstdError as error:
                problem = str(error)
                break
            if not block:
                break
            written += len(block)
            if written > allowed:
                raise DataError(
                    f'{path} cannot be read: it unpacks to more than {_MOST_GROWTH} times its size'
                )
            sink.write(block)
    if not written:
        raise DataError(f'{path} is damaged: nothing of it can be unpacked')
    return f'{path} is damaged: {problem}; its first {written} bytes are used' if problem else ''
