# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The demo as a user runs it, with a short training."""

import json
import subprocess
import sys

import pytest

pytest.importorskip('rclpy')
pytest.importorskip('torch')
pytest.importorskip('matplotlib')


def occ(*arguments, timeout):
    return subprocess.run(
        [sys.executable, '-m', 'occ_constraints_pkg', *map(str, arguments)],
        capture_output=True,
        text=True,
        timeout=timeout,
        stdin=subprocess.DEVNULL,
    )


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_the_demo_runs_and_leaves_what_it_says(tmp_path):
    output = tmp_path / 'demo'
    result = occ('demo', '-o', output, '--train-seconds', 20, timeout=500)
    assert result.returncode == 0, result.stderr
    assert 'precision' in result.stdout
    for name in ('index.html', 'drives.png', 'rules.png', 'training.png', 'constraints.yaml'):
        assert (output / name).stat().st_size > 500, name
    assert (output / 'demonstrations' / 'metadata.yaml').exists()
    assert (output / 'training' / 'policy.npz').exists()
    checked = occ(
        'check', output / 'demonstrations', '-c', output / 'constraints.yaml', '--json', timeout=60
    )
    assert checked.returncode == 1
    assert 0.98 < json.loads(checked.stdout)['shares']['SAFE'] < 1.0


def test_the_demo_does_not_replace_other_files(tmp_path):
    (tmp_path / 'precious').write_text('mine')
    result = occ('demo', '-o', tmp_path, timeout=60)
    assert result.returncode == 2
    assert 'not the output of a demo' in result.stderr
    assert (tmp_path / 'precious').read_text() == 'mine'
