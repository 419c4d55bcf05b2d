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
# What each layer may import of the others, besides itself and what belongs to none.
ALLOWED = {
    'rules': set(),
    'learning': {'rules'},
    'bags': {'rules', 'learning'},
    'worlds': set(),
    'agents': {'rules', 'learning', 'bags', 'worlds'},
}
COMMON = {
    'archives',
    'documents',
    'errors',
    'files',
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


@pytest.mark.parametrize('layer', list(ALLOWED))
def test_lower_layers_import_neither_ros_nor_what_lies_above(layer):
    modules = sorted((PACKAGE / layer).rglob('*.py'))
    assert len(modules) > 1
    for module in modules:
        for name in imports(module):
            top, _, below = name.partition('.')
            assert top not in ROS, f'{module} imports {name}'
            assert not top.endswith(('_msgs', '_srvs')), f'{module} imports {name}'
            if top == ROOT:
                part = below.partition('.')[0]
                known = {layer, *COMMON, ''} | ALLOWED[layer]
                assert part in known, f'{module} imports {name}'


@pytest.mark.parametrize('part', ['rules', 'learning', 'bags', 'cli'])
def test_imports_load_nothing_heavy(part):
    code = f"""
import importlib, pkgutil, sys
part = importlib.import_module('{ROOT}.{part}')
for module in pkgutil.walk_packages(getattr(part, '__path__', ()), part.__name__ + '.'):
    importlib.import_module(module.name)
print(*({{'torch', 'mujoco', 'rclpy', 'matplotlib'}} & set(sys.modules)))
"""
    done = subprocess.run(
        [sys.executable, '-c', code], capture_output=True, text=True, check=False, timeout=60
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.split() == []
