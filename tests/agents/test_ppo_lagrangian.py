# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The learner: what it counts, what it refuses, and that it continues from a checkpoint."""

import copy
import dataclasses
import math
import os

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from line_world import LineWorld
from occ_constraints_pkg.agents.ppo_lagrangian import Multiplier, penalised
from occ_constraints_pkg.agents.settings import PPOLagrangianConfig

torch = pytest.importorskip('torch')

from occ_constraints_pkg.agents.checkpoint import read_checkpoint, write_checkpoint  # noqa: E402
from occ_constraints_pkg.agents.ppo_lagrangian import PPOLagrangian  # noqa: E402
from occ_constraints_pkg.errors import ConfigurationError, OccError  # noqa: E402
from occ_constraints_pkg.worlds.stream import EpisodeStream  # noqa: E402

SMALL = PPOLagrangianConfig(rollout_steps=16, minibatch=64, hidden=(8, 8), passes=2, cost_limit=2.0)


def make_learner(seed=0, **settings):
    config = dataclasses.replace(SMALL, **settings)
    return PPOLagrangian(config, LineWorld.columns, LineWorld.action_columns, 'line', seed)


def run(learner, stream, batch, calls, spoil=None):
    """Feed ``calls`` steps; ``spoil(batch)`` changes what the learner is shown."""
    metrics = []
    for _ in range(calls):
        shown = batch if spoil is None else spoil(batch)
        updates = learner.updates
        action = learner.act(shown, shown.true_cost)
        if learner.updates > updates:
            metrics.append(learner.metrics)
        batch = stream.step(action)
    return batch, metrics


def untimed(metrics):
    return [
        [value for name, value in item.as_dict().items() if not name.endswith('_s')]
        for item in metrics
    ]


def same_policy(one, other):
    one, other = one.policy(), other.policy()
    pairs = [*zip(one.weights, other.weights, strict=True), (one.log_std, other.log_std)]
    return all(np.array_equal(x, y) for x, y in pairs)


@pytest.mark.parametrize('cliff', [False, True])
def test_what_comes_with_first_states_is_no_matter(cliff):
    """No step led to a first state: its reward and cost must not reach losses or statistics."""

    def spoil(batch, last=[None]):  # noqa: B006
        fresh = np.ones(8, bool) if last[0] is None else last[0].done
        last[0] = batch
        return dataclasses.replace(
            batch,
            reward=np.where(fresh, 1e3, batch.reward),
            true_cost=np.where(fresh, 1.0, batch.true_cost),
        )

    curves = []
    for how in (None, spoil):
        learner, stream = make_learner(), EpisodeStream(LineWorld(8, cliff=cliff), seed=1)
        curves.append(untimed(run(learner, stream, stream.reset(), 100, how)[1]))
    assert len(curves[0]) == 6
    np.testing.assert_array_equal(*curves)


def test_episodes_and_steps_are_counted_once():
    learner, stream = make_learner(rollout_steps=21), EpisodeStream(LineWorld(8), seed=1)
    batch = stream.reset()
    totals, cost, seen = np.zeros(8), np.zeros(8), []
    for call in range(43):
        action = learner.act(batch, batch.true_cost)
        if call == 21:
            # One episode: states 0 to 20, and its last state's reset transition.
            assert learner.steps == 8 * 20
            assert learner.metrics.episodes == 8
            assert learner.metrics.mean_return == pytest.approx(np.mean(totals))
            assert learner.metrics.mean_cost == pytest.approx(np.mean(cost))
            assert learner.metrics.mean_length == 20
        seen.append(learner.steps)
        batch = stream.step(action)
        totals += batch.reward
        cost += batch.true_cost * (call != 20)
    assert [seen[call] for call in (0, 20, 21, 42)] == [0, 160, 160, 320]


