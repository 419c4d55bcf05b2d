# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
import os

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.traffic.convert import import_trajectories, read_trajectories
from occ_constraints_pkg.traffic.recorded import FEATURES
from occ_constraints_pkg.traffic.reference_line import ReferenceLine
from synthetic_traffic import commonroad_text, told


@pytest.fixture
def read(tmp_path):
    """Return a function that reads a scenario from text."""

    def read(text):
        path = tmp_path / 'made.xml'
        path.write_text(text, encoding='utf-8')
        return read_trajectories('commonroad', path)

    return read


@pytest.mark.parametrize('version', ['2018b', '2020a'])
def test_features(read, version):
    trajectories = read(commonroad_text(version))
    assert trajectories.names == FEATURES
    assert trajectories.warnings == ()
    assert sorted(set(trajectories.vehicle)) == [11, 12, 13]
    first = {
        number: trajectories.values[trajectories.vehicle == number][0] for number in (11, 12, 13)
    }
    # 11 on the middle lane; 12 is ahead on the lanelet after it, 13 beside it on the left.
    np.testing.assert_allclose(
        first[11], [20.0, 0.0, 500.0, 500.0, 500.0, 0.0, 26.0, 500.0, 6.0, 6.0], atol=1e-9
    )
    np.testing.assert_allclose(
        first[12], [20.0, 0.0, 24.0, 26.0, 500.0, 500.0, 500.0, 500.0, 5.5, 6.5], atol=1e-9
    )
    np.testing.assert_allclose(
        first[13], [20.0, 0.0, 500.0, 500.0, 0.0, 500.0, 500.0, 24.0, 2.0, 10.0], atol=1e-9
    )
    np.testing.assert_allclose(trajectories.time[:5], np.arange(5) / 10)


def test_velocity_is_in_the_frame_of_the_road(read):
    turned = commonroad_text().replace(
        '<orientation><exact>0.0</exact>', '<orientation><exact>0.1</exact>'
    )
    trajectories = read(turned)
    np.testing.assert_allclose(trajectories.values[:, 0], 20.0 * np.cos(0.1))
    np.testing.assert_allclose(trajectories.values[:, 1], 20.0 * np.sin(0.1))


def test_vehicles_beyond_the_lanelets_are_left_out(read):
    trajectories = read(commonroad_text().replace('<y>6.0</y>', '<y>40.0</y>'))
    assert len(trajectories.time) == 10
    assert (
        'made.xml: 5 of 15 rows left out, in which a vehicle is beyond' in trajectories.warnings[0]
    )


def test_what_stands_or_walks_is_left_out(read):
    text = commonroad_text().replace('<type>car</type>', '<type>pedestrian</type>', 1)
    trajectories = read(text)
    assert set(trajectories.vehicle) == {12, 13}
    assert "1 of kind 'pedestrian' left out" in trajectories.warnings[0]


@pytest.mark.parametrize(
    ('old', 'new', 'reason'),
    [
        (
            '<rectangle><length>4.0</length><width>2.0</width></rectangle>',
            '<circle><radius>1.0</radius></circle>',
            '1 with the shape circle left out',
        ),
        (
            '<velocity><exact>20.0</exact></velocity>',
            '<velocity><intervalStart>19</intervalStart><intervalEnd>21</intervalEnd></velocity>',
            '1 with intervals instead of exact values left out',
        ),
        ('trajectory>', 'occupancySet>', '1 given by occupied areas left out'),
        ('point>', 'lanelet>', '1 at areas instead of points left out'),
    ],
)
def test_what_is_not_exact_is_left_out(read, old, new, reason):
    first, obstacle, rest = commonroad_text().partition('<dynamicObstacle')
    obstacle, end, rest = rest.partition('</dynamicObstacle>')
    assert old in obstacle
    trajectories = read(f'{first}<dynamicObstacle{obstacle.replace(old, new)}{end}{rest}')
    assert set(trajectories.vehicle) == {12, 13}
    assert reason in trajectories.warnings[0]


