# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""A trained policy as plain arrays: runs with NumPy alone, and its file executes nothing."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from occ_constraints_pkg.archives import read_arrays
from occ_constraints_pkg.errors import DataError, OccError
from occ_constraints_pkg.files import ARCHIVE, replacing
from occ_constraints_pkg.worlds.base import Column

_FORMAT = 'occ_constraints policy 1'
_FIELD = re.compile(
    r'format|world|columns|action_columns|observation_(mean|variance|clip)|log_std|'
    r'(weight|bias)_[0-9]{1,3}'
)
# Thousands of times the size of the shipped policies.
_MOST_BYTES = 256 << 20
# OpenBLAS splits larger matrix products (rows x inputs x outputs) among threads, which wait by
# spinning: 0.1 ms become 10 ms as soon as other processes use the cores.
_SMALL_PRODUCT = 2**18


def column_names(columns: Sequence[Column | str]) -> tuple[str, ...]:
    """Return the names of columns given as :class:`Column` or by name."""
    return tuple(column if isinstance(column, str) else column.name for column in columns)


@dataclass(frozen=True, eq=False)
class GaussianPolicy:
    """A diagonal Gaussian over actions whose mean is a tanh network of the observation.

    The network sees ``clip((x - mean) / sqrt(variance), -clip, clip)``, applies
    ``tanh(x @ weight + bias)`` for every layer but the last, and the last one without tanh.
    Actions are in the units of the action columns and not clipped to their bounds; worlds clip.

    Attributes:
        world: name of the world it was trained in.
        columns: names of the k observation columns, in order.
        action_columns: names of the a action columns, in order.
        observation_mean: (k,) float32.
        observation_variance: (k,) float32, all above zero.
        observation_clip: bound of the normalised observation.
        weights: one (inputs, outputs) float32 matrix per layer.
        biases: one (outputs,) float32 vector per layer.
        log_std: (a,) float32, natural logarithm of the standard deviation, the same in all states.
    """

    world: str
    columns: tuple[str, ...]
    action_columns: tuple[str, ...]
    observation_mean: np.ndarray
    observation_variance: np.ndarray
    observation_clip: float
    weights: tuple[np.ndarray, ...]
    biases: tuple[np.ndarray, ...]
    log_std: np.ndarray

    def __post_init__(self) -> None:
        """Refuse inconsistent arrays.

        Raises:
            DataError: inconsistent shapes, or numbers that are not finite.
        """
        k, a = len(self.columns), len(self.action_columns)
        widths = [k, *(bias.size for bias in self.biases)]
        wanted: dict[str, tuple[np.ndarray, tuple[int, ...]]] = {
            'observation_mean': (self.observation_mean, (k,)),
            'observation_variance': (self.observation_variance, (k,)),
            'log_std': (self.log_std, (a,)),
        }
        if not self.weights or len(self.weights) != len(self.biases) or widths[-1] != a:
            raise DataError(
                f'a policy with {len(self.weights)} weight and {len(self.biases)} bias arrays '
                f'ending in {widths[-1]} outputs was given; allowed is one bias per weight, at '
                f'least one, and {a} outputs for the action columns'
            )
        for layer, (weight, bias) in enumerate(zip(self.weights, self.biases, strict=True)):
            wanted[f'weight_{layer}'] = (weight, (widths[layer], widths[layer + 1]))
            wanted[f'bias_{layer}'] = (bias, (widths[layer + 1],))
        for name, (array, shape) in wanted.items():
            if array.shape != shape or array.dtype != np.float32 or not np.isfinite(array).all():
                raise DataError(
                    f'policy field {name} has shape {array.shape} and type {array.dtype}; allowed '
                    f'is {shape} float32, all finite'
                )
        if not (self.observation_variance > 0).all() or not self.observation_clip > 0:
            raise DataError(
                'policy field observation_variance or observation_clip is not above zero everywhere'
            )

    @cached_property
    def _scale(self) -> np.ndarray:
        return 1.0 / np.sqrt(self.observation_variance)

    @cached_property
    def _std(self) -> np.ndarray:
        return np.exp(self.log_std)

    def act(self, observation: np.ndarray, rng: np.random.Generator | None = None) -> np.ndarray:
        """Choose one action per row.

        Args:
            observation: (N, k) finite numbers, columns as in :attr:`columns`.
            rng: draws the action from the Gaussian; ``None`` returns its mean.

        Returns:
            (N, a) float32.

        Raises:
            DataError: the observation has another width or is not finite.
        """
        x = np.asarray(observation, dtype=np.float32)
        if x.ndim != 2 or x.shape[1] != len(self.columns) or not np.isfinite(x).all():
            raise DataError(
                f'the policy got an observation of shape {x.shape}; allowed is '
                f'(robots, {len(self.columns)}), all finite'
            )
        rows = max(1, _SMALL_PRODUCT // max(weight.size for weight in self.weights))
        action = np.empty((len(x), len(self.action_columns)), dtype=np.float32)
        for start in range(0, len(x), rows):
            action[start : start + rows] = self._mean(x[start : start + rows])
        if rng is not None:
            action += self._std * rng.standard_normal(action.shape, dtype=np.float32)
        return action

    def _mean(self, x: np.ndarray) -> np.ndarray:
        """The network: (rows, k) observation to (rows, a) mean action."""
        x = (x - self.observation_mean) * self._scale
        np.clip(x, -self.observation_clip, self.observation_clip, out=x)
        for weight, bias in zip(self.weights[:-1], self.biases[:-1], strict=True):
            x = x @ weight
            x += bias
            np.tanh(x, out=x)
        return x @ self.weights[-1] + self.biases[-1]

    def check_world(
        self, columns: Sequence[Column | str], action_columns: Sequence[Column | str]
    ) -> None:
        """Refuse a world or a topic whose columns or their order differ from the policy's.

        Raises:
            DataError: the first difference.
        """
        for kind, own, given in (
            ('observation', self.columns, column_names(columns)),
            ('action', self.action_columns, column_names(action_columns)),
        ):
            if own == given:
                continue
            at = next(
                (i for i, (p, w) in enumerate(zip(own, given, strict=False)) if p != w),
                min(len(own), len(given)),
            )
            here = [repr(names[at]) if at < len(names) else 'nothing' for names in (own, given)]
            raise DataError(
                f'the policy was trained in {self.world!r} with {len(own)} {kind} columns and '
                f'cannot act on these {len(given)}: column {at} is {here[1]} where the policy '
                f'has {here[0]}'
            )

    def save(self, path: Path | str) -> None:
        """Write the policy as an ``.npz`` file, replacing an existing one atomically.

        Fields: ``format`` (text), ``world`` (text), ``columns`` and ``action_columns`` (text
        arrays), ``observation_mean``, ``observation_variance``, ``observation_clip``,
        ``weight_0``, ``bias_0``, ``weight_1`` ... and ``log_std``, with the shapes given above.
        """
        fields = {
            'format': np.array(_FORMAT),
            'world': np.array(self.world),
            'columns': np.array(self.columns),
            'action_columns': np.array(self.action_columns),
            'observation_mean': self.observation_mean,
            'observation_variance': self.observation_variance,
            'observation_clip': np.array(self.observation_clip),
            'log_std': self.log_std,
        }
        for layer, (weight, bias) in enumerate(zip(self.weights, self.biases, strict=True)):
            fields[f'weight_{layer}'] = weight
            fields[f'bias_{layer}'] = bias
        with replacing(path, ARCHIVE) as draft, draft.open('wb') as file:
            np.savez(file, **fields)  # type: ignore[arg-type]

    @classmethod
    def load(cls, path: Path | str) -> GaussianPolicy:
        """Read a policy file; nothing in it is executed.

        Raises:
            DataError: no such file, not a policy file, or inconsistent shapes.
        """
        fields = read_arrays(
            path,
            lambda name: _FIELD.fullmatch(name) is not None,
            limit=_MOST_BYTES,
            what='policy file',
            fault='not a policy file, or damaged',
        )
        if str(fields.get('format')) != _FORMAT:
            raise DataError(
                f'{path} is not a policy file: its field "format" is '
                f'{str(fields.get("format"))!r}; allowed is {_FORMAT!r}'
            )
        layers = sum(name.startswith('weight_') for name in fields)
        try:
            return cls(
                world=str(fields['world']),
                columns=tuple(map(str, fields['columns'])),
                action_columns=tuple(map(str, fields['action_columns'])),
                observation_mean=fields['observation_mean'],
                observation_variance=fields['observation_variance'],
                observation_clip=float(fields['observation_clip']),
                weights=tuple(fields[f'weight_{layer}'] for layer in range(layers)),
                biases=tuple(fields[f'bias_{layer}'] for layer in range(layers)),
                log_std=fields['log_std'],
            )
        except KeyError as err:
            raise DataError(f'policy file {path} lacks the field {err.args[0]!r}') from err
        except (OccError, TypeError, ValueError) as err:
            raise DataError(f'policy file {path} is damaged: {err}') from err
