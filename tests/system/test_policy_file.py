# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The SROS2 policy allows everything that the nodes really create."""

import fnmatch
from pathlib import Path
from xml.etree import ElementTree

import pytest

CONFIG = Path(__file__).resolve().parents[2] / 'src' / 'occ_constraints_pkg' / 'config'


def allowed(node):
    """Return what a node may do: 'publish', 'subscribe' and 'reply' to full names."""
    policy = ElementTree.parse(CONFIG / 'sros2_policy.xml')
    names = {'publish': set(), 'subscribe': set(), 'reply': set()}
    for profile in policy.iter('profile'):
        if profile.get('node') == node:
            for group in profile:
                for attribute in group.attrib:
                    names[attribute] |= {full_name(item.text, node) for item in group}
    return names


def full_name(name, node):
    return name.replace('~', f'/{node}', 1) if name.startswith('~') else f'/{name.lstrip("/")}'


def created(observer, name, namespace):
    """Return the same of what a node has created, as if its namespace were the root."""

    def plain(entries):
        prefix = '' if namespace == '/' else namespace
        return {topic.removeprefix(prefix) for topic, _ in entries}

    node = observer.node
    return {
        'publish': plain(node.get_publisher_names_and_types_by_node(name, namespace)),
        'subscribe': plain(node.get_subscriber_names_and_types_by_node(name, namespace)),
        'reply': plain(node.get_service_names_and_types_by_node(name, namespace)),
        'request': plain(node.get_client_names_and_types_by_node(name, namespace)),
    }


@pytest.mark.slow
def test_every_topic_and_service_of_the_nodes_is_allowed(nodes, observer, rules_of, small_bag):
    for module in ('mujoco', 'torch'):
        pytest.importorskip(module, reason="needs the extra 'train'")
    rules = nodes.folder / 'rules.yaml'
    rules_of['PointGoal1'].save(rules)
    started = [
        ('sim', '/', {'world': 'PointGoal1', 'publish_clock': True}),
        ('sim', '/driven', {'world': 'PointGoal1', 'drive_by_cmd_vel': True}),
        ('policy', '/', {'policy': 'random', 'wait_for_costs': True}),
        ('recorder', '/', {'output': nodes.folder / 'bag', 'topics': ['observation', 'costs']}),
        ('player', '/played', {'bag': small_bag, 'start_paused': True, 'clock': 10.0}),
        ('tree_learner', '/', {'feature_map': 'PointGoal1'}),
        ('monitor', '/', {'constraints_file': rules}),
        ('gate', '/', {}),
        ('constrained_learner', '/trained', {'output': nodes.folder / 'training'}),
        # The learner listens for others that act.
        ('policy', '/trained', {'policy': 'random'}),
    ]
    for name, namespace, parameters in started:
        nodes.start(name, namespace=namespace, **parameters)
    seen, same = None, 0

    def settled():
        nonlocal seen, same
        there = set(observer.node.get_node_names_and_namespaces())
        if not {(name, namespace) for name, namespace, _ in started} <= there:
            return False
        now = [created(observer, name, namespace) for name, namespace, _ in started]
        same = same + 1 if now == seen else 0
        seen = now
        # Endpoints are discovered one by one.
        return same >= 10 and all(item['publish'] and item['reply'] for item in now)

    observer.spin_until(settled)
    for (name, _, _), found in zip(started, seen, strict=True):
        rules_for = allowed(name)
        assert found.pop('request') == set()
        for what, names in found.items():
            refused = {
                item
                for item in names
                if not any(fnmatch.fnmatchcase(item, pattern) for pattern in rules_for[what])
            }
            assert not refused, f'{name} may not {what} {sorted(refused)}'