MALFORMED = {
    'another file': (None, '<gpx/>', r'line 1: <gpx> is no scenario; allowed is <commonRoad>'),
    'version': ('"2020a"', '"2006"', r"line 2: <commonRoad> has the version '2006'; allowed are"),
    'step': ('timeStepSize="0.1"', 'timeStepSize="0"', r'line 2: <commonRoad> has timeStepSize 0'),
    'no step': ('timeStepSize="0.1"', '', r"line 2: <commonRoad> lacks the attribute 'timeStep"),
    'wrong step': (
        'timeStepSize="0.1"', 'timeStepSize="0.36"',
        r'<dynamicObstacle> has speeds that are 3.6 times what positions and times say',
    ),
    'missing bound': ('BOUND', '', r'line 3: <lanelet> lacks <rightBound>; it has'),
    'no number': ('<y>12</y>', '<y>top</y>', r"line 4: <y> holds 'top'; allowed is a number"),
    'missing number': ('<y>12</y>', '', r'line 4: <point> lacks <y>; it has x'),
    'one point': (
        '<point><x>0</x><y>12</y></point><point><x>50</x><y>12</y></point><point><x>100</x>'
        '<y>12</y></point><point><x>150</x><y>12</y></point>', '',
        r'line 4: <leftBound> has 1 points; allowed are two or more',
    ),
    'unknown lanelet': (
        '<adjacentRight ref="2"', '<adjacentRight ref="9"',
        r'line 3: lanelet 1 refers to lanelet 9, which is not there',
    ),
    'overlapping lanes': (
        '<leftBound><point><x>0</x><y>4</y>', '<leftBound><point><x>0</x><y>4</y>',
        r'lanelet 3 overlaps lanelet 2 for more than half of their common way',
    ),
    'lanes in a circle': (
        '<predecessor ref="2"/>', '<successor ref="2"/>', r'leads back to itself or to lanes that',
    ),
    'beside itself': (
        '<adjacentRight ref="2"', '<adjacentRight ref="1"', r'lanelet 1 lies beside itself',
    ),
    'lanes of feet': (
        'POSITIONS', '', r'line 3: lanelet 1: the lane is 13.12 m wide; allowed are 2 to 8 m',
    ),
    'no lanes': ('LANES', '', r'line 2: <commonRoad> has no <lanelet>; allowed are one or more'),
    'no vehicles': ('VEHICLES', '', r'made.xml has no moving vehicles; allowed are one or more'),
    'vehicle twice': ('id="12"', 'id="11"', r'<dynamicObstacle> has the id 11 of another one'),
    'no vehicle number': ('id="12"', 'id="x"', r"<dynamicObstacle> has id 'x'; allowed is a num"),
    'shape': ('<rectangle>', '<circle>', r'XML|lacks <shape><rectangle><length>'),
    'length': ('<length>4.0', '<length>400', r'<length> is 400 m; allowed are 0.5 to 40 m'),
    'time goes back': (
        '<time><exact>2</exact>', '<time><exact>1</exact>',
        r'<state> has the time step 1; allowed are whole numbers that grow',
    ),
    'jump': ('<x>84.0</x>', '<x>884.0</x>', r'<dynamicObstacle> jumps, at 8020 m/s to the next'),
    'orientation in degrees': (
        'HEADING', '', r'<dynamicObstacle> heads elsewhere than its positions go, as do most',
    ),
    'off the road': (
        'FAR', '', r'made.xml: no vehicle is on a lanelet; allowed are one or more',
    ),
    'entities': (
        '<commonRoad ', '<!DOCTYPE a [<!ENTITY a "aaaa">]><commonRoad ',
        r'line 2: got an entity declaration; allowed is plain XML',
    ),
    'swapped bounds': ('SWAP', '', r'its leftBound lies to the right of its rightBound'),
}  # fmt: skip