def test_multiplier_follows_the_cost_of_episodes_once_there_are_any():
    def multipliers(limit, start):
        learner = make_learner(cost_limit=limit, multiplier_init=start, multiplier_rate=0.1)
        stream = EpisodeStream(LineWorld(8), seed=1)
        always = np.ones(8)
        batch, found = stream.reset(), []
        for _ in range(120):
            updates = learner.updates
            action = learner.act(batch, always)
            if learner.updates > updates:
                found.append(learner.multiplier)
            batch = stream.step(action)
        return found

    # Every episode costs 20; none has finished at the first update.
    rising, falling = multipliers(15.0, 0.5), multipliers(25.0, 0.25)
    assert (rising[0], falling[0]) == (0.5, 0.25)
    assert (np.diff(rising) > 0).all()
    assert (np.diff(falling) <= 0).all()
    assert falling[-1] == 0.0


@pytest.mark.parametrize('decay_steps', [0, 500])
def test_step_sizes_fall_to_a_tenth(decay_steps):
    learner, stream = make_learner(decay_steps=decay_steps), EpisodeStream(LineWorld(8), seed=1)
    batch, sizes = stream.reset(), []
    for _ in range(6):
        batch, _ = run(learner, stream, batch, 17)
        sizes.append(learner._optimiser.param_groups[0]['lr'])
    if decay_steps:
        assert (np.diff(sizes) <= 0).all()
        assert sizes[-1] == pytest.approx(1e-4)
    else:
        assert sizes == [1e-3] * 6


def test_unconstrained_mode_ignores_the_cost():
    learners = []
    for factor in (0.0, 1.0):
        learner, stream = make_learner(lagrangian=False), EpisodeStream(LineWorld(8), seed=1)
        run(
            learner,
            stream,
            stream.reset(),
            60,
            lambda batch, factor=factor: dataclasses.replace(
                batch, true_cost=batch.true_cost * factor
            ),
        )
        learners.append(learner)
    assert learners[0].updates == 3
    assert learners[0].metrics.multiplier == 0.0
    assert same_policy(*learners)


@pytest.mark.parametrize('calls', [0, 1, 40, 49])
def test_a_checkpoint_continues_exactly(tmp_path, calls):
    """Saved before the first step, after it, within a rollout and right after an update."""
    learner, stream = make_learner(), EpisodeStream(LineWorld(8, cliff=True), seed=1)
    batch, _ = run(learner, stream, stream.reset(), calls)
    learner.save(tmp_path / 'checkpoint.pt')
    twin, its_stream = PPOLagrangian.load(tmp_path / 'checkpoint.pt'), copy.deepcopy(stream)
    assert (twin.steps, twin.updates, twin.metrics) == (
        learner.steps,
        learner.updates,
        learner.metrics,
    )
    _, curve = run(learner, stream, batch, 100)
    _, its_curve = run(twin, its_stream, batch, 100)
    assert len(curve) >= 6
    np.testing.assert_array_equal(untimed(curve), untimed(its_curve))
    assert same_policy(learner, twin)


def test_choosing_ahead_changes_nothing():
    curves = []
    for ahead in (False, True):
        learner, stream = make_learner(), EpisodeStream(LineWorld(8), seed=1)
        batch, found = stream.reset(), []
        for _ in range(100):
            if ahead:
                learner.choose(batch)
            batch, metrics = run(learner, stream, batch, 1)
            found += metrics
        curves.append(untimed(found))
    assert len(curves[0]) == 6
    np.testing.assert_array_equal(*curves)


def test_an_interruption_loses_one_transition_and_counts_nothing_twice():
    learner, stream = make_learner(rollout_steps=1000), EpisodeStream(LineWorld(8), seed=1)
    run(learner, stream, stream.reset(), 10)
    assert learner.steps == 8 * 9
    learner.interrupt()
    learner.interrupt()
    stream = EpisodeStream(LineWorld(8), seed=2)
    run(learner, stream, stream.reset(), 21)
    assert learner.steps == 8 * (9 + 20)
    assert learner._rollout.valid[:30].sum() == learner.steps
    assert not learner._rollout.valid[9].any()
    assert learner._episodes.means()[2] == 20


