# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Families are told by names, units and values together, and nothing else is taken for one."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from occ_constraints_pkg.learning.likely_families import likely_families, with_families
from occ_constraints_pkg.rules import Feature, FeatureSpace

SEEDS = st.integers(0, 2**32 - 1)
# How people name the sectors of a sensor: with {} for the number.
SCHEMES = (
    *('d_l{}', 'hazards_{}', 'range[{}]', 'lidar2_d{}', 'sonar({})', 'sector_{:02d}', 'beam-{}'),
    *('front_{}_min', 'r{}', 'scan.ranges[{}]', 'Sonar {}'),
)


def sectors(rng, members, rows=1500, reach=3.0):
    """Nearness of the closest thing in each direction, 0 for nothing in range."""
    things = 4
    distance = np.sqrt(rng.random((rows, things))) * 2 * reach
    where = rng.integers(0, members, (rows, things))
    found = np.zeros((rows, members))
    for thing in range(things):
        nearness = np.clip(1.0 - distance[:, thing] / reach, 0.0, 1.0)
        np.maximum.at(found, (np.arange(rows), where[:, thing]), nearness)
    return found


def joints(rng, members, rows=1500):
    """Each moves slowly about a place of its own, within a range of its own."""
    places = rng.permutation(np.linspace(-2.5, 2.5, members))
    widths = rng.uniform(0.1, 0.6, members)
    return places + widths * np.sin(rng.random((rows, members)) * 2 * np.pi)


def space(names, **changes):
    return FeatureSpace(tuple(Feature(name, **changes) for name in names))


@settings(max_examples=40)
@given(SEEDS, st.sampled_from(SCHEMES), st.integers(4, 20), st.integers(0, 100))
def test_sectors_are_a_family_however_they_are_named_and_counted(seed, scheme, members, first):
    rng = np.random.default_rng(seed)
    names = [scheme.format(first + number) for number in range(members)]
    values = np.column_stack([rng.normal(size=1500), sectors(rng, members), rng.normal(size=1500)])
    order = rng.permutation(members + 2)
    shuffled = [('speed', *names, 'turn')[place] for place in order]
    (found,) = likely_families(values[:, order], space(shuffled))
    assert sorted(shuffled[member] for member in found.features) == sorted(names)
    assert found.is_telling
    assert (found.low, found.high) == (0.0, 1.0)


@settings(max_examples=40)
@given(SEEDS, st.sampled_from(SCHEMES), st.integers(4, 12))
def test_joints_of_an_arm_are_no_family(seed, scheme, members):
    names = [scheme.format(number) for number in range(members)]
    assert likely_families(joints(np.random.default_rng(seed), members), space(names)) == []


@settings(max_examples=40)
@given(SEEDS, st.integers(4, 12))
def test_labels_and_flags_are_no_family(seed, members):
    rng = np.random.default_rng(seed)
    modes = np.eye(members)[rng.integers(0, members, 500)]
    assert likely_families(modes, space([f'mode_{number}' for number in range(members)])) == []


@pytest.mark.parametrize(
    'names',
    [
        ['x1', 'x2'],
        ['d_0', 'd_1', 'd_2'],
        ['a_x', 'a_y', 'a_z', 'a_w'],
        ['front', 'left', 'right', 'back'],
        ['d_0', 'e_1', 'f_2', 'g_3'],
    ],
)
def test_few_features_and_names_without_a_number_are_no_family(names):
    values = sectors(np.random.default_rng(0), len(names))
    assert likely_families(values, space(names)) == []


def test_members_share_unit_and_bounds():
    values = sectors(np.random.default_rng(0), 8)
    features = [Feature(f'd{i}', 'm' if i % 2 else '1') for i in range(8)]
    found = likely_families(values, FeatureSpace(tuple(features)))
    assert [family.features for family in found] == [(0, 2, 4, 6), (1, 3, 5, 7)]
    declared = with_families(FeatureSpace(tuple(features)), found)
    assert declared.families == ((0, 2, 4, 6), (1, 3, 5, 7))
    units = [Feature(f'd{i}', unit) for i, unit in enumerate(('m', 'rad', 's', 'V'))]
    assert likely_families(values[:, :4], FeatureSpace(tuple(units))) == []


def test_names_that_programs_give_are_told_but_say_nothing():
    values = sectors(np.random.default_rng(0), 8)
    for stem in ('x', 'column_', 'Feature', 'f', 'obs_'):
        (found,) = likely_families(values, space([f'{stem}{i}' for i in range(8)]))
        assert not found.is_telling


def test_what_is_declared_stays():
    values = sectors(np.random.default_rng(0), 8)
    declared = space([f'd{i}' for i in range(8)], family='scan')
    assert likely_families(values, declared) == []
    bounded = space([f'd{i}' for i in range(8)], low=0.0, high=2.0)
    (found,) = likely_families(values, bounded)
    assert (found.low, found.high) == (0.0, 2.0)


def test_a_scanner_that_is_often_at_its_range_ends_at_contact():
    ranges = 5.0 * (1.0 - sectors(np.random.default_rng(0), 8))
    (found,) = likely_families(ranges, space([f'range[{i}]' for i in range(8)]))
    assert (found.name, found.low, found.high) == ('range', 0.0, np.inf)


def test_wheels_are_a_family_without_bounds():
    speeds = np.random.default_rng(0).normal(size=(1000, 4))
    (found,) = likely_families(speeds, space([f'wheel_{i}' for i in range(4)]))
    assert (found.low, found.high) == (-np.inf, np.inf)


def test_a_taken_name_is_not_given_to_a_family():
    values = np.column_stack([sectors(np.random.default_rng(0), 4), np.ones(1500)])
    names = [*(f'scan_{i}' for i in range(4)), 'scan']
    found = likely_families(values, space(names))
    declared = with_families(space(names), found)
    assert [feature.family for feature in declared.features] == ['scan_'] * 4 + ['']
    assert declared.families == ((0, 1, 2, 3),)


def test_no_usable_sample_is_no_family():
    assert likely_families(np.empty((0, 4)), space([f'd{i}' for i in range(4)])) == []
