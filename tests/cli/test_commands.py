# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The command ``occ``: help, mistakes, exit codes, and the way from a bag to pruned rules."""

import json
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from occ_constraints_pkg.agents.policy import GaussianPolicy
from occ_constraints_pkg.cli import main
from occ_constraints_pkg.cli.commands import cli
from occ_constraints_pkg.rosbag.writer import BagWriter
from occ_constraints_pkg.rules.constraints_file import load_constraints
from occ_constraints_pkg.worlds.registry import world_class
from synthetic_bags import write_drive

COMMANDS = sorted(cli.commands)
SETTINGS = '--clip density --alpha 0.5 --depth 2'


@pytest.fixture(scope='module')
def files(tmp_path_factory):
    """Return a folder with bags of careful and of careless driving, rules and a policy."""
    folder = tmp_path_factory.mktemp('files')
    write_drive(folder / 'careful')
    write_drive(folder / 'careless', driver='straight', robots=5, steps=60)
    write_drive(folder / 'elsewhere', robots=1, steps=3, topic='/odom_table')
    BagWriter(folder / 'empty').close()
    line = f'learn {folder / "careful"} -m simple_nav {SETTINGS} -o {folder / "rules.yaml"}'
    assert main(line.split()) == 0
    text = (folder / 'rules.yaml').read_text()
    (folder / 'typo.yaml').write_text(text.replace('operator:', 'operater:', 1))
    (folder / 'edited.yaml').write_text(text.replace('enabled: true', 'enabled: false', 1))
    (folder / 'map.yaml').write_text(
        'schema_version: 1\npace: odom\nmax_age: 1\nfeatures:\n- {name: x, topic: odom, field: x}\n'
    )
    world = world_class('simple_nav')
    names = [tuple(column.name for column in c) for c in (world.columns, world.action_columns)]
    GaussianPolicy(
        world=world.name,
        columns=names[0],
        action_columns=names[1],
        observation_mean=np.zeros(2, dtype=np.float32),
        observation_variance=np.ones(2, dtype=np.float32),
        observation_clip=5.0,
        weights=(np.ones((2, 2), dtype=np.float32),),
        biases=(np.zeros(2, dtype=np.float32),),
        log_std=np.zeros(2, dtype=np.float32),
    ).save(folder / 'policy.npz')
    return folder


@pytest.fixture
def occ(files, run_occ, monkeypatch):
    """Return a function that runs ``occ`` in that folder: exit code, stdout, stderr."""
    monkeypatch.chdir(files)
    return run_occ


@pytest.mark.parametrize('name', COMMANDS)
def test_help_shows_an_example(name, capsys):
    assert main([name, '--help']) == 0
    text = capsys.readouterr().out
    assert f'Example: occ {name}' in text
    assert 'Traceback' not in text


def test_help_lists_every_command(capsys):
    assert main(['--help']) == 0
    text = capsys.readouterr().out
    assert main([]) == 0
    assert capsys.readouterr().out == text
    assert all(f'\n  {name} ' in text for name in COMMANDS)
    groups = [line for line in text.splitlines() if line.endswith(':') and line[0] != ' ']
    assert groups == ['Options:', 'Rules:', 'Recordings:', 'Nodes:', 'Simulation:']
    # A screen: one line for each command.
    assert len(text.splitlines()) <= 40
    assert max(map(len, text.splitlines())) <= 80


