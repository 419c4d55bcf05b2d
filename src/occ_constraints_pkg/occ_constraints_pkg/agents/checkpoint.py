# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Checkpoint files: nested plain values, arrays and tensors, read without executing anything."""

from __future__ import annotations

import io
import pickle
import pickletools
import re
import zipfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch

from occ_constraints_pkg.archives import FAULTS, describe, read_member
from occ_constraints_pkg.errors import DataError
from occ_constraints_pkg.files import ARCHIVE, read_bytes, replacing

_FORMAT = 'occ_constraints checkpoint 2'
# Far more than any training writes, yet affordable on a machine that trains.
_MOST_BYTES = 1 << 30
# What the pickle of a checkpoint is made of.
_OPERATIONS = frozenset(
    (
        *('PROTO', 'STOP', 'MARK', 'BINPUT', 'LONG_BINPUT', 'BINGET', 'LONG_BINGET', 'NONE'),
        *('NEWTRUE', 'NEWFALSE', 'BININT', 'BININT1', 'BININT2', 'LONG1', 'BINFLOAT'),
        *('BINUNICODE', 'EMPTY_DICT', 'EMPTY_LIST', 'EMPTY_TUPLE', 'TUPLE', 'TUPLE1', 'TUPLE2'),
        *('TUPLE3', 'APPEND', 'APPENDS', 'SETITEM', 'SETITEMS', 'GLOBAL', 'BINPERSID'),
        'REDUCE',
    )
)
_CALLED = ('torch._utils _rebuild_tensor_v2', 'collections OrderedDict')
_STORAGE = re.compile(r'torch [A-Z][A-Za-z0-9]*Storage')
_NUMBERS = frozenset(('BINFLOAT', 'BININT', 'BININT1', 'BININT2'))
_REUSED = ('BINUNICODE', 'GLOBAL', 'tensor', 'pair')


def write_checkpoint(path: Path | str, state: Mapping[str, Any]) -> None:
    """Write ``state``, replacing the file atomically.

    Args:
        path: the file.
        state: nested mappings and lists of numbers, texts, arrays and tensors.

    Raises:
        OccError: it cannot be written; the previous file stays.
    """
    # Not directly to the file: for a full disk torch reports a position, the system the reason.
    content = io.BytesIO()
    torch.save({'format': _FORMAT, **_with_tensors(state)}, content)
    with replacing(path, ARCHIVE) as draft:
        draft.write_bytes(content.getbuffer())


def read_checkpoint(path: Path | str) -> dict[str, Any]:
    """Read what :func:`write_checkpoint` wrote; all tensors on the CPU.

    Raises:
        DataError: no such file, or not a checkpoint.
    """
    content = read_bytes(path, _MOST_BYTES, 'checkpoint')
    try:
        _check_content(content)
        state = torch.load(io.BytesIO(content), map_location='cpu', weights_only=True)
    except (*FAULTS, pickle.UnpicklingError, AssertionError, RecursionError) as err:
        raise DataError(
            f'{path} is damaged or not a checkpoint ({describe(err)}); allowed is {_FORMAT!r}'
        ) from err
    if not isinstance(state, dict) or state.get('format') != _FORMAT:
        raise DataError(f'{path} is not a checkpoint: allowed is {_FORMAT!r}')
    return state


def _check_content(content: bytes) -> None:
    """Refuse what torch does not detect: a changed bit, or a small file that expands to gigabytes.

    Raises:
        ValueError: the content is not one that :func:`write_checkpoint` writes.
        Exception: one of :data:`~occ_constraints_pkg.archives.FAULTS`.
    """
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        items = archive.infolist()
        # Nothing is compressed, so nothing can be larger than the file.
        if any(item.compress_type != zipfile.ZIP_STORED for item in items):
            raise ValueError('it is packed')
        if sum(item.file_size for item in items) > len(content):
            raise ValueError('its parts are larger than the whole')
        names = [item.filename for item in items]
        if len(set(names)) < len(names):
            raise ValueError('a part is there twice')
        for item in items:
            part = read_member(archive, item)
            if item.filename.endswith('/data.pkl'):
                _check_pickle(part)


def _check_pickle(part: bytes) -> None:
    """Refuse a pickle that calls anything but tensor constructors, or uses a container twice.

    torch executes only calls on its list, but these include bytearrays of any size; and lists that
    contain one another twice take exponential time to traverse.

    Raises:
        ValueError: it does.
    """
    memo: dict[int, str] = {}
    recent = ['', '', '']
    argument: Any
    for operation, argument, _ in pickletools.genops(part):
        name = operation.name
        if name not in _OPERATIONS:
            raise ValueError(f'the operation {name}')
        if name == 'GLOBAL' and argument not in _CALLED and not _STORAGE.fullmatch(argument):
            raise ValueError(f'a call of {argument!r}')
        if name in ('BINPUT', 'LONG_BINPUT'):
            memo[argument] = _made_by(recent)
        elif name in ('BINGET', 'LONG_BINGET') and memo.get(argument, '') not in _REUSED:
            raise ValueError('a part that is used twice')
        else:
            recent = [*recent[1:], name]


def _made_by(operations: Sequence[str]) -> str:
    """Return what the last three operations of a pickle have made."""
    match operations:
        case [first, second, 'TUPLE2'] if {first, second} <= _NUMBERS:
            return 'pair'
        case [_, 'TUPLE', 'REDUCE']:
            # A dictionary is made from an empty tuple.
            return 'tensor'
    return operations[-1]


def with_arrays(value: Any) -> Any:
    """Return the same nested value with arrays for tensors."""
    if isinstance(value, torch.Tensor):
        return value.numpy()
    if isinstance(value, dict):
        return {key: with_arrays(item) for key, item in value.items()}
    return value


def _with_tensors(value: Any) -> Any:
    # torch loads tensors without executing anything, but not arrays.
    if isinstance(value, np.ndarray):
        return torch.from_numpy(value.copy())
    if isinstance(value, Mapping):
        return {key: _with_tensors(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        # Copied: shared containers are refused on reading.
        return type(value)([_with_tensors(item) for item in value])
    return value
