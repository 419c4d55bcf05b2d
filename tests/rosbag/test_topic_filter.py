# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
import pytest
from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.rosbag.topic_filter import TopicFilter

TOPICS = ('/scan', '/odom', '/left/odom', '/rosout', '/act/_action/status')


@pytest.mark.parametrize(
    ('settings', 'expected'),
    [
        ({}, '/scan /odom /left/odom /rosout'),
        ({'names': ['/odom']}, '/odom'),
        ({'regex': 'odom$'}, '/odom /left/odom'),
        ({'names': ['/scan'], 'regex': '^/left'}, '/scan /left/odom'),
        ({'exclude': ['/rosout'], 'exclude_regex': 'odom'}, '/scan'),
        (
            {'regex': 'o', 'exclude_regex': '^/(ros|left)', 'exclude': ['/scan']},
            '/odom /act/_action/status',
        ),
        ({'names': ['/act/_action/status']}, '/act/_action/status'),
    ],
)
def test_chooses_by_name_and_pattern(settings, expected):
    chosen = TopicFilter(**settings)
    assert [topic for topic in TOPICS if chosen.allows(topic)] == expected.split()


def test_names_are_completed():
    chosen = TopicFilter(['scan'], exclude=['odom']).with_names('/left/{}'.format)
    assert chosen.allows('/left/scan')
    assert not chosen.allows('/scan')
    assert str(chosen) == '/left/scan but /left/odom'
    assert str(TopicFilter()) == 'all topics'


def test_refuses_what_is_no_pattern():
    with pytest.raises(OccError, match=r"'\(' chooses no topics"):
        TopicFilter(exclude_regex='(')
