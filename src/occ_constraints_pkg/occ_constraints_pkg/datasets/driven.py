# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""What was done in which state: observations and actions of recorded simulated episodes."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from occ_constraints_pkg.errors import DataError
from occ_constraints_pkg.features.serialized_tables import TableReader
from occ_constraints_pkg.features.table import Table
from occ_constraints_pkg.features.table_messages import TABLE_TYPE
from occ_constraints_pkg.rosbag.recording import RawMessage, Recording

_TOPICS = ('observation', 'action')
# Columns of an observation whose rows end an episode: what follows was not chosen in them.
_ENDS = ('terminated', 'truncated')


@dataclass(frozen=True, eq=False)
class Driven:
    """States, and the actions that were chosen in them.

    Attributes:
        observations: (n, k) float32.
        actions: (n, a) float32.
    """

    observations: np.ndarray
    actions: np.ndarray


def read_driven(
    paths: Iterable[str | Path], columns: Sequence[str], action_columns: Sequence[str], world: str
) -> Driven:
    """Read the actions of recordings with the topics ``observation`` and ``action``.

    An action belongs to the observation with the same stamp. Where either is missing, as after a
    lost message, the other is left out, and so are the last states of episodes.

    Args:
        paths: recordings, at least one.
        columns: of the observations, in the order wanted.
        action_columns: of the actions.
        world: the world that was driven in, by the frame of the observations.

    Raises:
        DataError: a recording cannot be read, is of another world, lacks a topic or a column, or
            none has a pair.
    """
    found: list[tuple[np.ndarray, np.ndarray]] = []
    for path in paths:
        found += _pairs(Recording(path), columns, action_columns, world)
    if not found:
        raise DataError(
            'the demonstrations hold no observation with an action of the same stamp; allowed are '
            'recordings of the topics observation and action, such as `occ demo` makes'
        )
    observations, actions = zip(*found, strict=True)
    return Driven(np.concatenate(observations), np.concatenate(actions))


def _pairs(
    recording: Recording, columns: Sequence[str], action_columns: Sequence[str], world: str
) -> Iterable[tuple[np.ndarray, np.ndarray]]:
    """Yield observations and actions of each step."""
    names = [_topic(recording, topic) for topic in _TOPICS]
    readers = {name: _reader(recording, name) for name in names}
    waiting: dict[int, tuple[str, Table]] = {}
    for raw in recording.messages(names):
        message = readers[raw.topic].read(raw.data)
        is_observation = raw.topic == names[0]
        if is_observation and message.frame_id != world:
            raise DataError(
                f'{recording.path} was recorded in the world {message.frame_id!r}; allowed are '
                f'demonstrations in {world!r}'
            )
        other = waiting.pop(message.stamp_ns, None)
        if other is None or other[0] == raw.topic:
            waiting[message.stamp_ns] = raw.topic, message.table
            continue
        observation, action = (
            (message.table, other[1]) if is_observation else (other[1], message.table)
        )
        if len(observation.values) != len(action.values):
            raise DataError(
                f'{recording.path} has {len(action.values)} actions for '
                f'{len(observation.values)} robots; allowed is one for each'
            )
        seen, goes_on = _chosen(recording, observation, columns), _goes_on(observation)
        done = _chosen(recording, action, action_columns)
        good = goes_on & np.isfinite(seen).all(axis=1) & np.isfinite(done).all(axis=1)
        if good.any():
            yield seen[good], done[good]


def _topic(recording: Recording, topic: str) -> str:
    """Return the name of a topic with tables in a recording.

    Raises:
        DataError: there is none.
    """
    key = f'/{topic}'
    name = next((item for item in recording.topics if item in (topic, key)), None)
    if name is None or recording.topics[name].msgtype != TABLE_TYPE:
        raise DataError(
            f'{recording.path} has no topic {key} of {TABLE_TYPE}; to clone demonstrations, '
            'observations and actions are needed, as nodes sim and policy publish them'
        )
    return name


def _reader(recording: Recording, topic: str) -> TableReader:
    def decode(data: bytes) -> object:
        return recording.decode(RawMessage(topic, TABLE_TYPE, 0, data))

    return TableReader(decode)


def _chosen(recording: Recording, table: Table, names: Sequence[str]) -> np.ndarray:
    missing = [name for name in names if name not in table.names]
    if missing:
        raise DataError(
            f'{recording.path} lacks the column {missing[0]!r}; there are {", ".join(table.names)}'
        )
    places = [table.names.index(name) for name in names]
    return table.values[:, places].astype(np.float32)


def _goes_on(observation: Table) -> np.ndarray:
    """Return (n,) bool, whether the episode of each robot goes on after this state."""
    ends = [observation.column(name) > 0 for name in _ENDS if name in observation.names]
    return ~np.logical_or.reduce(ends) if ends else np.ones(len(observation.values), dtype=bool)