MISTAKES = {
    'lern': "No such command 'lern'",
    'learn': 'Missing argument',
    'learn careful -m simple_nav --dept 3': "No such option '--dept'",
    'learn nowhere -m simple_nav': 'there is no recording at nowhere',
    'learn empty -m simple_nav': 'empty holds no messages',
    'learn elsewhere -m simple_nav': "no topic 'observation'",
    'learn rules.yaml -m simple_nav': 'rules.yaml is not a recording, nor a manifest',
    'learn careful -m simple_nave': "did you mean 'simple_nav'",
    'learn careful -m nowhere.yaml': "no feature map 'nowhere.yaml'",
    'learn careful -m simple_nav --contamination 2': 'contamination is 2.0',
    'learn careful -m simple_nav --clip density --contamination 0.1': 'has no effect',
    'learn careful -m simple_nav --gamma 0.1': '--gamma has no effect with --clip mass',
    'learn careful -m simple_nav --nu 7': 'nu is 7.0',
    'learn careful -m simple_nav --depth many': "'many' is not a valid integer",
    'learn careful -m simple_nav -o edited.yaml': 'edited.yaml was edited',
    'learn careful -m simple_nav -o typo.yaml': "did you mean 'operator'",
    'learn careful -m simple_nav -o policy.npz/rules.yaml': 'cannot write policy.npz/rules.yaml',
    'show nowhere.yaml': 'cannot read nowhere.yaml',
    'show careful': 'cannot read careful',
    'show policy.npz': 'policy.npz',
    'show typo.yaml': 'operater: unknown key',
    'check careful -c typo.yaml': 'operater: unknown key',
    'check nowhere -c rules.yaml': 'there is no recording at nowhere',
    'check empty -c rules.yaml': 'empty holds no messages',
    'check elsewhere -c rules.yaml': "no topic 'observation'",
    'check careful': "Missing option '-c'",
    'prune rules.yaml': 'no enabled rule has been evaluated',
    'prune rules.yaml -t 2': 'threshold is 2.0',
    'prune rules.yaml --counts nowhere.json': 'nowhere.json',
    'prune rules.yaml --counts typo.yaml': 'not a file of rule counters',
    'prune typo.yaml': 'operater: unknown key',
    'evaluate nowhere.npz': 'nowhere.npz',
    'evaluate rules.yaml': 'rules.yaml',
    'evaluate policy.npz --world simple_nave': "did you mean 'simple_nav'",
    'evaluate policy.npz --episodes 0': '0',
    'evaluate straight': 'a driver needs --world',
    'evaluate strait --world simple_nav': 'allowed are random, straight, expert',
    'evaluate strait --world simple_nav --episodes 1': "did you mean 'straight'",
    'evaluate careful': 'careful is a directory without a policy.npz',
    'evaluate .': 'allowed is the policy file in it, policy.npz',
    'drive simple_nave': "did you mean 'simple_nav'",
    'drive simple_nav --driver exprt': "did you mean 'expert'",
    'check rules.yaml -c careful': 'were the arguments swapped?',
    'check policy.npz -c policy.npz': 'were the arguments swapped?',
    'score careful rules.yaml': 'were the arguments swapped?',
    'features check simple_nav careful': 'were the arguments swapped?',
    'learn rules.yaml': 'but constraints (-c)',
    'learn careful -m rules.yaml': 'is a constraints file (-c), not a feature map',
    'learn map.yaml careful': 'but a feature map (-m)',
    'show map.yaml': 'is a feature map (-m), not a constraints file',
    'check careful -c map.yaml': 'is a feature map (-m), not a constraints file',
    'record -a odom': 'got both --all and the topics odom',
    'record odom --topics': "'--topics' requires an argument",
    'record --services a': 'services are neither recorded nor played',
    'record --storage sqlite3': "'sqlite3' is not 'mcap'",
    'play careful --delay 2': 'see --start-paused',
    'play careful --remap odom': "got 'odom'; allowed is FROM:=TO",
    'bench loop --json': "'occ bench loop' is now 'python -m benchmarks loop'",
    'experiment truth': "'occ experiment truth' is now 'python -m experiments truth'",
    'experiment --help': "now 'python -m experiments NAME' in a clone",
    'experiment depth careful': "is now 'occ learn --compare-depths'",
    'node': "Missing argument 'NAME'",
    'node monitr': "did you mean 'monitor'",
}


@pytest.mark.parametrize('line', MISTAKES)
def test_a_mistake_is_told_in_one_sentence(occ, files, line):
    before = {path: path.stat().st_mtime_ns for path in files.rglob('*')}
    code, out, err = occ(line)
    assert code == 2
    assert out == ''
    assert err.startswith('error: ')
    assert MISTAKES[line] in err
    assert err.count('\n') == 1
    assert {path: path.stat().st_mtime_ns for path in files.rglob('*')} == before