def test_episodes_joined_in_the_middle_are_not_counted():
    learner, stream = make_learner(rollout_steps=1000), EpisodeStream(LineWorld(8), seed=1)
    batch, _ = run(learner, stream, stream.reset(), 10)
    learner.interrupt(new_episodes=False)
    batch, _ = run(learner, stream, batch, 12)
    assert learner._episodes.finished == 0
    run(learner, stream, batch, 21)
    assert learner._episodes.finished == 8
    assert learner._episodes.means()[2] == 20


def spoiled(batch, what):
    if what == 'cost':
        return batch, np.full(8, np.nan)
    if what == 'one cost':
        return batch, np.where(np.arange(8) == 3, np.nan, 0.0)
    if what == 'shape':
        return batch, np.zeros((8, 1))
    if what == 'robots':
        part = {f.name: getattr(batch, f.name)[:4] for f in dataclasses.fields(batch)}
        return type(batch)(**part), np.zeros(4)
    faulty = np.full_like(getattr(batch, what), np.inf)
    return dataclasses.replace(batch, **{what: faulty}), np.zeros(8)


@pytest.mark.parametrize('what', ['cost', 'one cost', 'shape', 'robots', 'observation', 'reward'])
def test_a_faulty_step_is_refused_and_changes_nothing(what):
    learner, stream = make_learner(), EpisodeStream(LineWorld(8), seed=1)
    batch, _ = run(learner, stream, stream.reset(), 16)
    twin, its_stream = copy.deepcopy(learner), copy.deepcopy(stream)
    with pytest.raises(OccError, match='the learner got'):
        learner.act(*spoiled(batch, what))
    run(learner, stream, batch, 40)
    run(twin, its_stream, batch, 40)
    assert learner.updates == 3
    assert same_policy(learner, twin)


def test_the_policy_acts_as_the_network_that_was_trained():
    learner, stream = make_learner(), EpisodeStream(LineWorld(8), seed=1)
    run(learner, stream, stream.reset(), 60)
    x = np.linspace(-3, 3, 200, dtype=np.float32)[:, None]
    with torch.no_grad():
        expected = learner._actor(learner._normalised(x)).numpy()
    np.testing.assert_allclose(learner.policy().act(x), expected, atol=1e-5)


def test_a_snapshot_does_not_change_with_the_learner():
    learner, stream = make_learner(), EpisodeStream(LineWorld(8), seed=1)
    before, fresh = learner.policy(), learner.policy()
    run(learner, stream, stream.reset(), 60)
    np.testing.assert_array_equal(before.weights[0], make_learner().policy().weights[0])
    assert before.act(np.ones((1, 1))) == fresh.act(np.ones((1, 1)))
    assert not np.array_equal(before.weights[0], learner.policy().weights[0])


class Trap:
    """Pickles as a call that makes a directory."""

    def __init__(self, path):
        self.path = str(path)

    def __reduce__(self):
        return os.mkdir, (self.path,)


def test_a_file_with_code_is_refused_and_not_executed(tmp_path):
    torch.save({'format': Trap(tmp_path / 'sprung')}, tmp_path / 'trap.pt')
    with pytest.raises(OccError, match='not a checkpoint'):
        PPOLagrangian.load(tmp_path / 'trap.pt')
    assert not (tmp_path / 'sprung').exists()


def test_other_files_are_refused(tmp_path):
    (tmp_path / 'text').write_text('hello')
    (tmp_path / 'empty').write_bytes(b'')
    torch.save({'weights': torch.zeros(2)}, tmp_path / 'foreign')
    torch.save(torch.zeros(2), tmp_path / 'tensor')
    for name in ('text', 'empty', 'foreign', 'tensor'):
        with pytest.raises(OccError, match='not a checkpoint'):
            PPOLagrangian.load(tmp_path / name)
    with pytest.raises(OccError, match='cannot read'):
        PPOLagrangian.load(tmp_path / 'nowhere')
    make_learner().save(tmp_path / 'good')
    state = torch.load(tmp_path / 'good', weights_only=True)
    for change in ({'networks': {}}, {'config': {'no_such': 1}}, {'rng': 'x'}, {'config': 3}):
        torch.save(state | {'learner': state['learner'] | change}, tmp_path / 'damaged')
        with pytest.raises(OccError, match='damaged'):
            PPOLagrangian.load(tmp_path / 'damaged')