def malformed(old, new):
    """Return a scenario in which something is replaced."""
    text = commonroad_text()
    if old is None:
        return new
    if old == 'POSITIONS':
        for y in (12, 8, 4):
            text = text.replace(f'<y>{y}</y>', f'<y>{y * 3.28}</y>')
        return text
    if old == 'BOUND':
        return text.replace('rightBound', 'wrongBound')
    if old == 'LANES':
        return text[: text.index('<lanelet')] + text[text.index('<dynamic') :]
    if old == 'VEHICLES':
        return text[: text.index('<dynamic')] + '</commonRoad>'
    if old == 'HEADING':
        return text.replace('<exact>0.0</exact></orientation>', '<exact>90.0</exact></orientation>')
    if old == 'FAR':
        for y in ('6.0', '6.5', '10.0'):
            text = text.replace(f'<y>{y}</y>', '<y>90.0</y>')
        return text
    if old == 'SWAP':
        return (
            text.replace('leftBound', 'aBound')
            .replace('rightBound', 'leftBound')
            .replace('aBound', 'rightBound')
        )
    if old.startswith('<leftBound><point><x>0</x><y>4'):
        # The right lane is moved over the middle one, which ends half-way.
        begin = text.index('<lanelet id="3"')
        end = text.index('</lanelet>', begin)
        moved = text[begin:end].replace('<y>4</y>', '<y>7.5</y>').replace('<y>0</y>', '<y>3.5</y>')
        return text[:begin] + moved + text[end:]
    assert old in text
    return text.replace(old, new, 1)


@pytest.mark.parametrize('fault', MALFORMED)
def test_faults_are_told_in_one_sentence(fault, tmp_path):
    old, new, sentence = MALFORMED[fault]
    path = tmp_path / 'made.xml'
    path.write_text(malformed(old, new))
    with pytest.raises(OccError, match=sentence) as caught:
        import_trajectories('commonroad', path, tmp_path / 'bag')
    assert '\n' not in str(caught.value)
    assert 'made.xml' in str(caught.value)
    assert os.listdir(tmp_path) == ['made.xml']


@settings(
    deadline=None, max_examples=50, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(st.floats(0.0, 1.0), st.integers(0, 9), st.binary(max_size=3))
def test_damaged_files_are_read_or_refused(tmp_path, place, removed, inserted):
    data = commonroad_text().encode()
    cut = int(place * len(data))
    path = tmp_path / 'made.xml'
    path.write_bytes(data[:cut] + inserted + data[cut + removed :])
    sentence, trajectories = told(read_trajectories, 'commonroad', path)
    if trajectories is None:
        assert '\n' not in sentence
        assert 'made.xml' in sentence
    else:
        assert np.isfinite(trajectories.values).all()


@pytest.mark.parametrize('kept', [0.0, 0.5, 0.999])
def test_a_truncated_file_is_refused(read, kept):
    text = commonroad_text().rstrip()
    with pytest.raises(OccError, match=r'made.xml, line \d+: it is not valid XML: '):
        read(text[: int(kept * len(text))])


def test_a_reference_line_follows_a_curve():
    # A quarter of a circle of 600 m radius, to the left, with jitter.
    angle = np.linspace(0.0, np.pi / 4, 200)
    jitter = np.random.default_rng(0).normal(0.0, 0.1, 200)
    circle = np.stack([np.sin(angle), 1.0 - np.cos(angle)], axis=1)
    inward = np.stack([-np.sin(angle), np.cos(angle)], axis=1)
    line = ReferenceLine(600.0 * circle + jitter[:, None] * inward)
    middle = slice(40, 160)
    along, left, direction = line.locate(600.0 * circle[middle] + 5.0 * inward[middle])
    np.testing.assert_allclose(along, 600.0 * angle[middle], atol=1.0)
    np.testing.assert_allclose(left, 5.0, atol=0.5)
    np.testing.assert_allclose(direction, angle[middle], atol=0.02)


def test_ngsim(driving):
    path = driving / 'ngsim_us101' / 'USA_US101-15_1_T-1.xml'
    trajectories = read_trajectories('commonroad', path)
    assert len(trajectories.beginnings) == 37
    assert trajectories.warnings == ()
    columns = dict(zip(trajectories.names, trajectories.values.T, strict=True))
    assert np.percentile(columns['v_x'], [0, 100]) == pytest.approx([0.0, 15.9], abs=0.1)
    assert np.abs(columns['v_y']).max() < 2.0
    assert 0.0 < columns['d_left'].min() < 2.0
    # Five lanes, beside which a ramp ends as the sixth.
    road = columns['d_left'] + columns['d_right']
    assert np.percentile(road, [0, 50, 100]) == pytest.approx([3.8, 17.3, 21.0], abs=0.3)
    assert columns['p_rel4'].min() == pytest.approx(1.8, abs=0.1)
    assert trajectories.source['commonroad.benchmarkID'] == 'USA_US101-15_1_T-1'
