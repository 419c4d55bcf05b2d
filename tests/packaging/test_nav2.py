# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The parameter file for Nav2's lifecycle manager; `tests/system` leads the monitor as it does."""

import re

import pytest
from ruamel.yaml import YAML


@pytest.fixture(scope='module')
def section(package):
    document = YAML(typ='safe').load(package / 'config' / 'nav2_lifecycle_manager.yaml')
    ((key, section),) = document.items()
    assert key == '/**/lifecycle_manager_constraints'
    return section['ros__parameters']


def test_leads_the_monitor_without_a_bond(section, nodes):
    assert section['node_names'] == ['monitor']
    assert set(section['node_names']) <= set(nodes)
    # nav2 declares it as a number with a decimal point, and ROS takes no other.
    assert section['bond_timeout'] == 0.0
    assert isinstance(section['bond_timeout'], float)
    assert section['autostart'] is True


def test_the_page_starts_it_by_the_name_of_its_section(root):
    text = (root / 'docs' / 'nav2.md').read_text(encoding='utf-8')
    assert '__node:=lifecycle_manager_constraints' in text
    assert 'monitor.launch.py autostart:=false' in text


def test_arguments_on_the_page_are_those_of_the_launch_file(root, package):
    page = (root / 'docs' / 'nav2.md').read_text(encoding='utf-8')
    (line,) = re.findall(r'monitor\.launch\.py (.*)', page.split('```sh')[1].split('```')[0])
    text = (package / 'launch' / 'monitor.launch.py').read_text(encoding='utf-8')
    for argument in line.split():
        assert f"'{argument.partition(':=')[0]}'" in text