@pytest.mark.parametrize(
    'line',
    [
        'train simple_nave -o x',
        'train simple_nav --cost typo.yaml -o x',
        'train simple_nav --cost-limit much -o x',
        'train simple_nav --cost-limit -1 -o x',
        'train simple_nav --cost-limit demonstrations -o x',
        'train simple_nav --device cudo -o x',
        'train simple_nav --device cudo --seeds 0:2 -o x',
        'train simple_nav --set actr_lr=1 -o x',
        'train simple_nav --set actor_lr=fast -o x',
        'train simple_nav --set actor_lr="fast" -o x',
        'train simple_nav --set minibatch=1.5 -o x',
        'train simple_nav --set gamma=2 -o x',
        'train simple_nav --seeds 5 -o x',
        'train simple_nav --seeds 3:3 -o x',
        'train simple_nav --cost typo.yaml --seeds 0:2 -o x',
    ],
)
def test_mistakes_in_training(occ, files, line):
    pytest.importorskip('torch', reason="needs the extra 'train'")
    code, _, err = occ(line)
    assert (code, err.count('\n')) == (2, 1)
    assert not (files / 'x').exists()


@pytest.mark.parametrize(
    ('module', 'line', 'extra'),
    [
        ('torch', 'train simple_nav -o x', 'train'),
        ('mujoco', 'train PointGoal1 -o x', 'train'),
        ('torch', 'node constrained_learner', 'train'),
        ('uvicorn', 'node dashboard', 'dashboard'),
        ('rclpy', 'node monitor', 'ros'),
        ('sensor_msgs', 'node sim', 'ros'),
        ('rclpy', 'record -o x', 'ros'),
        ('rclpy', 'play careful', 'ros'),
        ('rclpy', 'demo -o x', 'ros'),
        ('matplotlib', 'demo -o x', 'report'),
        ('jinja2', 'demo -o x', 'report'),
    ],
)
def test_a_missing_extra_is_told_in_one_sentence(files, module, line, extra):
    for other in ('torch', 'mujoco', 'rclpy', 'matplotlib', 'jinja2'):
        if other != module:
            pytest.importorskip(other, reason='needs all extras but one')
    code = f"""
import sys
sys.modules[{module!r}] = None
from occ_constraints_pkg.cli import main
sys.exit(main({line.split()!r}))
"""
    done = subprocess.run(
        [sys.executable, '-c', code], cwd=files, capture_output=True, text=True, timeout=60
    )
    assert (done.returncode, done.stdout) == (2, '')
    assert done.stderr.count('\n') == 1, done.stderr
    assert module in done.stderr
    assert f"pip install 'occ_constraints_pkg[{extra}]'" in done.stderr
    assert not (files / 'x').exists()


@pytest.mark.parametrize(
    'line',
    [
        'train PointGaol1 -o x',
        'evaluate expert --world PointGaol1',
        'evaluate exprt --world PointGoal1',
        'drive CarPush1 --driver exprt',
    ],
)
def test_an_unknown_world_or_driver_is_told_before_anything_heavy_is_imported(line):
    code = f"""
import sys
from occ_constraints_pkg.cli import main
code = main({line.split()!r})
sys.exit(99 if {{'torch', 'mujoco', 'matplotlib'}} & set(sys.modules) else code)
"""
    done = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stdout, done.stderr.count('\n')) == (2, '', 1), done.stderr
    assert 'did you mean' in done.stderr


