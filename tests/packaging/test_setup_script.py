# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""scripts/setup.sh, with a stand-in for Python, so that nothing is downloaded."""

import shutil
import subprocess
from pathlib import Path

import pytest

# Answers as Python does to what the script asks, and notes every call of pip. `-m venv DIR` makes
# an environment whose python is this file again.
PYTHON = """#!/bin/bash
log() {{ echo "$*" >>{log}; }}
case "$*" in
  --version) echo 'Python {version}.0' ;;
  '-c '*) echo '{version}' ;;
  '-m venv '*)
    if [ -e {no_venv} ]; then echo 'ensurepip is not available.'; exit 1; fi
    log venv
    directory=${{!#}}
    mkdir -p "$directory/bin"
    cp "{python}" "$directory/bin/python"
    touch "$directory/pyvenv.cfg" ;;
  '-m pip '*) log "pip $*"; [ ! -e {fail} ] || {{ echo 'no network' >&2; exit 1; }} ;;
esac
"""
TOOLS = ['bash', 'cat', 'cp', 'cut', 'dirname', 'grep', 'id', 'ls', 'mkdir', 'mktemp', 'rm', 'sed']
TOOLS += ['sha256sum', 'touch']


class Sandbox:
    """A copy of the repository's set-up with its own PATH."""

    def __init__(self, root: Path, folder: Path):
        self.folder = folder
        self.log = folder / 'log'
        self.fail = folder / 'fail'
        self.no_venv = folder / 'no_venv'
        self.bin = folder / 'bin'
        self.venv = folder / 'clone' / '.venv'
        clone = folder / 'clone'
        shutil.copytree(root / 'scripts', clone / 'scripts')
        shutil.copytree(root / 'requirements', clone / 'requirements')
        package = clone / 'src' / 'occ_constraints_pkg'
        (package / 'occ_constraints_pkg').mkdir(parents=True)
        for name in ('setup.py', 'setup.cfg', 'occ_constraints_pkg/__init__.py'):
            shutil.copy(root / 'src' / 'occ_constraints_pkg' / name, package / name)
        self.bin.mkdir()
        for tool in TOOLS:
            (self.bin / tool).symlink_to(shutil.which(tool))

    def add_python(self, name: str = 'python3', version: str = '3.12') -> None:
        path = self.bin / name
        text = PYTHON.format(
            log=self.log, fail=self.fail, no_venv=self.no_venv, version=version, python=path
        )
        self.add_tool(name, text)

    def add_tool(self, name: str, text: str) -> None:
        path = self.bin / name
        path.unlink(missing_ok=True)
        path.write_text(text)
        path.chmod(0o755)

    def run(self, *arguments: str) -> subprocess.CompletedProcess:
        self.log.write_text('')
        return subprocess.run(
            [self.bin / 'bash', self.folder / 'clone' / 'scripts' / 'setup.sh', *arguments],
            env={'PATH': str(self.bin), 'HOME': str(self.folder)},
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
        )

    def calls(self) -> list[str]:
        return self.log.read_text().splitlines()


@pytest.fixture
def sandbox(root, tmp_path):
    return Sandbox(root, tmp_path)


def test_installs_once_and_then_returns_at_once(sandbox):
    sandbox.add_python()
    first = sandbox.run()
    assert first.returncode == 0, first.stderr
    assert sandbox.calls()[0] == 'venv'
    assert sandbox.calls()[-1].endswith('src/occ_constraints_pkg[ros,train,report,dashboard,dev]')
    second = sandbox.run()
    assert (second.returncode, second.stdout, sandbox.calls()) == (0, '', [])


def test_a_changed_pin_or_other_extras_install_again_into_the_same_environment(sandbox):
    sandbox.add_python()
    sandbox.run()
    with (sandbox.folder / 'clone/requirements/common.txt').open('a') as pins:
        pins.write('some-package==1.0\n')
    for arguments in ([], ['--extras', 'ros']):
        assert sandbox.run(*arguments).returncode == 0
        assert sandbox.calls()
        assert 'venv' not in sandbox.calls()


def test_a_failed_set_up_is_reported_and_redone_from_the_start(sandbox):
    sandbox.add_python()
    sandbox.fail.touch()
    failed = sandbox.run()
    assert failed.returncode != 0
    assert 'no network' in failed.stderr
    sandbox.fail.unlink()
    again = sandbox.run()
    assert again.returncode == 0
    assert 'interrupted' in again.stdout
    assert sandbox.calls()[0] == 'venv'
    assert sandbox.run().stdout == ''


def test_takes_the_first_python_that_is_new_enough(sandbox):
    sandbox.add_python('python3', '3.10')
    sandbox.add_python('python3.12', '3.12')
    assert 'Python 3.12' in sandbox.run().stdout


def test_numpy_1_is_not_installed_for_python_3_13(sandbox):
    sandbox.add_python('python3', '3.13')
    sandbox.add_python('python3.11', '3.11')
    pins = str(sandbox.folder / 'clone/requirements/pins-numpy1.txt')
    assert 'Python 3.11' in sandbox.run('--pins', pins).stdout


def test_says_what_to_install_where_no_python_fits(sandbox):
    sandbox.add_python('python3', '3.9')
    done = sandbox.run()
    assert done.returncode == 2
    assert done.stderr.count('\n') == 1
    assert '3.11 or 3.12 or 3.13' in done.stderr


def test_root_gets_the_missing_part_of_debians_python_from_apt(sandbox):
    sandbox.add_python()
    sandbox.no_venv.touch()
    sandbox.add_tool('id', '#!/bin/bash\necho 0\n')
    sandbox.add_tool('env', '#!/bin/bash\nshift; exec "$@"\n')
    sandbox.add_tool(
        'apt-get',
        f'#!/bin/bash\necho "apt-get $*" >>{sandbox.log}\n'
        f'[ "$1" = update ] || rm {sandbox.no_venv}\n',
    )
    done = sandbox.run()
    assert done.returncode == 0, done.stderr
    assert 'installing python3-venv' in done.stdout
    update, install, made = sandbox.calls()[:3]
    assert update.startswith('apt-get update')
    assert install.startswith('apt-get install')
    assert install.endswith('python3-venv')
    assert made == 'venv'


def test_others_are_told_what_to_install(sandbox):
    sandbox.add_python()
    sandbox.no_venv.touch()
    sandbox.add_tool('id', '#!/bin/bash\necho 1000\n')
    done = sandbox.run()
    assert done.returncode == 2
    assert 'sudo apt-get install python3-venv' in done.stderr
    sandbox.no_venv.unlink()
    assert sandbox.run().returncode == 0


def test_leaves_a_folder_alone_that_is_no_environment(sandbox):
    sandbox.add_python()
    sandbox.venv.mkdir()
    (sandbox.venv / 'letter.txt').write_text('dear')
    done = sandbox.run()
    assert done.returncode == 2
    assert 'not a virtual environment' in done.stderr
    assert (sandbox.venv / 'letter.txt').read_text() == 'dear'


@pytest.mark.parametrize('arguments', [['--vnev', 'x'], ['--pins', 'absent.txt'], ['--extras']])
def test_wrong_options_are_named(sandbox, arguments):
    done = sandbox.run(*arguments)
    assert done.returncode == 2
    assert arguments[-1] in done.stderr


def test_takes_a_relative_name_for_one_beside_the_caller(sandbox, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    sandbox.add_python()
    assert sandbox.run('--venv', 'env').returncode == 0
    assert (tmp_path / 'env' / 'bin' / 'python').is_file()
