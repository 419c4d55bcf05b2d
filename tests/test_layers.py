# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Which part of the package may import which: the lower ones know nothing of ROS."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

import occ_constraints_pkg

PACKAGE = Path(occ_constraints_pkg.__file__).parent
ROOT = 'occ_constraints_pkg'
# Every arrow there is: which package imports which others, besides itself and the ground.
ARROWS = {
    'rules': set(),
    'web': set(),
    'worlds': set(),
    'rosbag': set(),
    'learning': {'rules'},
    'features': {'rules'},
    'datasets': {'features', 'rosbag', 'rules'},
    'demonstrations': {'datasets', 'features', 'learning', 'rules'},
    'suggestion': {'datasets', 'features', 'rosbag'},
    'checking': {'datasets', 'features', 'learning', 'rosbag', 'rules'},
    'events': {'rules'},
    'report': {'agents', 'checking', 'learning', 'rules', 'web'},
    'traffic': {'datasets', 'features', 'rosbag', 'rules'},
    'agents': {'worlds', 'features', 'rules'},
    'ros': {'features', 'rules'},
    'fleet': {'features', 'ros', 'rules'},
    'dashboard': {'fleet', 'rules', 'web'},
    'nodes': {
        'agents',
        'dashboard',
        'datasets',
        'demonstrations',
        'events',
        'features',
        'fleet',
        'learning',
        'ros',
        'rosbag',
        'rules',
        'worlds',
    },
    'watch': {'fleet'},
    'doctor': {'ros'},
    'demo': {
        'agents',
        'datasets',
        'features',
        'learning',
        'report',
        'ros',
        'rules',
        'worlds',
    },
    'cli': {
        'agents',
        'checking',
        'datasets',
        'demonstrations',
        'doctor',
        'events',
        'features',
        'learning',
        'nodes',
        'report',
        'ros',
        'rosbag',
        'rules',
        'suggestion',
        'traffic',
        'watch',
        'worlds',
    },
}
# Only these, and what starts them, know of ROS.
WITH_ROS = {'ros', 'fleet', 'nodes', 'watch', 'doctor', 'demo'}
COMMON = {
    'archives',
    'documents',
    'errors',
    'files',
    'picture_style',
    'simple_yaml',
    'stopping',
    'terminal',
    'wording',
    '__version__',
}
ROS = {'rclpy', 'ament_index_python', 'launch', 'rosidl_runtime_py', 'rosbag2_py'}


def imports(path):
    """Return the dotted names a module imports, also within functions."""
    names = set()
    for node in ast.walk(ast.parse(path.read_text(encoding='utf-8'))):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f'{path} imports relatively'
            names |= {f'{node.module}.{alias.name}' for alias in node.names}
    return names


def packages():
    return sorted(path.name for path in PACKAGE.iterdir() if (path / '__init__.py').is_file())


def test_every_package_is_listed():
    assert packages() == sorted(ARROWS)


@pytest.mark.parametrize('package', list(ARROWS))
def test_arrows_are_those_listed(package):
    found = set()
    for module in sorted((PACKAGE / package).rglob('*.py')):
        for name in imports(module):
            top, _, below = name.partition('.')
            if top == ROOT:
                found.add(below.partition('.')[0])
            elif package not in WITH_ROS:
                assert top not in ROS, f'{module} imports {name}'
                assert not top.endswith(('_msgs', '_srvs')), f'{module} imports {name}'
            assert top not in {'experiments', 'benchmarks', 'tests'}, f'{module} imports {name}'
    assert found - {package, *COMMON, ''} == ARROWS[package]


def test_no_arrow_leads_back():
    left = {package: set(arrows) for package, arrows in ARROWS.items()}
    while left:
        free = {package for package, arrows in left.items() if not arrows & left.keys()}
        assert free, f'a cycle among {sorted(left)}'
        left = {package: arrows for package, arrows in left.items() if package not in free}


@pytest.mark.parametrize(
    'part', ['rules', 'learning', 'features', 'rosbag', 'datasets', 'suggestion', 'cli']
)
def test_imports_load_nothing_heavy(part):
    code = f"""
import importlib, pkgutil, sys
part = importlib.import_module('{ROOT}.{part}')
for module in pkgutil.walk_packages(getattr(part, '__path__', ()), part.__name__ + '.'):
    if not module.name.endswith('_picture'):
        importlib.import_module(module.name)
print(*({{'torch', 'mujoco', 'rclpy', 'matplotlib'}} & set(sys.modules)))
"""
    done = subprocess.run(
        [sys.executable, '-c', code], capture_output=True, text=True, check=False, timeout=60
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.split() == []


def test_the_command_line_needs_no_reader_of_recordings_and_no_learner_to_start():
    code = 'import sys, occ_constraints_pkg.cli.commands; print(*sys.modules)'
    done = subprocess.run(
        [sys.executable, '-c', code], capture_output=True, text=True, check=True, timeout=60
    )
    loaded = {name.partition('.')[0] for name in done.stdout.split()}
    assert not loaded & {'scipy', 'rosbags', 'mcap', 'lz4', 'zstandard', 'torch', 'rclpy'}