def test_from_a_bag_to_pruned_rules(occ, files):
    code, out, err = occ(f'learn careful -m simple_nav {SETTINGS} -o new.yaml --json')
    assert (code, err) == (0, '')
    learned = json.loads(out)
    assert learned['output'] == 'new.yaml'
    assert learned['training'] > 0.8

    code, out, _ = occ('show new.yaml --json')
    shown = json.loads(out)
    assert (code, shown['edited']) == (0, False)
    assert len(shown['rules']) == learned['rules'] > 0
    code, out, _ = occ('show new.yaml')
    assert code == 0
    for rule in shown['rules']:
        assert rule['id'] in out
        assert rule['text'] in out

    code, out, _ = occ('check careful -c new.yaml --json')
    assert json.loads(out)['samples'] == 40 * 100
    code, out, _ = occ('check careless -c new.yaml --json --count counted.yaml')
    checked = json.loads(out)
    assert code == 1
    assert checked['samples'] == 5 * 60
    assert sum(checked['shares'].values()) == pytest.approx(1.0)
    assert checked['shares']['VIOLATED'] > 0.1
    assert checked['smallest_margin'] < 0.0
    violated = {item['id']: item['violated'] for item in checked['violated_rules']}
    code, out, _ = occ('check careless -c new.yaml')
    assert code == 1
    assert all(name in out for name in violated)

    code, out, _ = occ('prune counted.yaml -t 0.05 -o pruned.yaml --json')
    pruned = json.loads(out)
    assert code == 0
    assert set(pruned['kept']) | set(pruned['pruned']) == {rule['id'] for rule in shown['rules']}
    assert pruned['pruned']
    rules = load_constraints(files / 'pruned.yaml').rule_set.rules
    assert {rule.id for rule in rules if rule.enabled} == set(pruned['kept'])
    counted = {rule.id: rule.violated for rule in rules}
    assert {name: counted[name] for name in violated} == violated
    code, out, _ = occ('show pruned.yaml')
    assert code == 0
    assert out.count('(disabled)') == len(pruned['pruned'])


def test_check_tells_by_its_exit_code(occ, files):
    constraints = load_constraints(files / 'rules.yaml')
    off = tuple(replace(rule, enabled=False) for rule in constraints.rule_set.rules)
    constraints.with_rule_set(replace(constraints.rule_set, rules=off)).save(files / 'off.yaml')
    # What no rule judges is not known to be safe.
    code, out, _ = occ('check careless -c off.yaml')
    assert (code, 'UNKNOWN: no rule is enabled' in out) == (1, True)
    assert occ('check careless -c rules.yaml')[0] == 1
    assert occ('check careless -c nowhere.yaml')[0] == 2


def test_an_edited_file_is_overwritten_on_request_and_kept(occ, files):
    edited = (files / 'edited.yaml').read_text()
    (files / 'mine.yaml').write_text(edited)
    code, _, _ = occ('learn careful -m simple_nav -o mine.yaml --overwrite')
    assert code == 0
    assert (files / 'mine.yaml.bak').read_text() == edited
    assert (files / 'mine.yaml').read_text() != edited


def test_train_several_seeds_and_go_on(occ, files):
    pytest.importorskip('torch', reason="needs the extra 'train'")
    line = 'train simple_nav --cost rules.yaml --cost-limit demonstrations --robots 8 -o seeds'
    line += ' --set hidden=[16] --set rollout_steps=64'
    code, out, err = occ(f'{line} --seeds 3:5 --steps 2500 --json')
    first = json.loads(out)
    assert (code, err) == (0, '')
    assert [Path(item['directory']).name for item in first['seeds']] == ['seed_3', 'seed_4']
    assert first['return_ci95'] > 0
    rules = load_constraints(files / 'rules.yaml')
    assert first['cost_limit'] == rules.coverage['cost_per_episode'] > 0
    code, out, _ = occ(f'{line} --seeds 3:5 --steps 5000 --resume --json')
    second = json.loads(out)
    assert code == 0
    for one, two in zip(first['seeds'], second['seeds'], strict=True):
        assert one['steps'] < two['steps'] <= 5000
    counted = load_constraints(files / 'seeds' / 'seed_3' / 'constraints.yaml').rule_set.rules
    assert sum(rule.evaluated for rule in counted) >= 5000
    code, out, _ = occ('evaluate seeds/seed_3/policy.npz seeds/seed_4/policy.npz --episodes 2')
    assert code == 0
    assert 'return_ci95: ' in out