def test_a_setting_that_is_refused_on_resumption_does_not_blame_the_checkpoint(tmp_path):
    make_learner().save(tmp_path / 'good')
    with pytest.raises(ConfigurationError, match='^learner setting window is 0; allowed'):
        PPOLagrangian.load(tmp_path / 'good', window=0)


@pytest.mark.parametrize(
    'setting',
    [
        {'cost_limit': -1.0},
        {'cost_limit': float('nan')},
        {'gamma': 1.1},
        {'rollout_steps': 0},
        {'actor_lr': 0.0},
        {'hidden': (0,)},
        {'multiplier_rate': -0.1},
        {'multiplier_band': 0.0},
        {'cost_memory': 0.0},
        {'log_std_end': 21.0},
        {'decay_steps': -1},
    ],
)
def test_settings_outside_their_range_are_refused(setting):
    with pytest.raises(OccError, match=f'learner setting {next(iter(setting))} '):
        PPOLagrangianConfig(**setting)


def test_an_unknown_device_is_refused():
    with pytest.raises(OccError, match="device is 'abacus'"):
        make_learner(device='abacus')


@pytest.mark.skipif(torch.cuda.is_available(), reason='there is a GPU')
def test_without_a_gpu_cuda_is_refused_also_when_resuming(tmp_path):
    with pytest.raises(OccError, match="device is 'cuda'; this machine has cpu"):
        make_learner(device='cuda')
    make_learner().save(tmp_path / 'checkpoint.pt')
    with pytest.raises(OccError, match="device is 'cuda'; this machine has cpu"):
        PPOLagrangian.load(tmp_path / 'checkpoint.pt', device='cuda')


@pytest.mark.skipif(not torch.cuda.is_available(), reason='there is no GPU')
def test_a_gpu_learns_the_same():
    curves = []
    for device in ('cpu', 'cuda'):
        learner, stream = make_learner(device=device), EpisodeStream(LineWorld(8), seed=1)
        _, curve = run(learner, stream, stream.reset(), 60)
        curves.append([[item.kl, item.value_loss, item.policy_loss] for item in curve])
    np.testing.assert_allclose(*curves, rtol=1e-2, atol=1e-4)


def _multiplier(limit=25.0, start=1.0, **settings):
    chosen = {
        'cost_limit': limit,
        'multiplier_init': start,
        'multiplier_rate': 0.05,
        'multiplier_gain': 0.5,
        'multiplier_band': 0.2,
        'cost_memory': 10.0,
    }
    return Multiplier(PPOLagrangianConfig(**chosen | settings))


# So many that only the latest rollout counts.
MANY = 1e6


def test_the_multiplier_follows_a_known_course():
    multiplier = _multiplier()
    # One unit is a fifth of the limit: 5.
    for cost, integral, value in [
        (27.5, 1.025, 1.275),
        (125.0, 1.075, 1.575),
        (25.0, 1.075, 1.075),
        (24.0, 1.065, 0.965),
        (0.0, 1.015, 0.515),
    ]:
        multiplier.update(cost, MANY)
        assert multiplier.integral == pytest.approx(integral)
        assert multiplier.value == pytest.approx(value)


def test_the_multiplier_stays_before_the_first_episode():
    multiplier = _multiplier()
    multiplier.update(math.nan, math.nan)
    assert multiplier.state()[:2] == [1.0, 1.0]
    assert math.isnan(multiplier.cost)


