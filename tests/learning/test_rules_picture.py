# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""What the picture of rules has: rows, panels, bounds, corners and words."""

import numpy as np
import pytest
from occ_constraints_pkg.errors import DataError
from occ_constraints_pkg.rules import Feature, FeatureSpace, Literal, Rule, RuleSet
from occ_constraints_pkg.rules.constraints_file import Constraints

pytest.importorskip('matplotlib')

from matplotlib import pyplot as plt
from matplotlib.collections import QuadMesh
from matplotlib.image import imread
from matplotlib.patches import Rectangle
from occ_constraints_pkg.learning.rules_picture import draw_rules, rules_figure
from occ_constraints_pkg.picture_style import VIOLATED

SPACE = FeatureSpace(
    (
        Feature('speed', 'm/s'),
        Feature('mode'),
        Feature('d_0', 'm', low=0.0, family='d'),
        Feature('d_1', 'm', low=0.0, family='d'),
        Feature('$load_1$', 'kg'),
    )
)
SPEED, MODE, LOAD, NEAR = 0, 1, 4, (2, 3)
FAST = Literal(SPEED, '>', 0.8)
CLOSE = Literal(NEAR, '<', 0.5)


@pytest.fixture(autouse=True)
def closed_figures():
    yield
    plt.close('all')


@pytest.fixture
def values():
    """Return samples that are never both fast and close."""
    rng = np.random.default_rng(0)
    speed, load, mode = rng.uniform(0.0, 1.0, 500), rng.uniform(10.0, 20.0, 500), np.arange(500) % 3
    near, far = rng.uniform(0.1, 2.0, 500), rng.uniform(2.0, 4.0, 500)
    near[(speed > 0.8) & (near < 0.5)] += 1.0
    return np.column_stack([speed, mode, far, near, load])


def constraints(*rules, evidence=None):
    named = tuple(rule if isinstance(rule, Rule) else Rule(*rule) for rule in rules)
    ranges = np.array([[0.0, 1.0], [0.0, 2.0], [2.0, 4.0], [0.1, 2.0], [10.0, 20.0]])
    return Constraints(RuleSet(SPACE, named, ranges), evidence=evidence or {})


def corners(panel):
    """Return (left, right, bottom, top) of the hatched rectangles."""
    return [
        (*patch.get_bbox().intervalx, *patch.get_bbox().intervaly)
        for patch in panel.patches
        if isinstance(patch, Rectangle) and patch.get_hatch()
    ]


def density(panel):
    """Return the samples drawn in a panel."""
    return sum(item.get_array().sum() for item in panel.collections if isinstance(item, QuadMesh))


def words(axis):
    """Return the texts about rules, without the ends of demonstrated ranges."""
    return [text.get_text() for text in axis.texts if text.get_color() == VIOLATED]


def rows(axis):
    return [label.get_text() for label in axis.get_yticklabels()]


def test_a_family_is_one_row_of_its_bounded_end(values):
    (axis,) = rules_figure(constraints(('R1', (CLOSE,))), values).axes
    assert rows(axis) == ['speed [m/s]', 'mode', 'smallest d [m]', '$load_1$ [kg]']
    assert words(axis) == ['R1: < 0.5']
    far = Rule('R2', (Literal(NEAR, '>', 3.9),))
    (axis,) = rules_figure(constraints(('R1', (CLOSE,)), far), values).axes
    assert rows(axis)[2] == 'smallest and largest d [m]'
    assert len(rows(axis)) == 4


def test_a_bar_ends_where_its_data_do_and_no_text_lies_on_it(values):
    (axis,) = rules_figure(constraints(('R1', (FAST,)), ('R2', (CLOSE,))), values).axes
    figure = axis.figure.figure
    figure.draw_without_rendering()
    bars = [line for line in axis.lines if line.get_color() != VIOLATED]
    assert {line.get_solid_capstyle() for line in bars} == {'butt'}
    # In pixels: texts are above or below the line, not on it.
    middles = {round(axis.transData.transform((0.0, line.get_ydata()[0]))[1]) for line in bars}
    for text in axis.texts:
        box = text.get_window_extent()
        assert not any(box.y0 < middle < box.y1 for middle in middles)


