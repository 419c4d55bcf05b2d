# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Training as a whole: it learns, obeys its limit, ends when told and writes its log."""

import errno
import json
from pathlib import Path

import numpy as np
import pytest
from line_world import LineWorld

pytest.importorskip('torch')

from occ_constraints_pkg.agents.evaluation import evaluate  # noqa: E402
from occ_constraints_pkg.agents.ppo_lagrangian import PPOLagrangian  # noqa: E402
from occ_constraints_pkg.agents.rule_cost import RuleCost  # noqa: E402
from occ_constraints_pkg.agents.run import RunSettings, check  # noqa: E402
from occ_constraints_pkg.agents.settings import PPOLagrangianConfig, learner_settings  # noqa: E402
from occ_constraints_pkg.agents.training import TrainingDirectory, TrueCost, train  # noqa: E402
from occ_constraints_pkg.errors import OccError  # noqa: E402
from occ_constraints_pkg.rules import Feature, FeatureSpace, Literal, Rule, RuleSet  # noqa: E402
from occ_constraints_pkg.rules.constraints_file import Constraints  # noqa: E402


def make_learner(world, **settings):
    config = PPOLagrangianConfig(
        rollout_steps=40, minibatch=512, hidden=(32, 32), cost_limit=2.0, **settings
    )
    return PPOLagrangian(config, world.columns, world.action_columns, world.name, seed=0)


def test_learns_to_go_right_and_with_a_limit_to_stop_in_time():
    """Unconstrained, nearly all of the way is worth taking; with the limit it ends before 0.7."""
    world = LineWorld(32)
    results = {}
    for lagrangian in (False, True):
        learner = make_learner(world, lagrangian=lagrangian)
        train(world, learner, TrueCost(), seed=1, total_steps=60_000)
        rng = np.random.default_rng(0)
        policy = learner.policy()
        results[lagrangian] = evaluate(
            world, lambda x, p=policy, g=rng: p.act(x, g), episodes=100, seed=2
        ).as_dict()
    assert results[False]['return'] > 16
    assert results[False]['cost'] > 14
    assert results[True]['cost'] < 5
    assert 9 < results[True]['return'] < 15


def test_the_cost_comes_from_the_source(tmp_path):
    world = LineWorld(8)
    learner = make_learner(world)
    history = train(
        world,
        learner,
        lambda batch: np.ones(8),
        seed=1,
        total_steps=1000,
        directory=TrainingDirectory(tmp_path / 'run'),
    )
    assert history[-1].mean_cost == 20.0


def test_a_training_that_diverges_ends_with_a_sentence_and_leaves_what_was_saved(tmp_path):
    world, directory = LineWorld(8), TrainingDirectory(tmp_path)
    learner = make_learner(world)
    options = {'seed': 1, 'directory': directory}
    train(world, learner, TrueCost(), total_steps=500, **options)
    before = (tmp_path / 'policy.npz').read_bytes()
    learner._optimiser.param_groups[0]['lr'] = 1e38
    with pytest.raises(OccError, match='training has diverged: .* than actor_lr '):
        train(world, learner, TrueCost(), total_steps=5000, **options)
    assert (tmp_path / 'policy.npz').read_bytes() == before


def test_log_progress_and_end(tmp_path):
    world, told = LineWorld(8), []
    learner, directory = make_learner(world), TrainingDirectory(tmp_path)
    options = {'seed': 1, 'progress': told.append, 'directory': directory}
    history = train(world, learner, TrueCost(), total_steps=1000, **options)
    assert 1000 <= learner.steps < 1008
    history += train(world, learner, TrueCost(), total_steps=2000, **options)
    assert 2000 <= learner.steps < 2008
    lines = [json.loads(line) for line in (tmp_path / 'metrics.jsonl').read_text().splitlines()]
    assert lines == [item.as_dict() for item in history] == [item.as_dict() for item in told]
    assert [line['updates'] for line in lines] == list(range(1, len(lines) + 1))