@given(st.floats(0, 1e3), st.lists(st.floats(0, 1e3), min_size=1, max_size=20), st.floats(0, 100))
def test_the_cost_that_the_multiplier_follows_depends_on_no_length_of_rollouts(first, costs, n):
    """A rollout counts as much as two halves of it."""
    whole, halves = _multiplier(), _multiplier()
    for cost in (first, *costs):
        whole.update(cost, n)
        halves.update(cost, n / 2)
        halves.update(cost, n / 2)
        assert halves.cost == pytest.approx(whole.cost)
        assert min(first, *costs) - 1e-9 <= whole.cost <= max(first, *costs) + 1e-9


@given(st.integers(1, 500), st.floats(25.01, 1e6))
def test_the_multiplier_falls_at_once_after_however_long_an_excess(updates, excess):
    """No part of it goes on rising, or waits, when the cost is within its limit again."""
    multiplier = _multiplier()
    for _ in range(updates):
        multiplier.update(excess, MANY)
    before = multiplier.state()
    multiplier.update(24.0, MANY)
    assert multiplier.value < multiplier.integral < before[0] < before[1]
    # It takes no longer to fall than it took to rise.
    for _ in range(updates):
        multiplier.update(0.0, MANY)
    assert multiplier.integral <= 1.0 + 1e-9


@given(
    st.floats(0, 1e3),
    st.lists(st.floats(0, 1e6), min_size=1, max_size=50),
    st.floats(0.01, 1e3),
)
def test_the_multiplier_is_never_negative_and_moves_by_bounded_steps(limit, costs, episodes):
    multiplier = _multiplier(limit)
    for cost in costs:
        before = multiplier.integral
        multiplier.update(cost, episodes)
        assert multiplier.value >= 0.0
        assert 0.0 <= multiplier.integral <= before + 0.05 + 1e-12
        assert abs(multiplier.value - multiplier.integral) <= 0.5 + 1e-9


def test_the_multiplier_settles_where_the_cost_meets_its_limit():
    """A cost that falls as the multiplier rises, with some delay."""
    multiplier, cost, costs = _multiplier(start=0.001), 60.0, []
    for _ in range(600):
        cost += 0.1 * (60.0 - 12.0 * multiplier.value - cost)
        multiplier.update(cost, 10.0)
        costs.append(cost)
    np.testing.assert_allclose(costs[-100:], 25.0, atol=0.1)
    assert min(costs) > 20.0


@given(st.integers(0, 2**32), st.floats(0, 1e6))
def test_reward_and_cost_share_one_objective_of_bounded_size(seed, multiplier):
    rng = np.random.default_rng(seed)
    advantage, cost = rng.normal(3.0, 50.0, 100), rng.normal(1.0, 0.3, 100)
    gain, price = penalised(advantage, cost, 0.0), cost - cost.mean()
    found = penalised(advantage, cost, multiplier)
    assert found.mean() == pytest.approx(0.0, abs=1e-9)
    assert found.std() <= max(gain.std(), price.std()) + 1e-9
    # Between reward alone and cost alone, in the proportion that the multiplier sets.
    weight = multiplier / (1.0 + multiplier)
    np.testing.assert_allclose(found, (1.0 - weight) * gain - weight * price, atol=1e-9)
    np.testing.assert_allclose(penalised(7.0 * advantage + 2.0, cost, multiplier), found, atol=1e-6)


@pytest.mark.parametrize(('start', 'end'), [(0.0, -1.5), (-1.0, 0.0)])
def test_the_noise_is_bounded_by_a_schedule(start, end):
    learner = make_learner(log_std_init=start, log_std_end=end, decay_steps=800, actor_lr=0.1)
    stream = EpisodeStream(LineWorld(8), seed=1)
    batch = stream.reset()
    for _ in range(8):
        batch, metrics = run(learner, stream, batch, 17)
        share = min(1.0, metrics[-1].steps / 800) if metrics else 0.0
        if end < start:
            assert (learner.policy().log_std <= start + share * (end - start) + 1e-6).all()
    assert share == 1.0


