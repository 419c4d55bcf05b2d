# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
import dataclasses

import numpy as np
import pytest

pytest.importorskip('matplotlib')

from matplotlib import pyplot as plt
from occ_constraints_pkg.agents.highway_film import (
    _draw_timeline,
    _violations,
    draw_drives,
    drive_through,
)
from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.rules import Feature, FeatureSpace, Literal, Rule, RuleSet
from occ_constraints_pkg.rules.constraints_file import Constraints
from PIL import Image


def test_a_drive_ends_as_the_world_says():
    off = drive_through(lambda seen: np.array([[0.0, 0.2]]), 0)
    assert off.end == 'off the road'
    assert off.vehicles.shape == (len(off.observation), 21, 3)
    assert 5 < len(off.vehicles) < 60
    # The ego is first, and goes to the left.
    assert off.vehicles[-1, 0, 1] < off.vehicles[0, 0, 1]
    assert off.returned == pytest.approx(0.2 * 0.5 * (len(off.vehicles) - 1), abs=0.2)


@pytest.mark.parametrize('suffix', ['png', 'gif'])
def test_drives_are_drawn_under_one_another(tmp_path, suffix):
    drive = drive_through(lambda seen: np.array([[0.0, 0.2]]), 0)
    short = dataclasses.replace(
        drive, vehicles=drive.vehicles[:9], observation=drive.observation[:9]
    )
    path = tmp_path / f'drives.{suffix}'
    draw_drives(path, {'one': short, 'other': short}, None)
    with Image.open(path) as picture:
        assert picture.width == (880 if suffix == 'png' else 640)
        assert getattr(picture, 'n_frames', 1) == (1 if suffix == 'png' else 3)


def test_another_suffix_is_refused(tmp_path):
    with pytest.raises(OccError, match=r'allowed are \.png and \.gif'):
        draw_drives(tmp_path / 'drives.mp4', {}, None)


def _rules(column):
    """A rule that every drive violates, if it is looked up in the column ``v_x``."""
    space = FeatureSpace((Feature('speed', 'm/s'),))
    rule_set = RuleSet(space, (Rule('R1', (Literal(0, '>', -1.0),)),), np.array([[0.0, 1.0]]))
    feature = {'name': 'speed', 'topic': 'observation', 'column': column, 'unit': 'm/s'}
    document = {'schema_version': 1, 'pace': 'observation', 'max_age': 0.5, 'features': [feature]}
    return Constraints(rule_set, feature_map=document)


def test_rules_are_judged_on_the_columns_that_they_name():
    drive = drive_through(lambda seen: np.array([[0.0, 0.2]]), 0)
    drive.observation[:, 0], drive.observation[:, 8] = 5.0, -5.0
    assert list(_violations(drive, _rules('v_x')).values())[0].all()
    assert _violations(drive, _rules('d_left')) == {}


def test_rules_of_another_world_are_refused_not_drawn_as_kept(tmp_path):
    drive = drive_through(lambda seen: np.array([[0.0, 0.2]]), 0)
    with pytest.raises(OccError, match='no column of the observation of highway'):
        draw_drives(tmp_path / 'drive.png', {'one': drive}, _rules('x'))
    assert not list(tmp_path.iterdir())


def test_without_rules_the_picture_claims_no_verdict():
    drive = drive_through(lambda seen: np.array([[0.0, 0.2]]), 0)
    for truths, text in ((None, 'no rules given'), ({}, 'no rule violated')):
        axis = plt.figure().add_subplot()
        _draw_timeline(axis, drive, truths)
        assert [item.get_text() for item in axis.texts] == [text]
        plt.close(axis.figure)


def test_no_bar_of_a_violation_reaches_beyond_the_drive():
    drive = drive_through(lambda seen: np.array([[0.0, 0.2]]), 0)
    axis = plt.figure().add_subplot()
    _draw_timeline(axis, drive, {'always': np.ones(len(drive.vehicles), dtype=bool)})
    (bars,) = axis.collections
    ends = [path.vertices[:, 0].max() for path in bars.get_paths()]
    assert max(ends) == pytest.approx((len(drive.vehicles) - 1) * 0.2)
    assert axis.get_xlabel() == 'time [s]'
    plt.close(axis.figure)