def test_numbers_that_are_not_there_yet_are_null_in_the_log(tmp_path):
    world = LineWorld(8)
    config = PPOLagrangianConfig(rollout_steps=5, hidden=(4,))
    learner = PPOLagrangian(config, world.columns, world.action_columns, world.name, seed=0)
    train(
        world,
        learner,
        TrueCost(),
        seed=1,
        total_steps=50,
        directory=TrainingDirectory(tmp_path / 'run'),
    )
    assert (
        json.loads((tmp_path / 'run' / 'metrics.jsonl').read_text().splitlines()[0])['mean_return']
        is None
    )


def test_seconds_end_a_run():
    world = LineWorld(8)
    learner = make_learner(world)
    train(world, learner, TrueCost(), seed=1, seconds=0.2)
    assert learner.steps > 0


def test_a_run_without_end_or_in_another_world_is_refused():
    world = LineWorld(8)
    with pytest.raises(OccError, match='no end'):
        train(world, make_learner(world), TrueCost(), seed=1)
    other = PPOLagrangian(PPOLagrangianConfig(), ['y'], ['d_x'], 'other', seed=0)
    with pytest.raises(OccError, match="column 0 is 'x'"):
        train(world, other, TrueCost(), seed=1, total_steps=10)


def test_an_earlier_training_is_moved_aside_and_nothing_learned_saves_nothing(tmp_path):
    world = LineWorld(8)
    run = tmp_path / 'run'
    directory = TrainingDirectory(run)
    assert directory.begin() is None
    directory.save(make_learner(world))
    assert list(run.iterdir()) == []
    learner = make_learner(world)
    train(world, learner, TrueCost(), seed=1, total_steps=500, directory=directory)
    directory.save(learner)
    assert {path.name for path in run.iterdir()} == {
        'metrics.jsonl', 'policy.npz', 'checkpoint.pt', 'summary.json'
    }  # fmt: skip
    before = (run / 'policy.npz').read_bytes()
    again = TrainingDirectory(run)
    for begin in (again.begin, again.resume):
        with pytest.raises(OccError, match='another program is writing to'):
            begin()
    del directory
    assert again.begin() == tmp_path / 'run.1'
    assert list(run.iterdir()) == []
    assert (tmp_path / 'run.1' / 'policy.npz').read_bytes() == before


def test_a_save_that_fails_leaves_the_earlier_files(tmp_path, monkeypatch):
    world = LineWorld(8)
    directory = TrainingDirectory(tmp_path / 'run')
    learner = make_learner(world)
    train(world, learner, TrueCost(), seed=1, total_steps=500, directory=directory)
    directory.save(learner)
    before = {path.name: path.read_bytes() for path in directory.path.iterdir()}

    write = Path.write_bytes

    def full(path, content):
        if 'checkpoint' in path.name:
            write(path, content[:100])
            raise OSError(errno.ENOSPC, 'No space left on device')
        return write(path, content)

    monkeypatch.setattr(Path, 'write_bytes', full)
    with pytest.raises(OccError, match=r'cannot write .*checkpoint.pt: No space left'):
        directory.save(learner)
    assert {path.name: path.read_bytes() for path in directory.path.iterdir()} == before


def untimed(lines):
    return [{k: v for k, v in line.items() if not k.endswith('_s')} for line in lines]


