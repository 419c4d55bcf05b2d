# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The policy file: what is written is read, what is not a policy is refused."""

import dataclasses

import numpy as np
import pytest
from occ_constraints_pkg.agents.policy import GaussianPolicy
from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.worlds.base import Column


def make_policy(seed=0, k=3, a=2, hidden=(5, 4)):
    rng = np.random.default_rng(seed)

    def array(*shape):
        return rng.standard_normal(shape).astype(np.float32)

    widths = (k, *hidden, a)
    return GaussianPolicy(
        world='line',
        columns=tuple(f'c_{i}' for i in range(k)),
        action_columns=tuple(f'a_{i}' for i in range(a)),
        observation_mean=array(k),
        observation_variance=array(k) ** 2 + np.float32(0.1),
        observation_clip=5.0,
        weights=tuple(array(i, o) for i, o in zip(widths[:-1], widths[1:], strict=True)),
        biases=tuple(array(o) for o in widths[1:]),
        log_std=array(a),
    )


def test_mean_action_is_the_documented_formula():
    policy = make_policy()
    x = np.random.default_rng(1).normal(0, 20, (300, 3)).astype(np.float32)
    z = np.clip((x - policy.observation_mean) / np.sqrt(policy.observation_variance), -5, 5)
    for weight, bias in zip(policy.weights[:-1], policy.biases[:-1], strict=True):
        z = np.tanh(z @ weight + bias)
    expected = z @ policy.weights[-1] + policy.biases[-1]
    np.testing.assert_allclose(policy.act(x), expected, rtol=1e-5, atol=1e-5)


def test_each_row_is_acted_on_alone():
    """Large batches are computed in pieces; a robot must not notice."""
    policy = make_policy(k=60, hidden=(64, 64))
    x = np.random.default_rng(1).normal(size=(300, 60))
    np.testing.assert_allclose(policy.act(x)[277:278], policy.act(x[277:278]), atol=1e-4)


def test_sampling_follows_the_log_std_and_the_given_generator():
    policy = make_policy()
    x = np.tile(np.float32([[0.1, 0.2, 0.3]]), (20000, 1))
    drawn = policy.act(x, np.random.default_rng(3))
    np.testing.assert_array_equal(drawn, policy.act(x, np.random.default_rng(3)))
    std = np.exp(policy.log_std)
    np.testing.assert_allclose(drawn.std(axis=0), std, rtol=0.03)
    np.testing.assert_allclose(drawn.mean(axis=0), policy.act(x[:1])[0], atol=0.05 * std.max())


def test_round_trip(tmp_path):
    policy, path = make_policy(), tmp_path / 'pilot.policy'
    policy.save(path)
    again = GaussianPolicy.load(path)
    for field in dataclasses.fields(policy):
        old, new = getattr(policy, field.name), getattr(again, field.name)
        if isinstance(old, tuple) and isinstance(old[0], np.ndarray):
            assert all(np.array_equal(x, y) for x, y in zip(old, new, strict=True))
        else:
            assert np.array_equal(old, new), field.name
    assert [item.name for item in tmp_path.iterdir()] == ['pilot.policy']


def damage(path, **changes):
    """Rewrite some fields of a policy file; ``None`` removes one."""
    with np.load(path) as archive:
        fields = {name: archive[name] for name in archive.files} | changes
    with path.open('wb') as file:
        np.savez(file, **{name: value for name, value in fields.items() if value is not None})


@pytest.mark.parametrize(
    ('changes', 'told'),
    [
        ({'format': np.array('something else')}, 'format'),
        ({'log_std': None}, 'log_std'),
        ({'bias_1': None}, 'bias_1'),
        ({'log_std': np.zeros(3, np.float32)}, 'log_std'),
        ({'weight_1': np.zeros((4, 4), np.float32)}, 'weight_1'),
        ({'weight_0': np.full((3, 5), np.nan, np.float32)}, 'weight_0'),
        ({'bias_2': np.zeros(7, np.float32)}, 'outputs'),
        ({'observation_mean': np.zeros((3, 1), np.float32)}, 'observation_mean'),
        ({'observation_variance': np.zeros(3, np.float32)}, 'observation_variance'),
        ({'observation_clip': np.zeros(2)}, 'damaged'),
        ({'columns': np.array('c_0')}, 'damaged'),
        ({'log_std': np.array([{}, {}], dtype=object)}, 'not a policy file'),
    ],
)
def test_a_damaged_file_is_refused(tmp_path, changes, told):
    path = tmp_path / 'policy.npz'
    make_policy().save(path)
    damage(path, **changes)
    with pytest.raises(OccError, match=told) as refusal:
        GaussianPolicy.load(path)
    assert str(path) in str(refusal.value)


@pytest.mark.parametrize('content', [b'', b'hello', b'PK\x03\x04 broken', b'\x80\x04.'])
def test_a_file_of_another_kind_is_refused(tmp_path, content):
    path = tmp_path / 'policy.npz'
    path.write_bytes(content)
    with pytest.raises(OccError, match='not a policy file'):
        GaussianPolicy.load(path)


def test_a_bare_array_and_a_missing_file_are_refused(tmp_path):
    np.save(tmp_path / 'array.npy', np.zeros(3))
    with pytest.raises(OccError, match='not a policy file'):
        GaussianPolicy.load(tmp_path / 'array.npy')
    with pytest.raises(OccError, match='cannot read'):
        GaussianPolicy.load(tmp_path / 'nowhere.npz')


def test_only_a_world_with_the_same_columns_in_order_is_accepted():
    policy = make_policy()
    policy.check_world([Column('c_0'), 'c_1', 'c_2'], ['a_0', 'a_1'])
    with pytest.raises(OccError, match="column 1 is 'c_2' where the policy has 'c_1'"):
        policy.check_world(['c_0', 'c_2', 'c_1'], ['a_0', 'a_1'])
    with pytest.raises(OccError, match="column 2 is nothing where the policy has 'c_2'"):
        policy.check_world(['c_0', 'c_1'], ['a_0', 'a_1'])
    with pytest.raises(OccError, match="action columns .* column 2 is 'a_2'"):
        policy.check_world(['c_0', 'c_1', 'c_2'], ['a_0', 'a_1', 'a_2'])


@pytest.mark.parametrize('observation', [np.zeros((2, 4)), np.zeros(3), np.full((1, 3), np.nan)])
def test_a_faulty_observation_is_refused(observation):
    with pytest.raises(OccError, match='observation'):
        make_policy().act(observation)