def test_schedules_follow_the_time_where_that_ends_first():
    learner = make_learner(decay_steps=10**9, log_std_init=0.0, log_std_end=-1.5)
    stream = EpisodeStream(LineWorld(8), seed=1)
    learner.time_share = 1.0
    run(learner, stream, stream.reset(), 17)
    assert learner._optimiser.param_groups[0]['lr'] == pytest.approx(1e-4)
    assert (learner.policy().log_std <= -1.5 + 1e-6).all()


def test_an_older_checkpoint_goes_on_with_the_noise_that_it_had(tmp_path):
    """Before there was a schedule of the noise, and before the multiplier kept a mean cost."""
    learner = make_learner(log_std_end=-3.0)
    stream = EpisodeStream(LineWorld(8), seed=1)
    batch, _ = run(learner, stream, stream.reset(), 40)
    learner.save(tmp_path / 'new.pt')
    state = read_checkpoint(tmp_path / 'new.pt')
    for name in ('log_std_end', 'cost_memory'):
        del state['learner']['config'][name]
    state['learner']['multiplier'] = [0.5, 0.75]
    write_checkpoint(tmp_path / 'old.pt', state)
    older = PPOLagrangian.load(tmp_path / 'old.pt')
    assert older.multiplier == 0.75
    assert older.config.log_std_end == older.config.log_std_init
    run(older, stream, batch, 20)
    assert older.updates == learner.updates + 1


def demonstrations(n=400):
    rng = np.random.default_rng(3)
    columns, actions = len(LineWorld.columns), len(LineWorld.action_columns)
    observations = rng.normal(size=(n, columns)).astype(np.float32)
    return observations, np.tile(np.tanh(observations[:, :1]), (1, actions))


def test_a_cloned_policy_acts_as_demonstrated():
    learner = make_learner()
    observations, actions = demonstrations()
    before = np.square(learner.policy().act(observations) - actions).mean()
    noise = learner.policy().log_std
    error = learner.clone(observations, actions)
    policy = learner.policy()
    after = np.square(policy.act(observations) - actions).mean()
    assert after < before / 4
    assert error == pytest.approx(after, rel=0.5)
    assert np.array_equal(policy.log_std, noise)


def test_the_policy_stays_while_only_critics_learn():
    learner = make_learner(critic_updates=2)
    learner.clone(*demonstrations())
    cloned, critic = copy.deepcopy(learner), learner._critic.state_dict()
    critic = {name: weights.clone() for name, weights in critic.items()}
    stream = EpisodeStream(LineWorld(4), seed=0)
    batch, metrics = run(learner, stream, stream.reset(), 2 * SMALL.rollout_steps + 1)
    assert len(metrics) == 2
    assert same_policy(cloned, learner)
    assert any(not torch.equal(critic[name], w) for name, w in learner._critic.state_dict().items())
    run(learner, stream, batch, SMALL.rollout_steps)
    assert not same_policy(cloned, learner)


@pytest.mark.parametrize(
    ('spoil', 'words'),
    [
        (lambda o, a: (o[:0], a[:0]), 'n at least 1'),
        (lambda o, a: (o[:, 1:], a), 'cannot be cloned; allowed are'),
        (lambda o, a: (o, a[1:]), 'cannot be cloned; allowed are'),
        (lambda o, a: (o, np.where(a > 0, np.nan, a)), 'not finite'),
    ],
)
def test_what_cannot_be_cloned_is_refused(spoil, words):
    learner = make_learner()
    with pytest.raises(OccError, match=words):
        learner.clone(*spoil(*demonstrations()))


def test_a_learner_that_has_begun_does_not_clone():
    learner = make_learner()
    stream = EpisodeStream(LineWorld(4), seed=0)
    run(learner, stream, stream.reset(), 1)
    with pytest.raises(ConfigurationError, match='only be cloned before training'):
        learner.clone(*demonstrations())
