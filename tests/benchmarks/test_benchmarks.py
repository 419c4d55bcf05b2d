# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The benchmarks run and print what they should; how fast they are is no matter of tests."""

import inspect
import json
import subprocess
import sys
from pathlib import Path

import pytest
from occ_constraints_pkg.errors import OccError, import_needed

from benchmarks import BENCHMARKS

ROOT = Path(__file__).parents[2]


def bench(name, seconds, timeout):
    done = subprocess.run(
        [sys.executable, '-m', 'benchmarks', name, '--seconds', str(seconds), '--json'],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=timeout,
        stdin=subprocess.DEVNULL,
    )
    assert done.returncode == 0, done.stderr
    report = json.loads(done.stdout)
    assert set(report) >= {'metrics', 'peers', 'settings', 'machine', 'versions'}
    assert all(number > 0 for part in ('metrics', 'peers') for number in report[part].values())
    return report


@pytest.mark.parametrize('name', list(BENCHMARKS))
def test_every_benchmark_runs_without_arguments(name):
    try:
        module = import_needed('the test', f'benchmarks.{name}')
    except OccError as error:
        pytest.skip(str(error))
    (seconds,) = inspect.signature(module.run).parameters.values()
    assert seconds.name == 'seconds'
    assert seconds.default is not inspect.Parameter.empty


@pytest.mark.slow
@pytest.mark.timeout(300)
def test_bench_loop_prints_one_object():
    pytest.importorskip('rclpy')
    pytest.importorskip('torch')
    assert bench('loop', 12, timeout=280)['metrics']['loop_env_steps_per_s'] > 0


@pytest.mark.slow
@pytest.mark.timeout(300)
def test_bench_rules_compares_rules_of_many_literals():
    pytest.importorskip('sklearn')
    report = bench('rules', 0.1, timeout=280)
    assert report['metrics']['verdict_ns_per_row'] > 0
    assert report['settings']['rules'] == report['settings']['sklearn_leaves'] == 80
    assert len(report['settings']['rules_by_literals']) > 2
