# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The SROS2 policy is one, and has every node; `tests/system` compares it with the graph."""

from xml.etree import ElementTree

import pytest

# What sros2's schema (version 0.2.0) allows below what, and the attributes that say what is meant.
CHILDREN = {
    'policy': {'contexts'},
    'contexts': {'context'},
    'context': {'profiles'},
    'profiles': {'profile'},
    'profile': {'topics', 'services'},
    'topics': {'topic'},
    'services': {'service'},
    'topic': set(),
    'service': set(),
}
ATTRIBUTES = {
    'policy': {'version'},
    'context': {'path'},
    'profile': {'ns', 'node'},
    'topics': {'publish', 'subscribe'},
    'services': {'reply', 'request'},
}


@pytest.fixture(scope='module')
def path(package):
    return package / 'config' / 'sros2_policy.xml'


@pytest.fixture(scope='module')
def policy(path):
    return ElementTree.parse(path).getroot()


def test_is_built_as_the_schema_of_sros2_wants(policy):
    assert (policy.tag, policy.attrib) == ('policy', {'version': '0.2.0'})
    for element in policy.iter():
        assert {child.tag for child in element} <= CHILDREN[element.tag]
        assert set(element.attrib) <= ATTRIBUTES.get(element.tag, set())
        if element.tag in ('topics', 'services'):
            assert list(element.attrib.values()) == ['ALLOW']
            names = [child.text for child in element]
            assert names == sorted(set(names))
        if element.tag in ('topic', 'service'):
            assert element.text.strip() == element.text != ''
        elif CHILDREN[element.tag]:
            assert len(element)


def test_has_an_enclave_for_every_node(policy, nodes):
    found = {
        context.get('path'): [
            (item.get('ns'), item.get('node')) for item in context.iter('profile')
        ]
        for context in policy.iter('context')
    }
    assert found == {f'/occ_constraints/{node}': [('/', node)] for node in nodes}


def test_sros2_reads_it(path):
    policy_module = pytest.importorskip('sros2.policy', reason='needs sros2, which PyPI lacks')
    assert policy_module.load_policy(path).getroot().tag == 'policy'
