# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Suggested on one drive and learned from it, a map knows the next drive, and every fault."""

import re

import numpy as np
import pytest
from occ_constraints_pkg.checking.timeline import check_data
from occ_constraints_pkg.datasets.extraction import extract
from occ_constraints_pkg.demonstrations.learning import learn_from_files
from occ_constraints_pkg.documents import parse_yaml
from occ_constraints_pkg.features.feature_map import FeatureMap
from occ_constraints_pkg.learning.settings import OCTreeSettings
from occ_constraints_pkg.rosbag.recording import Recording
from occ_constraints_pkg.suggestion.suggest import suggest_each
from occ_constraints_pkg.suggestion.text import suggestion_text
from robot_bags import ROBOTS, write_robot

# The others take longer together than a test may.
QUICK = ('px4', 'car', 'racecar', 'boat')
KINDS = [pytest.param(kind, marks=() if kind in QUICK else pytest.mark.slow) for kind in ROBOTS]
FLAGGED_SHARE = 0.02
# Seconds of the ten that a fault lasts.
TOLD_S = 5.0


def suggested(bag):
    """Return the maps that are suggested for a recording, as they are read from their text."""
    for suggestion in suggest_each(Recording(bag)):
        text = suggestion_text(suggestion)
        yield suggestion, FeatureMap.from_document(parse_yaml(text, 'map'), 'map', text=text)


def judged(bag, feature_map, constraints):
    return check_data(extract([bag], feature_map), constraints.rule_set)


def told_by(timeline, constraints):
    """Return for how many seconds each rule was violated, by its text."""
    rules, seconds = constraints.rule_set, {}
    for item in timeline.violations:
        text = rules.rules[item.rule].words(rules.space)
        seconds[text] = seconds.get(text, 0.0) + item.active
    return seconds


@pytest.mark.parametrize('kind', KINDS)
def test_the_next_drive_and_faults(tmp_path, kind):
    first, second = (write_robot(tmp_path, kind, seed) for seed in (1, 2))
    learned = [
        (
            feature_map,
            learn_from_files([first], feature_map, OCTreeSettings(), rng=np.random.default_rng(0)),
        )
        for _, feature_map in suggested(first)
    ]
    assert len(learned) == (2 if kind == 'two_robots' else 1)
    for feature_map, constraints in learned:
        timeline = judged(second, feature_map, constraints)
        assert timeline.shares['VIOLATED'] <= FLAGGED_SHARE, told_by(timeline, constraints)
        assert timeline.shares['UNKNOWN'] <= FLAGGED_SHARE
    feature_map, constraints = learned[-1]
    for fault, word in ROBOTS[kind].faults.items():
        timeline = judged(write_robot(tmp_path, kind, 3, fault), feature_map, constraints)
        told = told_by(timeline, constraints)
        assert any(re.search(word, text) and seconds > TOLD_S for text, seconds in told.items()), (
            fault,
            told,
        )


def test_no_clock_counter_or_code_is_used(tmp_path):
    """Of no robot; and each thing left out has its reason."""
    never = re.compile(
        r'timestamp|uptime|sequence|seq|tick|crc|counter|_id\b|mode|state_nav|latitude|longitude'
        r'|setpoint|cycle|energy|charge_drawn|displacement|distance_traveled|covariance'
    )
    for kind in ('px4', 'racecar', 'auv', 'boat'):
        ((suggestion, feature_map),) = suggested(write_robot(tmp_path, kind, 1))
        fields = [str(item.field) for item in feature_map.features]
        assert not [field for field in fields if never.search(field)]
        assert all(reason for _, reason in suggestion.unused)
