# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""No output of ``occ`` costs a user a file: inputs, other kinds, edited constraints."""

import os
import shutil
import signal
import stat
import subprocess
import sys
import time

import pytest
from occ_constraints_pkg.cli import main
from occ_constraints_pkg.rules.constraints_file import load_constraints
from synthetic_bags import write_drive

MAP = """\
schema_version: 1
# mine
pace: observation
max_age: 0.5
features:
- {name: x, topic: observation, column: x, unit: m}
"""


@pytest.fixture(scope='module')
def made(tmp_path_factory):
    """Return a folder with a bag and rules."""
    folder = tmp_path_factory.mktemp('made')
    write_drive(folder / 'drive', robots=3, steps=60)
    settings = '--clip density --alpha 0.5 --depth 2'
    line = f'learn {folder / "drive"} -m simple_nav {settings} -o {folder / "rules.yaml"}'
    assert main(line.split()) == 0
    return folder


@pytest.fixture
def place(made, occ, tmp_path):
    """Return an empty folder, now the current one, with rules, edited rules, a map and a text."""
    shutil.copytree(made / 'drive', tmp_path / 'drive')
    text = (made / 'rules.yaml').read_text()
    (tmp_path / 'rules.yaml').write_text(text)
    (tmp_path / 'edited.yaml').write_text(text.replace('enabled: true', 'enabled: false', 1))
    (tmp_path / 'commented.yaml').write_text(f'# for the night shift\n{text}')
    (tmp_path / 'map.yaml').write_text(MAP)
    (tmp_path / 'README.md').write_text('# Mine\n')
    (tmp_path / 'link.yaml').symlink_to('rules.yaml')
    os.link(tmp_path / 'rules.yaml', tmp_path / 'hard.yaml')
    return tmp_path


def contents(folder):
    """Return the bytes of every file below a folder."""
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in folder.rglob('*')
        if path.is_file()
    }


REFUSED = {
    'check drive -c rules.yaml --plot rules.yaml': '.png',
    'check drive -c rules.yaml --plot x.html': '.png',
    'check drive -c rules.yaml --plot README.md': '.png',
    'check drive -c rules.yaml --count map.yaml': 'not a constraints file',
    'check drive -c rules.yaml --count README.md': 'not a constraints file',
    'check drive -c rules.yaml --count rules.yaml': 'read by the same command',
    'check drive -c rules.yaml --count link.yaml': 'read by the same command',
    'check drive -c rules.yaml --count hard.yaml': 'read by the same command',
    'check drive -c rules.yaml --count drive/metadata.yaml': 'not a constraints file',
    'check drive -c rules.yaml --count edited.yaml': 'was edited',
    'check drive -c rules.yaml --count commented.yaml': 'was edited',
    'check drive -c rules.yaml --count a.png --plot a.png': 'written by the same command',
    'simplify rules.yaml -o map.yaml': 'not a constraints file',
    'simplify rules.yaml -o edited.yaml': 'was edited',
    'simplify rules.yaml -o hard.yaml': 'read by the same command',
    'prune counted.yaml -o edited.yaml': 'was edited',
    'prune counted.yaml -o map.yaml': 'not a constraints file',
    'prune counted.yaml -o counted.yaml': 'read by the same command',
    'learn drive -m map.yaml -o map.yaml': 'read by the same command',
    'learn drive -m simple_nav -o README.md': 'not a constraints file',
    'learn drive -m simple_nav -o commented.yaml': 'was edited',
    'export c rules.yaml -o README.md': 'not a C header',
    'export c rules.yaml -o rules.yaml': 'read by the same command',
    'features suggest drive -o README.md': 'exists already',
    'drive simple_nav -o x.html': '.png',
    'show /dev/zero': 'a device',
    'show zero.yaml': 'a device',
    'check drive -c pipe.yaml': 'a pipe',
    'learn zero.csv': 'a device',
    'learn zero.npz': 'a device',
    'evaluate zero.npz': 'a device',
    'prune rules.yaml --counts zero.yaml': 'a device',
}


@pytest.mark.parametrize('line', REFUSED)
def test_a_file_is_never_lost(occ, place, line):
    for name in ('zero.yaml', 'zero.csv', 'zero.npz'):
        (place / name).symlink_to('/dev/zero')
    occ('check drive -c rules.yaml --count counted.yaml')
    before = contents(place)
    os.mkfifo(place / 'pipe.yaml')
    code, out, err = occ(line)
    assert (code, out, err.count('\n')) == (2, '', 1)
    assert REFUSED[line] in err
    assert contents(place) == before


