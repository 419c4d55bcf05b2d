# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Monitor and gate run on what apt has on Ubuntu 24.04 with ROS 2 Jazzy, nothing else."""

import itertools
import os
import re
import subprocess
import sys
from importlib.metadata import packages_distributions, requires
from pathlib import Path

import numpy as np
import pytest
from occ_constraints_pkg.features.table import Table

import occ_constraints_pkg

PACKAGE = Path(occ_constraints_pkg.__file__).parent
# Packages of apt: ros-jazzy-rclpy, ros-jazzy-common-interfaces, python3-numpy,
# python3-ruamel.yaml, python3-jsonschema, python3-click, and what these depend on.
NEEDED = (
    'ros-jazzy-rclpy',
    'ros-jazzy-common-interfaces',
    'numpy',
    'ruamel.yaml',
    'jsonschema',
    'click',
)
BLOCKED = (
    'mcap',
    'rosbags',
    'lz4',
    'zstandard',
    'scipy',
    'torch',
    'mujoco',
    'gymnasium',
    'highway_env',
    'matplotlib',
    'jinja2',
    'sklearn',
    'pandas',
    'tqdm',
    'rich',
)
# Python reads it before anything else, in each process that is started.
SITECUSTOMIZE = f"""
import atexit, os, sys

class Blocker:
    def find_spec(self, name, path=None, target=None):
        if name.partition('.')[0] in {BLOCKED}:
            raise ModuleNotFoundError(f'No module named {{name!r}}', name=name)

sys.meta_path.insert(0, Blocker())

@atexit.register
def write_modules():
    with open(os.path.join(os.environ['MODULES_FOLDER'], str(os.getpid())), 'w') as file:
        file.write('\\n'.join(name for name, module in sys.modules.items() if module))
"""


def with_dependencies(names):
    """Return the distributions, names normalised, that come with these; extras left out."""
    found, left = set(), list(names)
    while left:
        name = re.sub(r'[-_.]+', '-', left.pop()).lower()
        if name not in found:
            found.add(name)
            needed = [item for item in requires(name) or () if 'extra ==' not in item]
            left += [re.match(r'[\w.-]+', item)[0] for item in needed]
    return found


def foreign(modules):
    """Return those modules that come from a distribution which apt does not have for us."""
    ours = with_dependencies(NEEDED) | {'occ-constraints-pkg', 'setuptools'}
    origins = packages_distributions()
    tops = {name.partition('.')[0] for name in modules} - set(sys.stdlib_module_names)
    return sorted(
        top
        for top in tops
        if top in origins
        and not ours & {re.sub(r'[-_.]+', '-', item).lower() for item in origins[top]}
    )


@pytest.fixture
def modules_folder(tmp_path, monkeypatch):
    (tmp_path / 'sitecustomize.py').write_text(SITECUSTOMIZE)
    folder = tmp_path / 'modules'
    folder.mkdir()
    before = os.environ.get('PYTHONPATH', '')
    monkeypatch.setenv('PYTHONPATH', f'{tmp_path}{os.pathsep}{before}')
    monkeypatch.setenv('MODULES_FOLDER', str(folder))
    return folder


def test_the_check_itself_finds_what_apt_does_not_have():
    assert foreign(['json', 'rclpy.node', 'ruamel.yaml', 'yaml', 'occ_constraints_pkg']) == []
    assert foreign(['rosbags.rosbag2', 'mcap', 'numpy']) == ['mcap', 'rosbags']


def test_monitor_and_gate_work_without_anything_else(modules_folder, nodes, observer, rules_of):
    from geometry_msgs.msg import Twist
    from occ_constraints_pkg.ros.qos import COMMANDS, LATCHED, STEPS
    from occ_constraints_pkg.ros.tables import table_message
    from sensor_msgs.msg import PointCloud2
    from std_msgs.msg import String
    from std_srvs.srv import Trigger

    gate = nodes.start('gate', slow_margin=0.0, timeout=1.0)
    counts, pruned = nodes.folder / 'counts.json', nodes.folder / 'pruned.yaml'
    monitor = nodes.start('monitor', counts_file=counts, pruned_file=pruned)
    # Read by the process that the monitor starts for it.
    constraints = observer.node.create_publisher(String, 'constraints', LATCHED)
    constraints.publish(String(data=rules_of['simple_nav'].dumps()))
    observation = observer.node.create_publisher(PointCloud2, 'observation', STEPS)
    command = observer.node.create_publisher(Twist, 'cmd_vel_in', COMMANDS)
    speeds, stamps = [], itertools.count(10**18, 10**8)
    observer.node.create_subscription(
        Twist, 'cmd_vel', lambda message: speeds.append(message.linear.x), 10
    )

    def speed_at(x, y):
        speeds.clear()
        table = Table(('x', 'y', 'episode'), np.array([[x, y, 0.0]]))
        observation.publish(table_message(table, next(stamps), 'simple_nav'))
        message = Twist()
        message.linear.x = 1.0
        command.publish(message)
        observer.spin(0.1)
        return speeds[-1] if speeds else None

    observer.spin_until(lambda: speed_at(0.8, 0.2) == 1.0)
    observer.spin_until(lambda: speed_at(0.2, 0.8) == 0.0)
    assert observer.call(Trigger, 'monitor/prune').success
    nodes.stop(gate, monitor)
    assert counts.is_file()
    assert pruned.is_file()
    for process in (gate, monitor):
        modules = (modules_folder / str(process.pid)).read_text().splitlines()
        assert f'occ_constraints_pkg.nodes.{process.name}' in modules
        assert foreign(modules) == []


@pytest.mark.parametrize(
    ('module', 'packages'),
    [
        ('monitor.node', {'features', 'learning', 'nodes', 'ros', 'rules'}),
        ('monitor.rules_reader', {'features', 'nodes', 'ros', 'rules'}),
        ('gate', {'nodes', 'ros', 'rules'}),
    ],
)
def test_no_other_part_of_the_package_is_loaded(modules_folder, module, packages):
    name = f'occ_constraints_pkg.nodes.{module}'
    done = subprocess.run([sys.executable, '-c', f'import {name}'], check=False, timeout=60)
    assert done.returncode == 0
    (written,) = modules_folder.iterdir()
    modules = written.read_text().splitlines()
    assert foreign(modules) == []
    parts = [item.split('.') for item in modules if item.startswith('occ_constraints_pkg.')]
    assert {part[1] for part in parts if (PACKAGE / part[1]).is_dir()} == packages
