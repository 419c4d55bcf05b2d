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
