# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Archives of arrays, read in bounded memory and with all checksums verified."""

from __future__ import annotations

import io
import math
import struct
import tokenize
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import IO

import numpy as np

from occ_constraints_pkg.errors import DataError, OccError
from occ_constraints_pkg.files import open_regular

FAULTS = (
    *(zipfile.BadZipFile, zlib.error, struct.error, EOFError, ValueError, TypeError, KeyError),
    *(NotImplementedError, RuntimeError, OverflowError, MemoryError, SyntaxError, IndexError),
    *(AttributeError, tokenize.TokenError),
)
"""What the readers of the standard library and of NumPy raise on damaged archives and arrays."""

# What a file may hold however well it was packed, and how often its own size beyond that. Honest
# data are packed to a hundredth at most; zeros to a thousandth.
_PLENTY_BYTES = 64 << 20
_MOST_RATIO = 100
# Text of one array of names; each character takes four bytes.
_TEXT_BYTES = 16 << 20


def read_arrays(
    path: str | Path,
    is_wanted: Callable[[str], bool] = lambda name: True,
    *,
    limit: int | None = None,
    what: str = '',
    fault: str = 'damaged or no archive of plain arrays',
) -> dict[str, np.ndarray]:
    """Read arrays of an ``.npz`` file: numbers and text, nothing that would be executed.

    What is not wanted is not unpacked. What is wanted is measured, by what the file says of it,
    before it is read; the checksums of the archive and the sizes have to agree with it.

    Args:
        path: the file.
        is_wanted: tells by its name whether an array is to be read.
        limit: bytes that the arrays may take, numbers as float64; none: 64 MB, or a hundred times
            the size of the file if that is more.
        what: what the file is to be, before its name in messages.
        fault: what messages call one that cannot be used.

    Returns:
        The arrays by name, in the order of the file.

    Raises:
        DataError: the file cannot be read, is larger than allowed, damaged, or no such archive.
    """
    with open_regular(path, what) as stream:
        try:
            with zipfile.ZipFile(stream) as archive:
                size = stream.seek(0, io.SEEK_END)
                allowed = max(_PLENTY_BYTES, _MOST_RATIO * size) if limit is None else limit
                return _arrays(archive, is_wanted, allowed, path)
        except OSError as error:
            raise DataError(f'cannot read {path}: {error.strerror or error}') from error
        except OccError:
            raise
        except FAULTS as error:
            raise DataError(
                f'{path} is {fault} ({describe(error)}); allowed is '
                'what numpy.savez writes of arrays of numbers and text'
            ) from error


def array_names(path: str | Path) -> list[str]:
    """Return the names of the arrays in an ``.npz`` file, none where it is no such file."""
    with open_regular(path) as stream:
        try:
            with zipfile.ZipFile(stream) as archive:
                return [item.filename.removesuffix('.npy') for item in archive.infolist()]
        except (OSError, *FAULTS):
            return []


def read_member(archive: zipfile.ZipFile, item: zipfile.ZipInfo) -> bytes:
    """Return the content of a member that agrees with the archive's checksum.

    Raises:
        ValueError: it is packed in a way that is not read here, or encrypted.
        Exception: one of :data:`FAULTS`.
    """
    if item.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED) or item.flag_bits & 1:
        raise ValueError(f'{item.filename} is encrypted, or packed in another way than allowed')
    content = archive.read(item)
    if len(content) != item.file_size:
        raise ValueError(f'{item.filename} is cut short')
    return content


def describe(error: BaseException) -> str:
    """Return the message of an exception, shortened, on one line."""
    text = ' '.join(str(error).split()) or type(error).__name__
    return text if len(text) <= 100 else f'{text[:97]}...'


def _arrays(
    archive: zipfile.ZipFile, is_wanted: Callable[[str], bool], allowed: int, path: str | Path
) -> dict[str, np.ndarray]:
    arrays: dict[str, np.ndarray] = {}
    taken = 0
    for item in archive.infolist():
        name = item.filename.removesuffix('.npy')
        if not is_wanted(name):
            continue
        if name in arrays:
            raise ValueError(f'{name!r} is there twice')
        # An array of bytes may be converted to float64.
        taken += item.file_size
        if taken > allowed:
            raise _too_large(path, name, taken, allowed)
        with archive.open(item) as member:
            dtype, count = _header(member)
        need = count * max(dtype.itemsize, 8)
        taken += need - count * dtype.itemsize
        if taken > allowed or (dtype.kind == 'U' and need > _TEXT_BYTES):
            raise _too_large(path, name, max(taken, need), min(allowed, _TEXT_BYTES))
        arrays[name] = _array(read_member(archive, item))
    return arrays


def _too_large(path: str | Path, name: str, size: int, allowed: int) -> OccError:
    return DataError(
        f'{path}: with {name!r} its arrays would take {size / 1e6:.0f} MB; allowed for a file of '
        f'this kind and size are {allowed / 1e6:.0f} MB'
    )


def _header(stream: IO[bytes]) -> tuple[np.dtype, int]:
    """Return the type of an array and how many elements it has, by its header."""
    version = np.lib.format.read_magic(stream)
    if version == (1, 0):
        shape, _, dtype = np.lib.format.read_array_header_1_0(stream)
    elif version == (2, 0):
        shape, _, dtype = np.lib.format.read_array_header_2_0(stream)
    else:
        raise ValueError(f'an array of format {version}; allowed are (1, 0) and (2, 0)')
    if dtype.kind not in 'biufcSU' or any(length < 0 for length in shape):
        raise ValueError(f'an array of type {dtype} and shape {shape}')
    return dtype, math.prod(shape)


def _array(content: bytes) -> np.ndarray:
    """Return the array of a member, whose size must match its header."""
    stream = io.BytesIO(content)
    dtype, count = _header(stream)
    if count * dtype.itemsize != len(content) - stream.tell():
        raise ValueError('an array of another size than its header says')
    stream.seek(0)
    return np.lib.format.read_array(stream, allow_pickle=False)
