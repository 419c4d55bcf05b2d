# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The parameter file that is installed with the package."""

import json
import os
import subprocess
import sys

import pytest
from ruamel.yaml import YAML


@pytest.fixture(scope='module')
def path(package):
    return package / 'config' / 'params.yaml'


@pytest.fixture(scope='module')
def parameters(path):
    """Parameters by node."""
    document = YAML(typ='safe').load(path)
    return {key.removeprefix('/**/'): entry['ros__parameters'] for key, entry in document.items()}


def test_has_a_section_for_every_node(parameters, nodes):
    assert list(parameters) == nodes


@pytest.mark.parametrize('namespace', ['', '/robots/left'])
def test_rclpy_reads_the_same_values_in_any_namespace(path, parameters, namespace):
    pytest.importorskip('rclpy', reason="needs the extra 'ros'")
    code = """
import json, sys
import rclpy
values = {}
for name in sys.argv[3:]:
    context = rclpy.Context()
    rclpy.init(context=context, args=['--ros-args', '--params-file', sys.argv[1]])
    node = rclpy.create_node(
        name, namespace=sys.argv[2], context=context,
        automatically_declare_parameters_from_overrides=True,
    )
    parameters = node.get_parameters_by_prefix('')
    values[name] = {key: entry.value for key, entry in parameters.items() if key != 'use_sim_time'}
    node.destroy_node()
    rclpy.try_shutdown(context=context)
json.dump(values, sys.stdout)
"""
    done = subprocess.run(
        [sys.executable, '-c', code, path, namespace, *parameters],
        env={**os.environ, 'ROS_AUTOMATIC_DISCOVERY_RANGE': 'OFF'},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    read = json.loads(done.stdout)
    for node, values in parameters.items():
        own = {
            key: value
            for key, value in read[node].items()
            if not key.startswith(('qos_overrides', 'start_type_description_service'))
        }
        assert own == values


def test_gives_every_parameter_that_the_nodes_declare_and_its_default(parameters, tmp_path):
    for module in ('rclpy', 'torch', 'mujoco'):
        pytest.importorskip(module, reason="needs the extras 'ros' and 'train'")
    # The nodes fail for want of input once their parameters are declared, and may: what counts is
    # what they asked for until then.
    code = """
import inspect, json, sys
from importlib import import_module
import rclpy
from occ_constraints_pkg.nodes import node_main
from occ_constraints_pkg.ros.node import OccNode
declared = {}
def parameter(self, name, default, *_, **__):
    declared[self.get_name()][name] = default
    return default
OccNode.parameter = parameter
rclpy.init()
for name in sys.argv[1:]:
    declared[name] = {}
    for kind in vars(import_module(node_main(name).__module__)).values():
        if inspect.isclass(kind) and issubclass(kind, OccNode) and kind is not OccNode:
            try:
                kind()
            except Exception as error:
                print(name, error, file=sys.stderr)
rclpy.try_shutdown()
json.dump(declared, sys.stdout)
"""
    done = subprocess.run(
        [sys.executable, '-c', code, *parameters],
        cwd=tmp_path,
        env={**os.environ, 'ROS_AUTOMATIC_DISCOVERY_RANGE': 'OFF'},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    for node, values in json.loads(done.stdout).items():
        # A parameter file cannot hold an empty list of texts.
        values = {key: [''] if value == [] else value for key, value in values.items()}
        assert values == parameters[node], done.stderr
