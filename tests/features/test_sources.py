# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from occ_constraints_pkg.documents import dump_yaml, parse_yaml
from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.features.feature_map import FeatureMap
from occ_constraints_pkg.features.sources import FeatureSource, Reading

TEXT = """\
schema_version: 1
pace: scan
max_age: 0.5
features:
- {name: yaw, topic: odom, field: pose.pose.orientation|yaw, unit: rad}
- {name: turning, topic: odom, field: pose.pose.orientation, transform: [yaw, rate, abs]}
- {name: near, topic: scan, field: 'ranges[0:16]|min', missing: drop, unit: m}
- {name: front, topic: scan, field: ranges, degrees: [-15, 15], reduce: mean, unit: m}
- {name: slip, topic: cmd_vel, field: linear.x, minus: {topic: odom, field: twist.twist.linear.x},
   transform: [abs, {scale: 100}, {offset: -1}, {clip: [null, 50]}, {round: 0.5}], unit: cm/s}
- {name: off, topic: odom, field: pose.pose.orientation|yaw,
   minus: {topic: imu, field: orientation|yaw}, unit: rad}
- {name: clear, topic: scan, field: ranges, sectors: 4, reduce: min, unit: m, bounds: [0, 3]}
"""


def feature_map(text=TEXT):
    return FeatureMap.from_document(parse_yaml(text, 'map'), 'map', text=text)


def test_all_keys():
    features = {item.name: item for item in feature_map().features}
    assert (features['yaw'].field, features['yaw'].reduce) == ('pose.pose.orientation', 'yaw')
    assert features['turning'].reduce == 'yaw'
    assert features['turning'].transform == (('rate',), ('abs',))
    assert (features['near'].field, features['near'].reduce) == ('ranges[0:16]', 'min')
    assert features['front'].degrees == (-15.0, 15.0)
    assert features['slip'].minus == Reading('odom', 'twist.twist.linear.x')
    assert features['slip'].transform == (
        ('abs',),
        ('scale', 100.0),
        ('offset', -1.0),
        ('clip', -np.inf, 50.0),
        ('round', 0.5),
    )
    assert features['off'].minus == Reading('imu', 'orientation', reduce='yaw')
    assert list(features)[-4:] == ['clear_front', 'clear_left', 'clear_rear', 'clear_right']
    assert features['clear_front'].degrees == (-45.0, 45.0)
    assert features['clear_right'].degrees == (225.0, 315.0)
    assert {item.family for item in features.values()} == {'', 'clear'}


def test_topics_and_readings_know_what_is_subtracted():
    found = feature_map()
    assert found.topics == ('scan', 'odom', 'cmd_vel', 'imu')
    assert [name for name, _ in found.readings[-2:]] == ['slip', 'off']
    assert len(found.readings) == len(found.features) + 2


def test_document_comes_back():
    found = feature_map()
    again = parse_yaml(dump_yaml(found.to_document()), 'again')
    assert FeatureMap.from_document(again, 'again') == found


def test_fixed_rate_comes_back():
    found = feature_map(TEXT.replace('pace: scan', 'pace: {rate: 12.5}'))
    assert (found.pace, found.rate) == ('', 12.5)
    assert found.to_document()['pace'] == {'rate': 12.5}
    assert FeatureMap.from_document(found.to_document(), 'again') == found
    assert found.topics[0] == 'odom'


def test_names_of_sectors():
    def names(keys):
        text = (
            'schema_version: 1\npace: scan\nmax_age: 1\nfeatures:\n'
            f'- {{name: d, topic: scan, field: ranges, reduce: min, {keys}}}\n'
        )
        return [item.name for item in feature_map(text).features]

    assert names('sectors: 8')[:3] == ['d_front', 'd_front_left', 'd_left']
    assert names('sectors: 6') == ['d_0', 'd_60', 'd_120', 'd_180', 'd_240', 'd_300']
    assert names('sectors: 2, degrees: [-90, 90]') == ['d_315', 'd_45']
    assert len(set(names('sectors: 360'))) == 360


def test_a_name_alone_is_one_step():
    assert FeatureSource('f', 'odom', 'x', transform='abs').transform == (('abs',),)
    yaw = FeatureSource('f', 'odom', 'x', transform='yaw')
    assert (yaw.reduce, yaw.transform) == ('yaw', ())


