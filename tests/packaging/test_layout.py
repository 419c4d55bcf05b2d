# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Layouts for Foxglove, Lichtblick and RViz: whole, and about topics that our nodes have."""

import json
import re
from xml.etree import ElementTree

import pytest
from ruamel.yaml import YAML

# Settings of panels that name one topic, or a part of its messages.
KEYS = ('path', 'topicPath', 'topicToRender')


@pytest.fixture(scope='module')
def layout(package):
    return json.loads((package / 'config' / 'layout.json').read_text(encoding='utf-8'))


def panels(part):
    """The names of the panels in a part of the layout."""
    if isinstance(part, str):
        return [part]
    assert part['direction'] in ('row', 'column')
    assert 0 < part['splitPercentage'] < 100
    return panels(part['first']) + panels(part['second'])


def test_every_panel_is_shown_once_and_has_settings(layout):
    shown = panels(layout['layout'])
    assert sorted(shown) == sorted(layout['configById'])
    kinds = {name.partition('!')[0] for name in shown}
    assert kinds >= {'Plot', '3D', 'StateTransitions', 'Indicator', 'DiagnosticSummary'}


@pytest.fixture(scope='module')
def known(package):
    """The topics of our nodes."""
    policy = ElementTree.parse(package / 'config' / 'sros2_policy.xml')
    return {f'/{item.text.lstrip("/")}' for item in policy.iter('topic')}


def test_rviz_shows_what_the_simulated_robot_and_the_monitor_publish(package, known):
    view = YAML(typ='safe').load(package / 'config' / 'view.rviz')['Visualization Manager']
    assert view['Global Options']['Fixed Frame'] == 'odom'
    displays = view['Displays']
    assert len({display['Name'] for display in displays}) == len(displays)
    topics = {display['Topic']['Value'] for display in displays if 'Topic' in display}
    assert {re.sub('^/scan/.*', '/scan/*', topic) for topic in topics} <= known
    assert topics >= {'/odom', '/scene', '/markers', '/scan/hazards'}
    classes = {display['Class'] for display in displays}
    assert classes >= {'rviz_default_plugins/TF', 'rviz_default_plugins/LaserScan'}


def test_every_topic_is_one_of_our_nodes(layout, known):
    named = set()
    for settings in layout['configById'].values():
        paths = [item['value'] for item in settings.get('paths', [])]
        paths += [
            settings[key] for key in ('path', 'topicPath', 'topicToRender') if key in settings
        ]
        named |= {re.split(r'[.\[]', path)[0] for path in paths} | set(settings.get('topics', {}))
    assert named <= known
    assert named >= {'/cost', '/margin', '/violation', '/markers', '/diagnostics', '/cmd_vel'}
