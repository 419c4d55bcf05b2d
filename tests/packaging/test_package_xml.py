# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""colcon takes the package for an ament_python one only if package.xml is valid."""

import re
from xml.etree import ElementTree

import pytest

import occ_constraints_pkg


@pytest.fixture(scope='module')
def manifest(package):
    return ElementTree.parse(package / 'package.xml').getroot()


def test_names_the_package_its_licence_and_build_type(manifest, package):
    assert manifest.get('format') == '3'
    assert manifest.findtext('name') == package.name
    assert manifest.findtext('license') == 'Apache-2.0'
    assert manifest.findtext('export/build_type') == 'ament_python'


def test_has_the_version_of_the_package(manifest):
    assert manifest.findtext('version') == occ_constraints_pkg.__version__


def test_maintainer_has_an_email_that_catkin_pkg_accepts(manifest):
    address = manifest.find('maintainer').get('email')
    assert re.fullmatch(
        r'[-a-zA-Z0-9_%+]+(\.[-a-zA-Z0-9_%+]+)*@[-a-zA-Z0-9]+(\.[-a-zA-Z0-9]+)+', address
    )


def test_asks_for_an_rclpy_with_the_events_executor_as_setup_py_does(manifest, package):
    (rclpy,) = [item for item in manifest.findall('exec_depend') if item.text == 'rclpy']
    assert rclpy.get('version_gte') == '7.1.4'
    assert "'ros-jazzy-rclpy[fastrtps]>=7.1.4'" in (package / 'setup.py').read_text()


def test_no_dependency_is_named_twice(manifest):
    names = [element.text for element in manifest.findall('exec_depend')]
    assert len(names) == len(set(names))


# What rosdep resolves on Ubuntu 24.04 for Jazzy: keys that begin so, as apt names them.
APT = {
    'python3-click',
    'python3-jinja2',
    'python3-jsonschema',
    'python3-numpy',
    'python3-pytest',
    'python3-ruamel.yaml',
    'python3-scipy',
    'python3-yaml',
}


def test_no_key_needs_pip_for_the_build_farm_refuses_those(manifest):
    keys = {item.text for item in manifest if item.tag.endswith('depend')}
    assert {key for key in keys if key.startswith('python')} == APT
    assert not [key for key in keys if key.endswith('-pip')]


def test_every_ros_package_that_the_code_imports_is_a_dependency(manifest, package):
    keys = {item.text for item in manifest.findall('exec_depend')}
    text = '\n'.join(
        path.read_text(encoding='utf-8')
        for folder in ('occ_constraints_pkg', 'launch')
        for path in (package / folder).rglob('*.py')
    )
    names = r'\w+_msgs|\w+_interfaces|\w+_srvs|rclpy|launch|launch_ros'
    imported = set(re.findall(rf'^\s*(?:from|import) ({names})\b', text, re.MULTILINE))
    # Of those, builtin_interfaces comes with each of the messages.
    assert {'rclpy', 'launch', 'sensor_msgs'} <= imported
    assert imported | {'tf2_msgs'} <= keys
