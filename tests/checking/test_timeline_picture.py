# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""What the picture of a timeline has: titles, times, bars, features against bounds."""

import numpy as np
import pytest
from occ_constraints_pkg.checking.timeline import check_data
from occ_constraints_pkg.datasets.dataset import Dataset
from occ_constraints_pkg.rules import Feature, FeatureSpace, Literal, Rule, RuleSet

pytest.importorskip('matplotlib')

from matplotlib import pyplot as plt
from matplotlib.collections import PolyCollection
from matplotlib.image import imread
from occ_constraints_pkg.checking.timeline_picture import draw_timeline, timeline_figure
from occ_constraints_pkg.picture_style import VIOLATED

SPACE = FeatureSpace((Feature('speed', 'm/s'), Feature('$load_1$', 'kg')))
FAST = Rule('Rfast', (Literal(0, '>', 1.0),))
HEAVY = Rule('Rheavy', (Literal(0, '>', 0.4), Literal(1, '>', 5.0)))
RULES = RuleSet(SPACE, (FAST, HEAVY), np.array([[0.0, 1.0], [0.0, 5.0]]))


@pytest.fixture(autouse=True)
def closed_figures():
    yield
    plt.close('all')


def data(*lengths, speed=0.5, same_recording=False, begin=0.0):
    """Return episodes at 10 Hz of so many rows, by default each a recording."""
    episodes = np.repeat(np.arange(len(lengths)), lengths)
    times = np.concatenate([np.arange(n) * 0.1 + begin for n in lengths])
    values = np.full((len(episodes), 2), [speed, 1.0])
    count = 1 if same_recording else len(lengths)
    return Dataset(
        SPACE.names,
        values,
        (times * 1e9).astype(np.int64),
        episodes,
        times_ns=(times * 1e9).astype(np.int64),
        recordings=np.zeros_like(episodes) if same_recording else episodes,
        sources=tuple({'name': f'drive_{number}'} for number in range(count)),
    )


def drawn(given, rules=RULES):
    timeline = check_data(given, rules)
    figure = timeline_figure(timeline, rules, 'rules.yaml')
    figure.draw_without_rendering()
    return timeline, figure, figure.axes


def bars(axis):
    """Return begin and end of each bar in the colour of violations."""
    found = []
    for item in axis.collections:
        if isinstance(item, PolyCollection) and np.allclose(
            item.get_facecolor()[0, :3], plt.matplotlib.colors.to_rgb(VIOLATED)
        ):
            found += [
                (path.vertices[:, 0].min(), path.vertices[:, 0].max()) for path in item.get_paths()
            ]
    return sorted(found)


def labels(axis):
    return {
        round(float(place), 6): text.get_text()
        for place, text in zip(axis.get_xticks(), axis.get_xticklabels(), strict=True)
    }


def test_the_title_names_recording_and_rules():
    assert drawn(data(30))[1].get_suptitle() == 'drive_0 judged by rules.yaml'
    assert drawn(data(30, 20))[1].get_suptitle() == '2 recordings judged by rules.yaml'


def test_ticks_tell_the_time_of_each_recording():
    _, _, (_, _, rows, *_) = drawn(data(100, 50))
    told = labels(rows)
    # 10 s of the first, and 5 s of the second after them.
    assert told[0.0] == told[10.0] == '0'
    assert told[2.0] == told[12.0] == '2'
    assert rows.get_xlabel() == (
        'time since the start of each recording [s]; 2 episodes end to end'
    )
    assert max(told) <= rows.get_xlim()[1] == pytest.approx(15.0)


def test_an_episode_keeps_the_time_at_which_it_began():
    given = data(100, 100, same_recording=True)
    times = given.times_ns + given.episodes * int(20e9)
    later = Dataset(**{**vars(given), 'times_ns': times})
    told = labels(drawn(later)[2][2])
    assert told[0.0] == '0'
    assert told[10.0] == '20'


