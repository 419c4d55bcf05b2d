# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""How a command ends when something outside it fails: Ctrl-C, stdout, the installation."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from occ_constraints_pkg.learning.learn import learn
from occ_constraints_pkg.rules.space import Feature, FeatureSpace

OCC = [sys.executable, '-m', 'occ_constraints_pkg']
COMMANDS = (
    'show rules.yaml',
    'show rules.yaml --json',
    'export c rules.yaml',
    'check bad.npz -c rules.yaml',
    'check bad.npz -c rules.yaml --json',
    'features',
    'show --help',
    '--help',
    '--version',
)


@pytest.fixture(scope='module')
def folder(tmp_path_factory):
    """Return a folder with rules, and a table that violates them."""
    folder = tmp_path_factory.mktemp('ends')
    values = np.random.default_rng(0).normal(size=(400, 2))
    space = FeatureSpace((Feature('a'), Feature('b')))
    rules = learn(values, np.arange(400) // 40, space, rng=np.random.default_rng(0))
    rules.save(folder / 'rules.yaml')
    np.savez(folder / 'bad.npz', features=10.0 * values, names=['a', 'b'])
    return folder


@pytest.mark.skipif(not Path('/dev/full').exists(), reason='needs /dev/full')
@pytest.mark.parametrize('line', COMMANDS)
def test_a_full_stdout_is_told_and_is_not_taken_for_a_finding(folder, line):
    with open('/dev/full', 'w') as full:
        done = subprocess.run(
            [*OCC, *line.split()], cwd=folder, stdout=full, stderr=subprocess.PIPE, text=True
        )
    assert done.returncode == 2
    assert done.stderr.count('\n') == 1
    assert 'No space left on device' in done.stderr


@pytest.mark.skipif(not Path('/dev/full').exists(), reason='needs /dev/full')
def test_a_full_stderr_does_not_change_the_exit_code(folder):
    with open('/dev/full', 'w') as full:
        done = subprocess.run([*OCC, 'show', 'nowhere.yaml'], cwd=folder, stderr=full)
    assert done.returncode == 2


@pytest.mark.parametrize('line', COMMANDS)
def test_a_closed_pipe_leaves_the_exit_code_as_it_is(folder, line):
    read, write = os.pipe()
    os.close(read)
    done = subprocess.run(
        [*OCC, *line.split()], cwd=folder, stdout=write, stderr=subprocess.PIPE, text=True
    )
    os.close(write)
    assert (done.returncode, done.stderr) == (1 if line.startswith('check') else 0, '')


def started(arguments, folder, ignore=False):
    def ignore_interrupts():
        signal.signal(signal.SIGINT, signal.SIG_IGN if ignore else signal.default_int_handler)

    return subprocess.Popen(
        [*OCC, *arguments],
        cwd=folder,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=ignore_interrupts,
    )


def has_begun(process):
    """Wait until Python runs our code; before that it has handlers of its own."""
    maps = Path(f'/proc/{process.pid}/status')
    while process.poll() is None:
        caught = next(
            int(line.split()[1], 16)
            for line in maps.read_text().splitlines()
            if line.startswith('SigCgt')
        )
        libraries = Path(f'/proc/{process.pid}/maps').read_text()
        if caught & 1 << (signal.SIGINT - 1) and '_multiarray_umath' in libraries:
            return
        time.sleep(0.001)


@pytest.mark.parametrize('delay', [0.0, 0.02, 0.05, 0.1, 0.15, 0.2, 0.3, 0.5])
def test_ctrl_c_in_the_first_half_second_is_one_word(folder, delay):
    process = started(['check', 'bad.npz', '-c', 'rules.yaml'], folder)
    has_begun(process)
    time.sleep(delay)
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=30)
    if process.returncode != 130:
        # It had ended already.
        assert (process.returncode, err) == (1, '')
        assert out
    else:
        # Once click runs, a line break ends the line on which a terminal shows ^C.
        assert err.strip() == 'stopped'


