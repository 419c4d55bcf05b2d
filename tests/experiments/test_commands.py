# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""``python -m experiments`` and ``python -m benchmarks``: help, mistakes and exit codes."""

import signal
import subprocess
import sys
from pathlib import Path

import pytest

from benchmarks.commands import cli as benchmarks
from experiments.commands import cli as experiments

ROOT = Path(__file__).parents[2]


def run(*arguments):
    return subprocess.run(
        [sys.executable, *arguments], cwd=ROOT, capture_output=True, text=True, timeout=60
    )


@pytest.mark.parametrize(
    ('module', 'names'), [('experiments', experiments), ('benchmarks', benchmarks)]
)
def test_help_lists_every_name_with_a_line(module, names):
    done = run('-m', module, '--help')
    assert (done.returncode, done.stderr) == (0, '')
    assert run('-m', module).stdout == done.stdout
    lines = [line.split() for line in done.stdout.splitlines()]
    for name in names.commands:
        assert any(line[:1] == [name] and len(line) > 3 for line in lines), name
    assert f'Example: python -m {module} ' in done.stdout


@pytest.mark.parametrize('name', sorted(experiments.commands))
def test_help_of_an_experiment_shows_an_example(run_experiment, name):
    code, out, _ = run_experiment(f'{name} --help')
    assert (code, f'Example: python -m experiments {name}' in out) == (0, True)


@pytest.mark.parametrize('module', ['experiments', 'benchmarks'])
def test_without_the_package_one_sentence_says_what_to_install(module):
    code = f"""
import runpy, sys
sys.modules['occ_constraints_pkg'] = None
sys.path.insert(0, '')
runpy.run_module({module!r}, run_name='__main__')
"""
    done = run('-c', code)
    assert (done.returncode, done.stdout, done.stderr.count('\n')) == (2, '', 1), done.stderr
    assert 'the package occ_constraints_pkg is not installed' in done.stderr


@pytest.mark.parametrize(
    ('missing', 'module', 'line', 'extra'),
    [
        ('torch', 'benchmarks', 'loop', 'train'),
        ('torch', 'benchmarks', 'train', 'train'),
        ('gymnasium', 'benchmarks', 'highway', 'train'),
        ('sklearn', 'experiments', 'article', 'dev'),
        ('torch', 'experiments', 'highway', 'train'),
    ],
)
def test_a_missing_extra_is_reported_in_one_sentence(missing, module, line, extra):
    for other in ('torch', 'mujoco', 'rclpy', 'matplotlib', 'highway_env'):
        if other != missing:
            pytest.importorskip(other, reason='needs all extras but one')
    code = f"""
import sys
sys.modules[{missing!r}] = None
from occ_constraints_pkg.cli import main
sys.exit(main({line.split()!r}, '{module}.commands'))
"""
    done = run('-c', code)
    assert (done.returncode, done.stdout, done.stderr.count('\n')) == (2, '', 1), done.stderr
    assert f"pip install 'occ_constraints_pkg[{extra}]'" in done.stderr


@pytest.mark.parametrize(
    ('line', 'sentence'),
    [
        ('robots --data nowhere', "'nowhere' does not exist"),
        ('ngsim --data nowhere', "'nowhere' does not exist"),
        ('transfer --source PointGaol1', "did you mean 'PointGoal1'"),
        ('transfer --expert exprt', "did you mean 'expert'"),
        ('transfer --seeds 0', '0 is not in the range x>=1'),
        ('transfer --steps 0', '0 is not in the range x>=1'),
        ('transfer --steps 300', 'steps is 300'),
        ('transfer --first-seed -1', '-1 is not in the range x>=0'),
        ('robts', "No such command 'robts'"),
    ],
)
def test_a_mistake_is_reported_before_anything_runs(run_experiment, tmp_path, line, sentence):
    code, out, err = run_experiment(f'{line} -o made')
    assert (code, out, err.count('\n')) == (2, '', 1)
    assert sentence in err
    assert not (tmp_path / 'made').exists()


def test_an_unknown_world_or_driver_is_reported_before_anything_heavy_is_imported():
    for line in ('transfer --source PointGaol1', 'transfer --expert exprt'):
        code = f"""
import sys
from occ_constraints_pkg.cli import main
code = main({line.split()!r}, 'experiments.commands')
sys.exit(99 if {{'torch', 'mujoco', 'matplotlib'}} & set(sys.modules) else code)
"""
        done = run('-c', code)
        assert (done.returncode, done.stdout, done.stderr.count('\n')) == (2, '', 1), done.stderr


@pytest.mark.parametrize(
    ('options', 'sentence'),
    [
        ('--steps 0', '0 is not in the range x>=1'),
        ('--rules nowhere.yaml', 'cannot read nowhere.yaml'),
        ('--rules strange.yaml', 'the constraints have no feature_map'),
        ('--cost-limit -1', 'learner setting cost_limit is -1.0; allowed is 0 or more'),
    ],
)
def test_a_mistake_about_ours_is_reported_first(run_experiment, tmp_path, options, sentence):
    pytest.importorskip('torch')
    pytest.importorskip('highway_env')
    (tmp_path / 'strange.yaml').write_text(
        'schema_version: 1\n'
        'features: [{name: x, demonstrated: [0.0, 1.0]}]\n'
        "rules: [{id: X, literals: [{feature: x, operator: '>', bound: 0.9}]}]\n"
    )
    code, _, err = run_experiment(f'highway {options} -o runs')
    assert code == 2
    assert sentence in err
    assert not (tmp_path / 'runs').exists()


def test_a_stopped_experiment_ends_as_other_commands(run_experiment, monkeypatch, tmp_path):
    pytest.importorskip('torch')
    pytest.importorskip('highway_env')
    from experiments import highway

    run = highway.run_highway

    def run_and_stop(*args, **options):
        signal.raise_signal(signal.SIGINT)
        return run(*args, **options)

    monkeypatch.setattr(highway, 'run_highway', run_and_stop)
    code, out, err = run_experiment('highway --agent RL --set restricted -o runs')
    assert (code, out, err.strip()) == (130, '', 'stopped')
    assert not (tmp_path / 'runs' / 'highway.json').exists()


def test_a_wrong_cost_limit_is_refused(run_experiment):
    pytest.importorskip('torch')
    code, _, err = run_experiment('highway --cost-limit much')
    assert code == 2
    assert "got 'much'; allowed is a number or 'demonstrations'" in err