@pytest.mark.parametrize(
    ('old', 'new', 'sentence'),
    [
        ('orientation|yaw, unit', 'orientation|jaw, unit', "got '|jaw'; did you mean 'yaw'?"),
        ('orientation|yaw, unit', 'orientation|abs|min, unit', "got '|min' after another step"),
        ("16]|min'", "16]|min', reduce: max", "reduce: got one beside '|min'"),
        ('[yaw, rate, abs]', '[rate, yaw]', 'after another step; allowed is yaw as the first'),
        ('[yaw, rate, abs]', '[rate, rate]', "got 'rate' twice"),
        ('[yaw, rate, abs]', '[rat]', "transform[0]: got 'rat'; did you mean 'rate'?"),
        ('[yaw, rate, abs]', '[{rate: 1}]', 'got 1 for rate; allowed is nothing'),
        ('[yaw, rate, abs]', '[scale]', 'got None for scale; allowed is a finite number other'),
        ('[yaw, rate, abs]', '7', 'transform: got 7; allowed is text or a list'),
        ('scale: 100', 'scale: 0', 'got 0 for scale'),
        ('scale: 100', 'scale: .inf', 'got inf for scale'),
        ('scale: 100', 'scale: 1, offset: 2', 'transform[1]: got 2 keys; allowed is one'),
        ('round: 0.5', 'round: -1', 'got -1 for round; allowed is a finite number above 0'),
        ('[null, 50]', '[5, 5]', 'got [5, 5] for clip; allowed is [low, high]'),
        ('[null, 50]', '[null]', 'got [None] for clip'),
        ('degrees: [-15, 15]', 'degrees: [15, -15]', 'degrees: got [15, -15]; allowed are two'),
        ('degrees: [-15, 15]', 'degrees: [0, 361]', 'larger by at most 360'),
        ('degrees: [-15, 15]', 'degrees: [.nan, 15]', 'degrees: got [nan, 15]'),
        ('degrees: [-15, 15], reduce: mean', 'degrees: [-15, 15]', '"reduce" is missing, which a'),
        ('field: ranges, degrees', "field: 'ranges[0:9]', degrees", 'beside a sector'),
        ('sectors: 4', 'sectors: 1', 'sectors: got 1; allowed is a number of at least 2'),
        ('sectors: 4', 'sectors: 9, degrees: [0, 8]', 'sectors of at least 1 degree'),
        ('minus: {topic: odom', 'minus: {topik: odom', "did you mean 'topic'?"),
        ('imu, field: orientation|yaw', 'imu, field: x|abz', "minus.field: got '|abz'; did"),
        (
            'pace: scan',
            'pace: {rate: 0}',
            'pace.rate: got 0; allowed is a number of at least 0.001',
        ),
        (
            'pace: scan',
            'pace: {rate: .inf}',
            'pace.rate: got inf; allowed is a number of at most 1000000',
        ),
        ('pace: scan', 'pace: {hz: 3}', 'pace.hz: unknown key'),
        ('missing: drop', 'missing: dorp', "got 'dorp'; did you mean 'drop'?"),
        ('bounds: [0, 3]', f'bounds: [0, 1{"0" * 400}]', 'a number is too large'),
    ],
)
def test_one_sentence_for_each_mistake(old, new, sentence):
    assert old in TEXT
    with pytest.raises(OccError) as caught:
        feature_map(TEXT.replace(old, new, 1))
    assert sentence in str(caught.value)
    assert '\n' not in str(caught.value)


def test_columns_take_steps_too():
    text = (
        'schema_version: 1\npace: t\nmax_age: 1\nfeatures:\n'
        "- {name: a, topic: t, column: 'a|abs'}\n"
        "- {name: b, topic: t, column: 'b|other', minus: {topic: t, column: a}, transform: rate}\n"
    )
    a, b = feature_map(text).features
    assert (a.column, a.transform) == ('a', (('abs',),))
    # What follows the bar is no step, so it belongs to the column's name.
    assert (b.column, b.minus.column) == ('b|other', 'a')
    for old, new in (('|abs', '|yaw'), ('|abs', '|min'), ("'a|abs'", 'a, sectors: 3')):
        with pytest.raises(OccError, match='table column'):
            feature_map(text.replace(old, new, 1))


@given(
    st.lists(
        st.one_of(
            st.sampled_from([('abs',), ('rate',)]),
            st.tuples(st.just('scale'), st.floats(0.1, 1e6)),
            st.tuples(st.just('offset'), st.floats(-1e6, 1e6)),
            st.tuples(st.just('clip'), st.floats(-1e6, 0.0), st.floats(0.5, 1e6)),
            st.tuples(st.just('clip'), st.just(-np.inf), st.floats(0.5, 1e6)),
            st.tuples(st.just('round'), st.floats(1e-6, 10.0)),
        ),
        max_size=5,
    ).filter(lambda steps: steps.count(('rate',)) < 2),
    st.sampled_from([None, Reading('imu', 'a.b', reduce='norm'), Reading('b', 'q', reduce='yaw')]),
    st.sampled_from([None, 'yaw', 'min']),
)
def test_any_feature_comes_back(steps, minus, reduce):
    source = FeatureSource('f', 'odom', 'x.y', reduce=reduce, transform=tuple(steps), minus=minus)
    found = FeatureMap('odom', 1.0, (source,))
    document = parse_yaml(dump_yaml(found.to_document()), 'map')
    assert FeatureMap.from_document(document, 'map') == found
