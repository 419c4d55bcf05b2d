# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Checkpoint files: nested plain values, arrays and tensors, read without executing anything."""

from __future__ import annotations

import io
import pickle
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import torch

from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.files import replacing

_FORMAT = 'occ_constraints checkpoint 2'


def write_checkpoint(path: Path | str, state: Mapping[str, Any]) -> None:
    """Write ``state``, replacing the file in a single move.

    Args:
        path: the file.
        state: nested mappings and lists of numbers, texts, arrays and tensors.

    Raises:
        OccError: it cannot be written; the file before stays.
    """
    # Not straight to the file: of a full disk torch tells positions, the system what is the matter.
    content = io.BytesIO()
    torch.save({'format': _FORMAT, **_with_tensors(state)}, content)
    with replacing(path) as draft:
        draft.write_bytes(content.getbuffer())


def read_checkpoint(path: Path | str) -> dict[str, Any]:
    """Read what :func:`write_checkpoint` wrote; all tensors on the CPU.

    Raises:
        OccError: no such file, or not a checkpoint.
    """
    try:
        state = torch.load(path, map_location='cpu', weights_only=True)
    except OSError as err:
        raise OccError(f'cannot read checkpoint {path}: {err.strerror or err}') from err
    except (pickle.UnpicklingError, RuntimeError, EOFError, ValueError, KeyError) as err:
        raise OccError(f'{path} is not a checkpoint: allowed is {_FORMAT!r}') from err
    if not isinstance(state, dict) or state.get('format') != _FORMAT:
        raise OccError(f'{path} is not a checkpoint: allowed is {_FORMAT!r}')
    return state


def with_arrays(value: Any) -> Any:
    """Return the same nested value with arrays for tensors."""
    if isinstance(value, torch.Tensor):
        return value.numpy()
    if isinstance(value, dict):
        return {key: with_arrays(item) for key, item in value.items()}
    return value


def _with_tensors(value: Any) -> Any:
    # torch reads tensors without executing anything, arrays not.
    if isinstance(value, np.ndarray):
        return torch.from_numpy(value.copy())
    if isinstance(value, Mapping):
        return {key: _with_tensors(item) for key, item in value.items()}
    return value
