# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Reads damaged policies, checkpoints, tables, metrics and counters.

``python -m fuzz_files FIRST COUNT``, in ``tests``. A policy or checkpoint that is read after damage
must hold the same values as before.
"""

from __future__ import annotations

import io
import json
import pickle
import sys
import tempfile
import zipfile
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import torch
from fuzzing import damaged, watch
from occ_constraints_pkg.agents.checkpoint import read_checkpoint
from occ_constraints_pkg.agents.policy import GaussianPolicy
from occ_constraints_pkg.agents.ppo_lagrangian import PPOLagrangian
from occ_constraints_pkg.agents.settings import PPOLagrangianConfig
from occ_constraints_pkg.agents.training import read_metrics
from occ_constraints_pkg.datasets.table_files import read_tables
from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.rules.persistent_counts import PersistentCounts
from occ_constraints_pkg.rules.rule import Literal, Rule
from occ_constraints_pkg.rules.ruleset import RuleSet
from occ_constraints_pkg.rules.space import Feature, FeatureSpace

RULES = RuleSet(
    FeatureSpace((Feature('x'), Feature('y'))),
    (Rule('far', (Literal(0, '>', 0.7),)), Rule('near', (Literal(1, '<', 0.1),))),
    np.zeros((2, 2)),
)
_SMALL = {'hidden': (4,), 'rollout_steps': 8}


def learner() -> PPOLagrangian:
    """Return a small learner."""
    return PPOLagrangian(PPOLagrangianConfig(**_SMALL), ['x', 'y'], ['u'], 'line', 0)


def same(one: Any, other: Any) -> bool:
    """Tell whether two nested values are equal to the last bit."""
    if isinstance(one, torch.Tensor):
        return isinstance(other, torch.Tensor) and same(one.numpy(), other.numpy())
    if isinstance(one, np.ndarray):
        is_array = isinstance(other, np.ndarray) and one.dtype == other.dtype
        return is_array and one.shape == other.shape and one.tobytes() == other.tobytes()
    if isinstance(one, dict):
        return list(one) == list(other) and all(same(one[key], other[key]) for key in one)
    if isinstance(one, list | tuple):
        return len(one) == len(other) and all(map(same, one, other))
    return type(one) is type(other) and one == other


def packed(fields: dict[str, np.ndarray], how: int) -> bytes:
    """Return an archive of arrays, packed in one of several ways."""
    content = io.BytesIO()
    (np.savez, np.savez_compressed)[how](content, **fields)
    return content.getvalue()


@cache
def kinds() -> tuple[tuple[str, tuple[bytes, ...], Callable[[Path], Any], bool], ...]:
    """Return of each kind of file a name, examples, what reads it, and whether it is sealed.

    What is sealed has checksums: after damage it is refused, or equal.
    """
    rng = np.random.default_rng(0)
    with tempfile.TemporaryDirectory() as place:
        path = Path(place) / 'file'
        made = learner()
        made.policy().save(path)
        policy = path.read_bytes()
        path.unlink()
        made.save(path, settings={'robots': 3})
        checkpoint = path.read_bytes()
        path.unlink()
        counts = PersistentCounts(RULES, path)
        counts.add(RULES.judge(rng.normal(size=(20, 2))))
        counts.keep()
        counted = path.read_bytes()
    values = rng.normal(size=(50, 2))
    fields = {'features': values, 'names': np.array(['x', 'y']), 'cost': np.zeros(50)}
    line = json.dumps({'updates': 3, 'steps': 12, 'mean_return': None}) + '\n'
    text = ''.join(f'{a:.3f},{b:.3f}\n' for a, b in values)

    def fields_of(loaded: GaussianPolicy) -> dict[str, Any]:
        return {name: getattr(loaded, name) for name in loaded.__dataclass_fields__}

    def table(path: Path) -> None:
        data, space = read_tables([path])
        assert data.values.shape == (len(data), len(space))

    return (
        ('.npz', (policy,), lambda path: fields_of(GaussianPolicy.load(path)), True),
        ('.pt', (checkpoint,), read_checkpoint, True),
        # Another seal: hostile content has right checksums, so it is put together anew.
        ('.again.npz', (policy, packed(fields, 0)), GaussianPolicy.load, False),
        ('.again.pt', (checkpoint,), PPOLagrangian.load, False),
        ('.npz', (packed(fields, 0), packed(fields, 1)), table, False),
        ('.again.npz', (packed(fields, 0),), table, False),
        ('.csv', (f'x,y\n{text}'.encode(), b'x,episode,cost\n1,0,0\n2,0,\n'), table, False),
        ('.jsonl', ((line * 4).encode(),), read_metrics, False),
        ('.json', (counted,), lambda path: PersistentCounts(RULES, path), False),
    )


def resealed(data: bytes, rng: np.random.Generator) -> bytes:
    """Return an archive with one part damaged, or made a bomb, and all checksums right."""
    source = zipfile.ZipFile(io.BytesIO(data))
    names = source.namelist()
    chosen = names[int(rng.integers(len(names)))]
    content = io.BytesIO()
    with zipfile.ZipFile(content, 'w') as target:
        for name in names:
            part = source.read(name)
            packing = zipfile.ZIP_STORED
            if name == chosen:
                match int(rng.integers(6)):
                    case 0 if rng.integers(10) == 0:
                        part, packing = part + bytes(200_000_000), zipfile.ZIP_DEFLATED
                    case 1 if name.endswith('.pkl'):
                        part = pickle.dumps(bytearray(1000)).replace(b'\xe8\x03', b'\xff\xff')
                    case 2:
                        packing = zipfile.ZIP_LZMA
                    case 3:
                        part = part.replace(b'4', b'9').replace(b'2', b'9999999')
                    case _:
                        part = damaged(part, rng)
            target.writestr(name, part, packing)
    return content.getvalue()


def call(number: int, folder: Path) -> Callable[[], str]:
    """Write the damaged file of a number; return the call that reads it."""
    rng = np.random.default_rng(number)
    ending, examples, read, is_sealed = kinds()[number % len(kinds())]
    whole = examples[int(rng.integers(len(examples)))]
    path = folder / f'file{ending}'
    path.write_bytes(whole)
    before = read(path) if is_sealed else None
    if '.again' in ending:
        path.write_bytes(resealed(whole, rng))
    elif rng.integers(2):
        flipped = bytearray(whole)
        flipped[int(rng.integers(len(whole)))] ^= 1 << int(rng.integers(8))
        path.write_bytes(flipped)
    else:
        path.write_bytes(damaged(whole, rng))

    def run() -> str:
        try:
            after = read(path)
        except OccError as error:
            if '\n' in str(error) or not str(error):
                raise AssertionError(f'not one sentence: {error}') from error
            return 'refused'
        if is_sealed and not same(before, after):
            raise AssertionError('other values were read than were written')
        return 'read'

    return run


if __name__ == '__main__':
    with tempfile.TemporaryDirectory() as place:
        watch(lambda number: call(number, Path(place)), int(sys.argv[1]), int(sys.argv[2]))
