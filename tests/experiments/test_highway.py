# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
import json
from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip('torch')
pytest.importorskip('highway_env')
pytest.importorskip('matplotlib')

from occ_constraints_pkg.agents.policy import GaussianPolicy
from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.worlds.highway import Highway
from occ_constraints_pkg.worlds.stream import EpisodeStream

from experiments.highway import (
    HighwaySettings,
    rules_for,
    run_highway,
    train_agent,
)
from experiments.highway_agents import (
    OUTCOMES,
    CountedHighway,
    LastingRuleCost,
    safety_reward,
)
from experiments.highway_fidelity import drive_both

TINY = HighwaySettings(
    sets=('restricted',),
    agents=('RL', 'ours'),
    seeds=1,
    steps=1100,
    robots=16,
    episodes=4,
    in_highway_env=0,
    drawn=None,
)
COLUMNS = [column.name for column in Highway.columns]


@pytest.fixture(scope='module')
def rules(tmp_path_factory):
    return rules_for(tmp_path_factory.mktemp('rules'), 'restricted', None)


def observation(**values):
    row = np.zeros((1, len(COLUMNS)))
    row[0, 2:8] = 500.0
    for name, value in values.items():
        row[0, COLUMNS.index(name)] = value
    return row


def test_each_episode_is_counted_once_with_how_it_ended():
    world = CountedHighway(30, scenarios=52)
    stream = EpisodeStream(world, seed=0)
    batch = stream.reset()
    seen, returns = np.zeros(2), 0.0
    for _ in range(260):
        batch = stream.step(np.where(np.arange(30)[:, None] < 15, [0.0, 0.1], [0.3, 0.0]))
        seen += [batch.done.sum(), batch.terminated.sum()]
        returns += batch.reward.sum()
    totals = dict(zip(OUTCOMES, world.totals, strict=True))
    assert totals['episodes'] == seen[0]
    assert totals['collision'] + totals['off_road'] == seen[1]
    assert totals['off_road'] > 15
    assert 0 < totals['return'] <= returns


def test_the_engineered_reward_punishes_ends_and_following_too_closely():
    no, yes = np.array([False]), np.array([True])
    fine = {'collision': no, 'off_road': no}
    far = observation(v_x=30.0, p_rel4=100.0, v_rel4=-10.0)
    assert safety_reward(far, fine)[0] == 0
    # Braking from 30 to 20 m/s at 11.5 m/s^2 takes 21.7 m.
    near = observation(v_x=30.0, p_rel4=10.0, v_rel4=-10.0)
    assert safety_reward(near, fine)[0] == pytest.approx(-np.exp(-5 * 10 * 23 / 500))
    assert safety_reward(far, fine | {'collision': yes})[0] == -30
    assert safety_reward(far, fine | {'off_road': yes})[0] == -50


def test_a_violation_that_ends_an_episode_costs_for_the_rest_of_the_time(rules):
    world = CountedHighway(30, scenarios=52)
    source, stream = LastingRuleCost(rules, world), EpisodeStream(world, seed=0)
    batch = stream.reset()
    length, ends = np.zeros(30), 0
    for _ in range(80):
        length = np.where(batch.done, 0, length + 1)
        batch = stream.step(np.where(np.arange(30)[:, None] < 15, [0.0, 0.1], [1.0, 0.0]))
        cost = source(batch)
        assert set(cost[~batch.terminated]) <= {0.0, 1.0}
        np.testing.assert_array_equal(cost[batch.terminated], 201 - length[batch.terminated])
        ends += batch.terminated.sum()
    assert ends > 15


def test_rules_of_the_traffic_say_how_near_is_too_near(rules):
    words = [rule.words(rules.rule_set.space) for rule in rules.rule_set.rules]
    for name in ('p_rel4 below', 'd_left below', 'd_right below', 'v_x above'):
        assert any(text.startswith(name) for text in words)
    assert rules.coverage['held_out'] > 0.99


def test_a_policy_drives_in_highway_env_as_in_the_batched_world():
    columns = len(COLUMNS)
    weight = np.zeros((columns, 2), dtype=np.float32)
    # Full speed, and to the left or right by what is behind.
    weight[COLUMNS.index('near1')] = 0.0, 0.3
    policy = GaussianPolicy(
        world='highway',
        columns=tuple(COLUMNS),
        action_columns=('acceleration', 'steering'),
        observation_mean=np.zeros(columns, dtype=np.float32),
        observation_variance=np.ones(columns, dtype=np.float32),
        observation_clip=1e6,
        weights=(weight,),
        biases=(np.array([1.0, -0.03], dtype=np.float32),),
        log_std=np.zeros(2, dtype=np.float32),
    )
    ends = drive_both(policy, range(4))
    assert ends.drives == ends.alike == 4
    assert ends.collision + ends.off_road == 4


def test_an_experiment_leaves_table_and_figure_and_can_be_run_again(tmp_path):
    document = run_highway(tmp_path, TINY)
    assert [line['agent'] for line in document['lines']] == ['RL', 'ours']
    for line in document['lines']:
        assert line['sampled']['episodes'] == line['mean']['episodes'] == 4
        assert line['curve'][-1]['steps'] > 900
    table = (tmp_path / 'highway.md').read_text()
    assert table.count('restricted') == 4
    assert (tmp_path / 'highway.png').stat().st_size > 1000
    again = run_highway(tmp_path, TINY)
    assert json.dumps(again['lines']) == json.dumps(document['lines'])
    with pytest.raises(OccError, match='so many or more, got 1030'):
        run_highway(tmp_path, replace(TINY, steps=1030))
    with pytest.raises(OccError, match='steps is 1000, .* allowed is 1024 or more'):
        run_highway(tmp_path, replace(TINY, steps=1000))


def test_a_resumed_training_is_that_of_one_that_was_never_stopped(tmp_path, rules):
    looks = {'stopped': iter([False] * 60 + [True] * 1000), 'whole': None}
    for name, stops in looks.items():
        stop = (lambda: False) if stops is None else stops.__next__
        for is_stopped in (stop, lambda: False):
            train_agent(
                tmp_path / name,
                HighwaySettings(steps=3000, robots=16),
                52,
                'ours',
                0,
                rules,
                progress=lambda steps: None,
                is_stopped=is_stopped,
            )
    one, other = (GaussianPolicy.load(tmp_path / name / 'policy.npz') for name in looks)
    np.testing.assert_array_equal(one.weights[0], other.weights[0])
    logs = [(tmp_path / name / 'outcomes.jsonl').read_text() for name in looks]
    assert logs[0] == logs[1]
