# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""``--help`` on a node tells its parameters, topics and services, and starts nothing."""

import subprocess
import sys
from pathlib import Path

import pytest
from occ_constraints_pkg.demo.processes import environment
from occ_constraints_pkg.documents import parse_yaml
from occ_constraints_pkg.nodes import NODES

import occ_constraints_pkg

PACKAGE = Path(occ_constraints_pkg.__file__).parents[1]
PARAMETERS = parse_yaml((PACKAGE / 'config' / 'params.yaml').read_text(), 'params.yaml')


def run(*arguments, folder):
    return subprocess.run(
        [sys.executable, *map(str, arguments)],
        env=environment(1),
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
        timeout=60,
    )


@pytest.mark.parametrize('name', NODES)
def test_every_parameter_is_told_with_its_default(name, tmp_path):
    if name == 'constrained_learner':
        pytest.importorskip('torch', reason="needs the extra 'train'")
    done = run('-m', 'occ_constraints_pkg', 'node', name, '--help', folder=tmp_path)
    assert (done.returncode, done.stderr) == (0, '')
    told = {}
    for line in done.stdout.splitlines():
        if line.startswith('  '):
            key, default, *meaning = line.split()
            assert meaning, line
            told[key] = parse_yaml(default, 'default')
    assert told == PARAMETERS[f'/**/{name}']['ros__parameters']
    assert 'Subscribes: ' in done.stdout or 'Publishes: ' in done.stdout
    assert list(tmp_path.iterdir()) == []
    # As ros2 run does it.
    assert run(PACKAGE / 'scripts' / name, '--help', folder=tmp_path).stdout == done.stdout


def test_a_node_that_does_not_exist_has_no_help(tmp_path):
    done = run('-m', 'occ_constraints_pkg', 'node', 'monitr', '-h', folder=tmp_path)
    assert done.returncode == 2
    assert "did you mean 'monitor'?" in done.stderr


def test_help_on_nodes_names_them_all(tmp_path):
    done = run('-m', 'occ_constraints_pkg', 'node', '--help', folder=tmp_path)
    assert done.returncode == 0
    assert all(name in done.stdout for name in NODES)