def test_ctrl_c_while_a_text_is_executed_is_no_death_by_a_signal(folder):
    # As in an import that makes dataclasses; CPython remembers it.
    code = (
        'import sys\nfrom occ_constraints_pkg.__main__ import main\n'
        'from occ_constraints_pkg.cli.commands import cli\n'
        "@cli.command()\ndef interrupted():\n    exec('raise KeyboardInterrupt')\n"
        "sys.argv = ['occ', 'interrupted']\nsys.exit(main())"
    )
    (folder / 'program.py').write_text(code)
    command = [sys.executable, '-m', 'program']
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True)
    assert (done.returncode, done.stderr.strip()) == (130, 'stopped')


def test_ctrl_c_stays_ignored_where_it_was(folder):
    process = started(['check', 'bad.npz', '-c', 'rules.yaml'], folder, ignore=True)
    for _ in range(20):
        time.sleep(0.02)
        process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=30)
    assert (process.returncode, err) == (1, '')


@pytest.mark.parametrize(
    ('content', 'sentence'),
    [
        ('raise ImportError("\\n\\nIMPORTANT: PLEASE READ\\nmore")', 'IMPORTANT: PLEASE READ'),
        ('syntax error', 'numpy cannot be imported'),
        ('', 'numpy cannot be imported'),
        ('__version__ = "1.24.4"', 'NumPy 1.24.4 is too old; needed is 1.26 or later'),
        ('__version__ = "2.4.0rc1"\nraise ImportError("no core")', 'no core'),
    ],
)
@pytest.mark.parametrize('line', ['--help', 'show rules.yaml'])
def test_a_damaged_numpy_is_told_in_one_sentence(folder, tmp_path, content, sentence, line):
    (tmp_path / 'numpy').mkdir()
    (tmp_path / 'numpy' / '__init__.py').write_text(content)
    done = subprocess.run(
        [*OCC, *line.split()],
        cwd=folder,
        capture_output=True,
        text=True,
        env={**os.environ, 'PYTHONPATH': str(tmp_path)},
    )
    assert (done.returncode, done.stdout, done.stderr.count('\n')) == (2, '', 1), done.stderr
    assert sentence in done.stderr


LEARN, SHOW = ['learn', 'bad.npz', '-o', 'x.yaml'], ['show', 'rules.yaml']


@pytest.mark.parametrize(
    ('module', 'line'),
    [
        ('numpy', LEARN),
        ('click', LEARN),
        ('scipy', LEARN),
        ('ruamel', LEARN),
        # Needed by what reads a document only.
        ('jsonschema', SHOW),
    ],
)
def test_a_missing_package_is_told_in_one_sentence(folder, module, line):
    code = (
        f'import sys; sys.modules[{module!r}] = None; from occ_constraints_pkg.cli import main; '
        f'sys.exit(main({line!r}))'
    )
    done = subprocess.run([sys.executable, '-c', code], cwd=folder, capture_output=True, text=True)
    assert (done.returncode, done.stdout, done.stderr.count('\n')) == (2, '', 1), done.stderr
    assert f'package {module}' in done.stderr or f'import of {module}' in done.stderr


def test_too_long_a_name_is_told(folder, run_occ, monkeypatch):
    monkeypatch.chdir(folder)
    name = 'n' * 300
    for line in (
        f'show {name}.yaml',
        f'check {name} -c rules.yaml',
        f'check {name}.mcap -c rules.yaml',
        f'check bad.npz -c rules.yaml --count {name}.yaml',
        f'learn {name} -m {name}',
        f'learn {name}.npz',
        f'learn bad.npz -o {name}.yaml',
        f'export c rules.yaml -o {name}.h',
        f'evaluate {name}.npz',
        f'evaluate {name}',
    ):
        code, _, err = run_occ(line)
        assert code == 2, line
        lines = [text for text in err.splitlines() if not text.startswith('warning: ')]
        assert len(lines) == 1, err
        assert lines[0].startswith('error: ')


@pytest.mark.parametrize('group', ['features', 'export'])
def test_a_group_without_a_command_prints_its_help(run_occ, group):
    code, out, err = run_occ(group)
    assert (code, err) == (0, '')
    assert f' {group} [OPTIONS] [COMMAND]' in out
    assert run_occ(f'{group} --help')[1] == out