def test_a_member_with_a_rule_of_its_own_has_its_own_row(values):
    own = Rule('R2', (Literal(2, '<', 2.5),))
    (axis,) = rules_figure(constraints(('R1', (CLOSE,)), own), values).axes
    assert rows(axis) == ['speed [m/s]', 'mode', 'smallest d [m]', 'd_0 [m]', '$load_1$ [kg]']


def test_a_bound_far_beyond_is_named_at_the_edge_of_what_is_drawn_to_scale(values):
    (axis,) = rules_figure(constraints(('R1', (Literal(SPEED, '>', 50.0),))), values).axes
    assert words(axis) == ['R1: > 50']
    markers = [line for line in axis.lines if line.get_marker() == '>']
    assert [axis.get_xlim()[0] < line.get_xdata()[0] < axis.get_xlim()[1] for line in markers] == [
        True
    ]


def test_a_gap_is_a_stretch_of_a_row_and_no_panel(values):
    gap = Rule('R1', (Literal(LOAD, '>', 12.0), Literal(LOAD, '<', 14.0)))
    (axis,) = rules_figure(constraints(gap), values).axes
    assert words(axis) == ['R1: > 12 and < 14']
    (stretch,) = axis.patches
    assert stretch.get_bbox().intervalx == pytest.approx([0.2, 0.4])


def test_many_gaps_of_a_row_share_one_text(values):
    gaps = [
        Rule(f'R{low}', (Literal(LOAD, '>', low + 0.2), Literal(LOAD, '<', low + 0.8)))
        for low in (11.0, 13.0, 15.0)
    ]
    (axis,) = rules_figure(constraints(*gaps), values).axes
    assert words(axis) == ['3 rules between two bounds each']
    assert len(axis.patches) == 3


def test_a_family_whose_members_all_have_rules_has_no_row_of_its_own(values):
    own = [Rule(f'R{member}', (Literal(member, '<', 0.4),)) for member in NEAR]
    (axis,) = rules_figure(constraints(*own), values).axes
    assert rows(axis) == ['speed [m/s]', 'mode', 'd_0 [m]', 'd_1 [m]', '$load_1$ [kg]']


def test_each_rule_about_two_numbers_has_a_panel_with_its_corner(values):
    rule = Rule('R1', (FAST, CLOSE))
    evidence = {
        'near': 0.01,
        'rules': [
            {
                'id': 'R1',
                'formula': rule.formula(SPACE),
                'flagged': 0,
                'expected': 0.0421,
                'seen': 0.0,
                'evidence': 33.0,
                'literals': [{'near': 0, 'episodes': 0, 'closest': []}] * 2,
            }
        ],
    }
    off = Rule('R2', (FAST, Literal(LOAD, '>', 15.0)), enabled=False)
    _, panel = rules_figure(constraints(rule, off, evidence=evidence), values).axes
    assert panel.get_title(loc='left').split('\n') == [
        'R1: speed above 0.8 m/s and any d below 0.5 m',
        'there: expected 4.21%, seen 0.00%, evidence 33',
    ]
    assert (panel.get_xlabel(), panel.get_ylabel()) == ('speed [m/s]', 'smallest d [m]')
    assert words(panel) == ['> 0.8', '< 0.5']
    right, bottom = panel.get_xlim()[1], panel.get_ylim()[0]
    assert corners(panel) == [pytest.approx((0.8, right, bottom, 0.5))]
    # No distance is below 0.
    assert bottom == 0.0
    assert density(panel) == len(values)


def test_an_edited_rule_is_drawn_without_what_was_expected(values):
    learned = Rule('R1', (FAST, CLOSE))
    item = {'id': 'R1', 'formula': learned.formula(SPACE), 'flagged': 0, 'expected': 0.1}
    item |= {'seen': 0.0, 'evidence': 9.0, 'literals': []}
    moved = Rule('R1', (Literal(SPEED, '>', 0.9), CLOSE))
    drawn = constraints(moved, evidence={'near': 0.01, 'rules': [item]})
    _, panel = rules_figure(drawn, values).axes
    assert panel.get_title(loc='left') == 'R1: speed above 0.9 m/s and any d below 0.5 m'


def test_of_three_numbers_the_mode_is_the_condition(values):
    rule = Rule('R1', (Literal(MODE, '>=', 2.0), FAST, CLOSE))
    _, panel = rules_figure(constraints(rule), values).axes
    assert (panel.get_xlabel(), panel.get_ylabel()) == ('speed [m/s]', 'smallest d [m]')
    assert panel.get_title(loc='left').endswith('drawn where mode at least 2')
    assert density(panel) == np.count_nonzero(values[:, MODE] == 2)