def test_the_same_commands_may_be_repeated(occ, place):
    for _ in range(2):
        assert occ('check drive -c edited.yaml --count counted.yaml --plot new/a.png')[0] in (0, 1)
        assert occ('prune counted.yaml -t 0 -o pruned.yaml')[0] == 0
        assert occ('simplify edited.yaml -o short.yaml')[0] == 0
        assert occ('export c rules.yaml -o new/rules.h')[0] == 0
    assert not list(place.rglob('*.bak'))
    assert load_constraints(place / 'pruned.yaml').rule_set.rules
    text = (place / 'pruned.yaml').read_text()
    (place / 'pruned.yaml').write_text(text.replace('evaluated: ', 'evaluated:  ', 1))
    code, _, err = occ('prune counted.yaml -t 0 -o pruned.yaml')
    assert (code, 'was edited' in err) == (2, True)


@pytest.mark.parametrize('name', ['edited.yaml', 'commented.yaml'])
def test_an_edited_file_is_replaced_on_request_and_kept(occ, place, name):
    edited = (place / name).read_bytes()
    assert occ(f'check drive -c rules.yaml --count {name} --overwrite')[0] in (0, 1)
    assert (place / f'{name}.bak').read_bytes() == edited
    assert (place / name).read_bytes() != edited


def test_a_file_changed_in_place_is_kept_if_it_was_edited(occ, place):
    edited = (place / 'commented.yaml').read_bytes()
    assert occ('simplify commented.yaml')[0] == 0
    assert (place / 'commented.yaml.bak').read_bytes() == edited
    assert occ('simplify rules.yaml')[0] == 0
    assert not (place / 'rules.yaml.bak').exists()


def test_a_link_stays_and_permissions_too(occ, place):
    (place / 'far').mkdir()
    shutil.copy(place / 'rules.yaml', place / 'far' / 'c.yaml')
    (place / 'far' / 'c.yaml').chmod(0o640)
    (place / 'c.yaml').symlink_to('far/c.yaml')
    assert occ('simplify rules.yaml -o c.yaml')[0] == 0
    assert (place / 'c.yaml').is_symlink()
    assert stat.S_IMODE((place / 'far' / 'c.yaml').stat().st_mode) == 0o640
    assert 'SHA-256' in (place / 'far' / 'c.yaml').read_text()


def test_training_does_not_scatter_files(occ, place):
    pytest.importorskip('torch', reason="needs the extra 'train'")
    (place / 'constraints.yaml').write_bytes((place / 'commented.yaml').read_bytes())
    before = contents(place)
    line = 'train simple_nav --cost constraints.yaml --robots 8 --steps 600 --set rollout_steps=64'
    for output in ('-o .', '-o drive', '-o . --seeds 0:2', '-o . --resume'):
        code, _, err = occ(f'{line} {output}')
        assert code == 2
        assert 'holds no training' in err
        assert contents(place) == before
    assert occ(f'{line} -o run')[0] == 0
    # Its own counted rules are no input of a training that goes on.
    code, _, err = occ(
        f'{line} -o run --resume'.replace('constraints.yaml', 'run/constraints.yaml')
    )
    assert (code, 'read by the same command' in err) == (2, True)
    assert (place / 'constraints.yaml').read_bytes() == before['constraints.yaml']


def test_a_huge_text_is_refused_at_once(occ, place):
    (place / 'log.txt').write_text('a line of a log\n' * 2_000_000)
    begin = time.process_time()
    code, _, err = occ('show log.txt')
    assert (code, 'bytes; allowed are' in err) == (2, True)
    assert time.process_time() - begin < 2.0


def test_a_stopped_film_leaves_nothing(tmp_path):
    pytest.importorskip('mujoco', reason="needs the extra 'train'")
    pytest.importorskip('matplotlib', reason="needs the extra 'report'")
    process = subprocess.Popen(
        [sys.executable, '-m', 'occ_constraints_pkg', 'drive', 'CarPush1', '-o', 'part.gif'],
        cwd=tmp_path,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        # A test run in the background may ignore it, which children inherit.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    )
    end = time.monotonic() + 120
    while not os.listdir(tmp_path) and process.poll() is None and time.monotonic() < end:
        time.sleep(0.05)
    assert os.listdir(tmp_path)
    time.sleep(0.5)
    process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=60)
    assert (process.returncode, err.splitlines()[-1]) == (130, 'stopped')
    assert os.listdir(tmp_path) == []