@pytest.mark.parametrize('more', ['', ' --seeds 0:2', ' --resume'])
def test_fewer_steps_than_one_update_needs_are_refused(occ, files, more):
    pytest.importorskip('torch', reason="needs the extra 'train'")
    (files / 'earlier').mkdir(exist_ok=True)
    (files / 'earlier' / 'metrics.jsonl').touch()
    before = {path: path.stat().st_mtime_ns for path in files.rglob('*')}
    for world in ('simple_nav', 'highway', 'highway_restricted'):
        code, out, err = occ(f'train {world} --steps 300 -o earlier{more}')
        assert (code, out) == (2, '')
        assert err == (
            'error: steps is 300, which ends a training before its first update; allowed is '
            '4096 or more: rollout_steps 64 x robots 64\n'
        )
    code, _, err = occ(
        f'train simple_nav --steps 39 --robots 4 --set rollout_steps=10 -o new{more}'
    )
    assert code == 2
    assert 'allowed is 40 or more: rollout_steps 10 x robots 4' in err
    assert {path: path.stat().st_mtime_ns for path in files.rglob('*')} == before


def test_as_many_steps_as_one_update_needs_will_do(occ, files):
    pytest.importorskip('torch', reason="needs the extra 'train'")
    code, out, err = occ(
        'train simple_nav --steps 40 --robots 4 --set rollout_steps=10 -o just --json'
    )
    assert (code, err) == (0, '')
    numbers = json.loads(out)
    assert (numbers['steps'], numbers['updates']) == (40, 1)


def test_a_training_is_not_resumed_with_other_settings(occ, files):
    pytest.importorskip('torch', reason="needs the extra 'train'")
    line = 'train simple_nav --steps 2500 --robots 8 -o fixed --resume'
    code, _, err = occ(line)
    assert code == 0
    assert 'no checkpoint in fixed, so training starts anew' in err
    code, out, err = occ(f'{line} --cost-limit 7')
    assert (code, out) == (2, '')
    assert 'cost_limit 25.0; it cannot be resumed with 7.0' in err


def test_evaluate_prints_numbers(occ):
    code, out, _ = occ('evaluate policy.npz --episodes 3 --json')
    numbers = json.loads(out)
    assert (code, numbers['episodes']) == (0, 3)
    assert '"episodes": 3,' in out
    code, out, _ = occ('evaluate policy.npz --episodes 3')
    assert code == 0
    assert out.startswith('episodes: 3\n')
    assert f'cost: {numbers["cost"]:.3f}' in out


def test_evaluate_takes_a_driver(occ):
    code, out, _ = occ('evaluate straight --world simple_nav --episodes 3 --json')
    numbers = json.loads(out)
    assert code == 0
    assert numbers['return'] > 2
    assert numbers['cost'] > 5


def test_a_reader_that_leaves_early_is_no_error(files):
    command = f'{sys.executable} -m occ_constraints_pkg show rules.yaml --json; echo $? >&2'
    done = subprocess.run(
        ['bash', '-c', f'({command}) | true'], cwd=files, capture_output=True, text=True
    )
    assert done.stderr.strip() == '0'


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_a_stopped_training_is_saved(tmp_path, number):
    pytest.importorskip('torch', reason="needs the extra 'train'")
    line = ['train', 'simple_nav', '--cost', 'none', '--steps', '1000000000', '-o', 'runs']
    process = subprocess.Popen(
        [sys.executable, '-m', 'occ_constraints_pkg', *line],
        cwd=tmp_path,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        end = time.monotonic() + 60.0
        while not (tmp_path / 'runs' / 'metrics.jsonl').exists() and time.monotonic() < end:
            time.sleep(0.02)
        process.send_signal(number)
        out, err = process.communicate(timeout=30.0)
    finally:
        process.kill()
    assert (process.returncode, err.strip()) == (130, 'stopped')
    assert 'runs' in out
    assert GaussianPolicy.load(tmp_path / 'runs' / 'policy.npz').world == 'simple_nav'


def test_a_wrong_number_is_refused_before_anything_runs(occ, tmp_path):
    code, out, err = occ('demo --train-seconds nan -o made')
    assert (code, out) == (2, '')
    assert "got 'nan'; allowed is a finite number" in err
    assert not (tmp_path / 'made').exists()
