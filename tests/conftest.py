# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""What all tests share: versions in pytest's header, no deadline for one example, ``occ``."""

import platform
from importlib import metadata

import pytest
from hypothesis import settings
from occ_constraints_pkg.cli import main

from benchmarks.conditions import machine

# Fixtures of recordings and messages, of robots that are watched, of a browser.
pytest_plugins = ['recordings', 'fleets', 'browsers']

# How long one example takes depends on what else the machine does.
settings.register_profile('any machine', deadline=None)
settings.load_profile('any machine')


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_auto_num_workers() -> int:
    """Return two workers for each core: tests of nodes spend most of their time waiting."""
    # Each needs some 600 MB.
    return min(2 * machine()['cores'], 16)


def pytest_report_header() -> str:
    """Name the versions that decide what a test result is worth."""
    names = {'NumPy': 'numpy', 'torch': 'torch', 'mujoco': 'mujoco', 'rclpy': 'rclpy'}
    versions = [f'Python {platform.python_version()}']
    for name, distribution in names.items():
        try:
            versions.append(f'{name} {metadata.version(distribution)}')
        except metadata.PackageNotFoundError:
            versions.append(f'{name} absent')
    return 'versions: ' + ', '.join(versions)


@pytest.fixture
def run_occ(capsys):
    """Return a function that runs ``occ``: exit code, stdout, stderr."""

    def run(line: str, **options: str) -> tuple[int, str, str]:
        capsys.readouterr()
        code = main(line.split(), **options)
        out, err = capsys.readouterr()
        return code, out, err

    return run


@pytest.fixture
def occ(run_occ, tmp_path, monkeypatch):
    """Return :func:`run_occ`, run in an empty folder."""
    monkeypatch.chdir(tmp_path)
    return run_occ
