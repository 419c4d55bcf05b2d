# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from occ_constraints_pkg.documents import dump_yaml, parse_yaml
from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.features.feature_map import BUILT_IN_MAPS, FeatureMap, load_feature_map

TEXT = """\
schema_version: 1
pace: observation
max_age: 0.5
features:
- {name: v_x, topic: odom, field: twist.twist.linear.x, unit: m/s}
- {name: d_front, topic: /scan, field: 'ranges[0:20]', reduce: min, unit: m, bounds: [0, null],
   missing: max_range}
- {name: d_l0, topic: observation, column: hazards_lidar_0, unit: '1', bounds: [0, 1]}
- {name: yaw, topic: odom, field: pose.pose.orientation, transform: yaw, unit: rad}
"""


def load(tmp_path, text):
    path = tmp_path / 'map.yaml'
    path.write_text(text)
    return load_feature_map(path)


def test_reads_every_key(tmp_path):
    feature_map = load(tmp_path, TEXT)
    assert feature_map.names == ('v_x', 'd_front', 'd_l0', 'yaw')
    assert feature_map.topics == ('observation', 'odom', '/scan')
    assert feature_map.space.highs.tolist() == [np.inf, np.inf, 1.0, np.inf]
    front = feature_map.features[1]
    assert (front.reduce, front.missing, front.low, front.high) == ('min', 'max_range', 0, np.inf)


def test_document_comes_back(tmp_path):
    feature_map = load(tmp_path, TEXT)
    document = parse_yaml(dump_yaml(feature_map.to_document()), 'text')
    assert FeatureMap.from_document(document, 'text') == feature_map


def test_built_in_maps():
    tasks = ('CarGoal1', 'CarPush1', 'PointGoal1', 'PointPush1')
    roads = ('highway', 'highway_following', 'highway_road')
    names = [*tasks, *roads, 'simple_nav']
    assert list(BUILT_IN_MAPS) == names
    assert load_feature_map('simple_nav').names == ('x', 'y')
    highway = load_feature_map('highway')
    gaps = [f'p_rel{i}' for i in range(6)]
    assert list(highway.names) == ['v_x', 'v_y', *gaps, 'd_left', 'd_right']
    assert highway.space.highs[2:8].tolist() == [500.0] * 6
    for name in roads[1:]:
        assert set(load_feature_map(name).features) < set(highway.features)
    point_goal = load_feature_map('PointGoal1')
    lidar = [f'd_l{i}' for i in range(16)]
    for name in tasks:
        assert load_feature_map(name).features == point_goal.features
    assert list(point_goal.names) == ['a_x', 'a_y', 'v_x', 'v_y', *lidar]
    assert point_goal.topics == ('observation',)
    assert point_goal.space.highs[4:].tolist() == [1.0] * 16
    with pytest.raises(OccError, match=r"'PointGoal'; did you mean 'PointGoal1'\?.*simple_nav"):
        load_feature_map('PointGoal')


@pytest.mark.parametrize(
    ('old', 'new', 'sentence'),
    [
        ('max_age: 0.5', 'max_age: 0', 'line 3: max_age: got 0; allowed is a number above 0'),
        (
            'max_age: 0.5',
            'max_age: .inf',
            'max_age: got inf; allowed is a number of at most 1000000',
        ),
        ('max_age: 0.5', 'max_age: 1e300', 'max_age: got 1e+300; allowed is a number of at most'),
        (
            'pace: observation',
            'pace: {rate: 1e-300}',
            'got 1e-300; allowed is a number of at least',
        ),
        ('pace: observation', f'pace: {"a" * 300}', 'allowed is text no longer than 247'),
        ('topic: odom', f'topic: {"a" * 300}', 'allowed is text no longer than 247'),
        ('max_age: 0.5\n', '', "line 1: the key 'max_age' is missing"),
        ('pace:', 'Pace:', "line 2: Pace: unknown key; did you mean 'pace'? allowed keys are"),
        ('pace: observation', 'pace: a b', "line 2: pace: got 'a b'; allowed is a topic name"),
        ('version: 1', 'version: 2', 'line 1: schema_version: got 2; allowed is 1'),
        ('field: twist', 'fild: twist', 'line 5: features[0].fild: unknown key; did you mean'),
        ('field: twist', 'column: c, field: twist', 'got field, column of the keys field, column'),
        (', column: hazards_lidar_0', '', 'line 8: features[2]: got none of the keys'),
        ('linear.x', 'linear..x', "field: got 'twist.twist.linear..x'; allowed is a field path"),
        ('reduce: min', 'reduce: mim', "got 'mim'; did you mean 'min'? allowed are min, max"),
        (' reduce: min,', '', 'features[1]: the key "reduce" is missing'),
        ('[0, null]', '[0]', 'line 6: features[1].bounds: got [0]; allowed is'),
        ('[0, null]', '[0, a]', "bounds[1]: got 'a'; allowed is a number or null"),
        ('[0, 1]', '[2, 1]', 'bounds [2.0, 1.0]'),
        ('[0, 1]', '[.nan, 1]', 'bounds [nan, 1.0]'),
        ('name: yaw', 'name: v_x', "feature 'v_x' is named twice"),
        ('bounds: [0, 1]', 'reduce: max', "reduce: got 'max' for a table column"),
        ('bounds: [0, 1]', 'transform: yaw', "transform: got 'yaw' for a table column"),
        ('transform: yaw', 'transform: yaw, reduce: norm', "transform 'yaw' with reduce 'norm'"),
        ('topic: odom', 'topic: observation', 'of which another feature is a table column'),
        ('features:', 'features: [', 'is not valid YAML'),
    ],
)
def test_one_sentence_for_each_mistake(tmp_path, old, new, sentence):
    with pytest.raises(OccError) as caught:
        load(tmp_path, TEXT.replace(old, new, 1))
    assert str(caught.value).startswith(str(tmp_path / 'map.yaml'))
    assert sentence in str(caught.value)
    assert '\n' not in str(caught.value)