def test_a_mode_has_a_cell_for_each_value(values):
    rule = Rule('R1', (FAST, Literal(MODE, '>=', 1.0), Literal(MODE, '<=', 1.0)))
    _, panel = rules_figure(constraints(rule), values).axes
    assert [label.get_text() for label in panel.get_yticklabels()] == ['0', '1', '2']
    assert corners(panel)[0][2:] == (0.5, 1.5)
    assert words(panel) == ['> 0.8', '>= 1', '<= 1']


def test_steps_of_a_staircase_show_each_other(values):
    other = Rule('R2', (Literal(SPEED, '>', 0.9), Literal(NEAR, '<', 0.7)))
    _, *panels = rules_figure(constraints(('R1', (FAST, CLOSE)), other), values).axes
    for panel, (left, top) in zip(panels, [(0.9, 0.7), (0.8, 0.5)], strict=True):
        (dotted,) = (patch for patch in panel.patches if patch.get_linestyle() == ':')
        assert dotted.get_bbox().x0 == left
        assert dotted.get_bbox().y1 == top


@pytest.mark.parametrize('given', [True, False])
def test_legends_cover_nothing(values, given):
    drawn = constraints(('R1', (FAST, CLOSE)), ('R2', (CLOSE,)))
    figure = rules_figure(drawn, values if given else None)
    figure.canvas.draw()
    legends = [legend for part in figure.subfigs for legend in part.legends]
    assert len(legends) == 2
    for legend in legends:
        box = legend.get_window_extent()
        for axis in figure.axes:
            assert not box.overlaps(axis.get_tightbbox())
        assert 0 <= box.x0 < box.x1 <= figure.bbox.width


def test_a_bound_far_from_all_is_at_the_edge(values):
    rule = Rule('R1', (Literal(SPEED, '<', 1e308), Literal(LOAD, '>', 14.0)))
    _, panel = rules_figure(constraints(rule), values).axes
    assert panel.get_xlim()[1] < 2.0
    assert corners(panel)[0][:2] == panel.get_xlim()
    assert words(panel) == ['< 1e+308', '> 14']


def test_without_demonstrations_their_ranges_are_drawn():
    _, panel = rules_figure(constraints(('R1', (FAST, CLOSE)))).axes
    assert density(panel) == 0
    (ranges,) = (patch for patch in panel.patches if patch.get_linestyle() == '--')
    assert ranges.get_bbox().intervalx == pytest.approx([0.0, 1.0])
    assert ranges.get_bbox().intervaly == pytest.approx([0.1, 4.0])


def test_samples_that_cannot_be_judged_are_left_out(values):
    values[:100, LOAD] = np.nan
    _, panel = rules_figure(constraints(('R1', (FAST, CLOSE))), values).axes
    assert density(panel) == 400
    with pytest.raises(DataError, match='no sample of the demonstrations'):
        rules_figure(constraints(), values[:100])


def test_of_many_rules_those_with_the_most_evidence_are_drawn(values):
    rules = [Rule(f'R{n}', (Literal(SPEED, '>', 0.8 + n / 100), CLOSE)) for n in range(15)]
    items = [
        {
            'id': rule.id,
            'formula': rule.formula(SPACE),
            'flagged': 0,
            'expected': 0.1,
            'seen': 0.0,
            'evidence': float(number),
            'literals': [{'near': 0, 'episodes': 0, 'closest': []}] * 2,
        }
        for number, rule in enumerate(rules)
    ]
    figure = rules_figure(constraints(*rules, evidence={'near': 0.01, 'rules': items}), values)
    titles = [axis.get_title(loc='left').partition(':')[0] for axis in figure.axes[1:]]
    assert titles == [f'R{n}' for n in range(3, 15)]
    assert '12 of 15' in figure.subfigs[1].get_suptitle()


def test_the_file_is_a_png_that_fits_a_page(values, tmp_path):
    draw_rules(tmp_path / 'rules.png', constraints(('R1', (FAST, CLOSE))), values)
    assert imread(tmp_path / 'rules.png').shape[1] == 880
    assert not plt.get_fignums()
