# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""What a plain `pip install` of the package puts where."""

import os
import shutil
import stat
import subprocess
import sys
import venv
import zipfile

import pytest


@pytest.fixture(scope='module')
def wheel(package, tmp_path_factory):
    """A wheel built from a copy of the sources, for setuptools writes beside them."""
    folder = tmp_path_factory.mktemp('wheel')
    source = folder / 'source'
    shutil.copytree(
        package, source, ignore=shutil.ignore_patterns('__pycache__', '*.egg-info', 'build')
    )
    # Data of every kind that the package may hold, whether or not it does today.
    for suffix in ('yaml', 'json', 'xml', 'npz', 'j2'):
        (source / 'occ_constraints_pkg' / 'worlds' / f'probe.{suffix}').write_text('probe')
    subprocess.run(
        [sys.executable, '-m', 'pip', '--disable-pip-version-check', 'wheel', '--quiet']
        + ['--no-deps', '--no-build-isolation', '--wheel-dir', folder, source],
        check=True,
    )
    (path,) = folder.glob('*.whl')
    return path


@pytest.fixture(scope='module')
def installed(wheel, tmp_path_factory):
    """An environment that holds the wheel and nothing else."""
    prefix = tmp_path_factory.mktemp('installed') / 'venv'
    venv.create(prefix, with_pip=False, symlinks=True)
    subprocess.run(
        [sys.executable, '-m', 'pip', '--disable-pip-version-check', '--python', prefix]
        + ['install', '--quiet', '--no-deps', '--no-index', wheel],
        check=True,
    )
    return prefix


def test_only_occ_comes_onto_the_path(installed, tmp_path):
    empty = tmp_path / 'empty'
    venv.create(empty, with_pip=False, symlinks=True)
    before = {path.name for path in (empty / 'bin').iterdir()}
    assert {path.name for path in (installed / 'bin').iterdir()} - before == {'occ'}


def test_nodes_lie_where_ros2_run_looks_and_are_executable(installed, nodes):
    folder = installed / 'lib' / 'occ_constraints_pkg'
    assert {path.name for path in folder.iterdir()} == set(nodes)
    for node in nodes:
        assert os.access(folder / node, os.X_OK)
        assert (folder / node).read_text().startswith('#!/usr/bin/env python3\n')


def test_share_holds_index_manifest_launch_files_and_parameters(installed, package):
    share = installed / 'share'
    assert (share / 'ament_index/resource_index/packages/occ_constraints_pkg').is_file()
    assert (share / 'occ_constraints_pkg/package.xml').is_file()
    for folder, pattern in (('launch', '*.launch.py'), ('config', '*.*')):
        expected = {path.name for path in (package / folder).glob(pattern)}
        assert expected
        found = (share / 'occ_constraints_pkg' / folder).glob('*.*')
        assert {path.name for path in found} == expected


def test_every_module_and_every_kind_of_data_is_in_the_wheel(wheel, package):
    names = set(zipfile.ZipFile(wheel).namelist())
    sources = {
        str(path.relative_to(package)) for path in (package / 'occ_constraints_pkg').rglob('*.py')
    }
    assert sources <= names
    for suffix in ('yaml', 'json', 'xml', 'npz', 'j2'):
        assert f'occ_constraints_pkg/worlds/probe.{suffix}' in names
    assert 'occ_constraints_pkg/py.typed' in names


def test_scripts_are_executable_in_the_repository(package, nodes):
    for node in nodes:
        assert (package / 'scripts' / node).stat().st_mode & stat.S_IXUSR


def test_a_script_hands_its_name_and_arguments_on_and_returns_the_exit_code(
    package, nodes, tmp_path
):
    fake = tmp_path / 'occ_constraints_pkg' / 'nodes'
    fake.mkdir(parents=True)
    (fake.parent / '__init__.py').touch()
    (fake / '__init__.py').write_text('def run(name, argv):\n    print(name, argv)\n    return 7\n')
    for node in nodes:
        done = subprocess.run(
            [sys.executable, package / 'scripts' / node, '--ros-args', '-p', 'seed:=1'],
            env={**os.environ, 'PYTHONPATH': str(tmp_path)},
            capture_output=True,
            text=True,
        )
        assert done.stdout == f"{node} ['--ros-args', '-p', 'seed:=1']\n", done.stderr
        assert done.returncode == 7