@pytest.mark.parametrize('crashed', [False, True])
def test_a_resumed_training_gives_the_same_curve(tmp_path, crashed):
    """Stopped within a rollout, or killed some updates after the last checkpoint."""
    rules = Constraints(
        RuleSet(
            FeatureSpace((Feature('x'),)),
            (Rule('far', (Literal(0, '>', 0.7),)),),
            np.array([[0, 1]]),
        ),
        {
            'schema_version': 1,
            'pace': 'observation',
            'max_age': 1.0,
            'features': [{'name': 'x', 'topic': 'observation', 'column': 'x', 'unit': '1'}],
        },
    )

    def go_on(path, steps, resume):
        world = LineWorld(8, cliff=True)
        source, directory = RuleCost(rules, world), TrainingDirectory(path, {'robots': 8})
        learner, resumed = directory.resume() if resume else (make_learner(world), None)
        train(
            world, learner, source, seed=1, total_steps=steps, directory=directory, resumed=resumed
        )
        return directory, source, learner

    whole, whole_source, whole_learner = go_on(tmp_path / 'whole', 3000, False)
    directory, _, _ = go_on(tmp_path / 'parts', 1500, False)
    if crashed:
        checkpoint = (tmp_path / 'parts' / 'checkpoint.pt').read_bytes()
        go_on(tmp_path / 'parts', 2500, True)
        (tmp_path / 'parts' / 'checkpoint.pt').write_bytes(checkpoint)
        with (tmp_path / 'parts' / 'metrics.jsonl').open('a') as file:
            file.write('{"steps": 25')
    directory, source, learner = go_on(tmp_path / 'parts', 3000, True)
    assert len(whole.history()) >= 8
    assert untimed(directory.history()) == untimed(whole.history())
    np.testing.assert_array_equal(source.counts.evaluated, whole_source.counts.evaluated)
    np.testing.assert_array_equal(source.counts.violated, whole_source.counts.violated)
    assert learner.steps == whole_learner.steps
    for one, other in zip(learner.policy().weights, whole_learner.policy().weights, strict=True):
        np.testing.assert_array_equal(one, other)


def test_resuming_without_a_checkpoint_or_with_other_settings_is_refused(tmp_path):
    with pytest.raises(OccError, match='cannot read checkpoint'):
        TrainingDirectory(tmp_path).resume()
    world = LineWorld(8)
    directory = TrainingDirectory(tmp_path, {'robots': 8})
    train(world, make_learner(world), TrueCost(), seed=1, total_steps=500, directory=directory)
    with pytest.raises(OccError, match='has robots 8; it cannot be resumed with 9'):
        TrainingDirectory(tmp_path, {'robots': 9}).resume()


def test_a_training_stops_when_told(tmp_path):
    world = LineWorld(8)
    learner, calls = make_learner(world), iter(range(100))
    train(
        world,
        learner,
        TrueCost(),
        seed=1,
        total_steps=10_000,
        is_stopped=lambda: next(calls) >= 30,
    )
    assert 0 < learner.steps <= 30 * 8


@pytest.mark.parametrize('content', [b'\xff\xfe\n', b'{"steps": 3\n', b'[1]\n', b'{"a": 1}\n'])
def test_damaged_metrics_are_refused_in_a_sentence(tmp_path, content):
    (tmp_path / 'metrics.jsonl').write_bytes(content)
    with pytest.raises(OccError, match='metrics.jsonl is damaged: allowed is'):
        TrainingDirectory(tmp_path).history()


def test_an_earlier_training_in_the_working_directory_stays_where_it_is(tmp_path, monkeypatch):
    place = tmp_path / 'here'
    place.mkdir()
    (place / 'metrics.jsonl').write_text('')
    monkeypatch.chdir(place)
    with pytest.raises(OccError, match='in which this program was started'):
        TrainingDirectory('.').begin()
    assert [item.name for item in tmp_path.iterdir()] == ['here']


@pytest.mark.parametrize(
    'setting',
    [
        {'hidden': ['a']},
        {'hidden': [1.5]},
        {'hidden': [True]},
        {'log_std_init': float('nan')},
        {'log_std_init': 1e9},
        {'multiplier_init': float('inf')},
        {'actor_lr': float('inf')},
        {'threads': 100_000},
    ],
)
def test_settings_that_cannot_be_trained_with_are_refused(setting):
    (name,) = setting
    with pytest.raises(OccError, match=f'learner setting {name} is .*; allowed is '):
        learner_settings(setting)


@pytest.mark.parametrize('setting', [{'cost_limit': 3}, {'lagrangian': False}, {'decay_steps': 5}])
def test_a_setting_that_the_training_decides_is_refused_not_ignored(setting):
    (name,) = setting
    with pytest.raises(OccError, match=f'{name} is not set by itself here'):
        check(RunSettings('simple_nav', learner=setting))