@pytest.mark.parametrize('same_recording', [True, False])
def test_lines_separate_episodes_and_recordings(same_recording):
    _, _, axes = drawn(data(30, 30, same_recording=same_recording))
    style = ':' if same_recording else '-'
    for axis in axes[:3]:
        lines = [
            line
            for line in axis.lines
            if len(line.get_xdata()) == 2 and np.allclose(line.get_xdata(), 3.0)
        ]
        assert [line.get_linestyle() for line in lines] == [style]


def test_bars_agree_with_the_verdicts_and_leave_out_bridged_breaks():
    given = data(100)
    given.values[[20, 21, 23, 24, 99], 0] = 2.0
    timeline, _, (band, _, rows, *_) = drawn(given)
    # The break of 0.1 s is no violation of its own in the list.
    assert len(timeline.violations) == 2
    expected = [(2.0, 2.2), (2.3, 2.5), (9.9, 10.0)]
    assert bars(band) == bars(rows) == [pytest.approx(each) for each in expected]


def test_features_are_drawn_against_their_bounds_around_the_worst():
    given = data(600)
    given.values[300:310] = [[1.5 + 0.1 * number, 1.0] for number in range(10)]
    given.values[400:420, 1] = 9.0
    timeline, _, axes = drawn(given)
    panels = axes[3:]
    shown = {axis.get_ylabel(): axis for axis in panels}
    assert [axis.get_title(loc='left') for axis in panels[:2]] == [
        'Rheavy: speed above 0.4 m/s and\n$load_1$ above 5 kg',
        'Rfast: speed above 1 m/s',
    ]
    assert set(shown) == {'speed [m/s]', '$load_1$ [kg]'}
    fast = panels[1]
    assert [line.get_ydata()[0] for line in fast.lines if line.get_linestyle() == '--'] == [1.0]
    # In the recording's own time, with what is before and after, and no more than there is.
    assert fast.get_xlim() == pytest.approx((28.0, 33.0), abs=0.2)
    assert bars(fast) == [pytest.approx((30.0, 31.0))]
    assert fast.get_xlabel() == 'time [s]'
    (worst,) = [line for line in fast.lines if line.get_marker() == 'o']
    assert (*worst.get_xdata(), *worst.get_ydata()) == pytest.approx((30.9, 2.4))
    assert timeline.starts[timeline.violations[0].worst] == pytest.approx(30.9)


def test_a_short_violation_of_a_long_recording_is_pointed_at():
    given = data(36_000)
    given.values[18_000, 0] = 1.5
    _, _, (band, margin, *_) = drawn(given)
    (pointer,) = [line for line in band.lines if line.get_marker() == 'v']
    assert list(pointer.get_xdata()) == pytest.approx([1800.05])
    # Where each column of the picture has many samples, the least margin is not lost.
    lows = [line.get_ydata() for line in margin.lines if line.get_color() == VIOLATED]
    assert min(low.min() for low in lows if len(low)) < 0.0


def test_one_outlier_leaves_the_other_margins_their_height():
    given = data(1000)
    given.values[:, 0] = 0.9 + 0.05 * np.sin(np.arange(1000))
    given.values[500, 0] = 100.0
    _, _, (_, margin, *_) = drawn(given)
    assert margin.get_ylim()[0] > -1.0
    assert margin.get_title(loc='right').startswith('lowest margin -')
    assert [line for line in margin.lines if line.get_marker() == 'v' and len(line.get_xdata())]


def test_legends_lie_beside_the_data():
    given = data(100, 80)
    given.values[20:40, 0] = 2.0
    _, figure, axes = drawn(given)
    legends = [legend for part in figure.subfigs for legend in part.legends]
    assert len(legends) == 2
    for legend in legends:
        for axis in axes:
            assert not legend.get_window_extent().overlaps(axis.get_window_extent())


def test_nothing_violated_nothing_known_and_one_row_are_drawn(tmp_path):
    for given in (data(30), data(30, speed=np.nan), data(1, speed=2.0)):
        timeline = check_data(given, RULES)
        draw_timeline(tmp_path / 'timeline.png', timeline, RULES, 'rules.yaml')
        assert imread(tmp_path / 'timeline.png').shape[1] == 880
