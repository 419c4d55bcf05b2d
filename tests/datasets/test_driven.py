# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""States and the actions chosen in them, from recordings of simulated episodes."""

from pathlib import Path

import numpy as np
import pytest
from occ_constraints_pkg.datasets.driven import read_driven
from occ_constraints_pkg.errors import DataError
from occ_constraints_pkg.features.table import Table
from occ_constraints_pkg.features.table_messages import TABLE_TYPE
from occ_constraints_pkg.rosbag.recording import Recording
from occ_constraints_pkg.worlds.registry import world_class

BAG = Path(__file__).parents[2] / 'bags' / 'point_goal_expert'
KIND = world_class('PointGoal1')
COLUMNS = [column.name for column in KIND.columns]
ACTIONS = [column.name for column in KIND.action_columns]


def tables(topic):
    recording = Recording(BAG)
    for raw in recording.messages([topic]):
        message = recording.decode(raw)
        stamp = message.header.stamp
        yield stamp.sec * 10**9 + stamp.nanosec, Table.from_message(message)


def test_actions_belong_to_the_observation_of_their_stamp():
    driven = read_driven([BAG], COLUMNS, ACTIONS, 'PointGoal1')
    actions = dict(tables('/action'))
    seen, done = [], []
    for stamp, observation in tables('/observation'):
        ends = (observation.column('terminated') > 0) | (observation.column('truncated') > 0)
        if stamp in actions:
            seen.append(observation.values[~ends][:, : len(COLUMNS)])
            done.append(actions[stamp].values[~ends])
    assert len(seen) > 900
    assert np.array_equal(driven.observations, np.concatenate(seen).astype(np.float32))
    assert np.array_equal(driven.actions, np.concatenate(done).astype(np.float32))


def test_columns_are_chosen_by_name():
    driven = read_driven([BAG], COLUMNS[:2], ACTIONS[::-1], 'PointGoal1')
    whole = read_driven([BAG], COLUMNS, ACTIONS, 'PointGoal1')
    assert np.array_equal(driven.observations, whole.observations[:, :2])
    assert np.array_equal(driven.actions, whole.actions[:, ::-1])


@pytest.mark.parametrize(
    ('columns', 'world', 'words'),
    [
        (
            COLUMNS,
            'CarGoal1',
            "in the world 'PointGoal1'; allowed are demonstrations in 'CarGoal1'",
        ),
        (['nothing'], 'PointGoal1', "lacks the column 'nothing'; there are "),
    ],
)
def test_others_are_refused(columns, world, words):
    with pytest.raises(DataError, match=words):
        read_driven([BAG], columns, ACTIONS, world)


def test_a_recording_without_actions_is_refused(monkeypatch):
    opened = Recording.__init__

    def without(self, path):
        opened(self, path)
        self.topics = {name: info for name, info in self.topics.items() if 'action' not in name}

    monkeypatch.setattr(Recording, '__init__', without)
    with pytest.raises(DataError, match=f'has no topic /action of {TABLE_TYPE}'):
        read_driven([BAG], COLUMNS, ACTIONS, 'PointGoal1')
