# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The pages of a comparison and of a triage: what they show, and that nothing in them runs."""

import re

import numpy as np
import pytest
from occ_constraints_pkg.checking.comparison import Side, compare_sides
from occ_constraints_pkg.checking.timeline import check_data
from occ_constraints_pkg.checking.triage import Unit, triage
from occ_constraints_pkg.checking.triage_text import Way, key_of
from occ_constraints_pkg.checking.unchanged import unchanged_for
from occ_constraints_pkg.datasets.dataset import ORIGIN, Dataset
from occ_constraints_pkg.learning.conditional import ConditionalSettings
from occ_constraints_pkg.rules import Feature, FeatureSpace, Literal, Rule, RuleSet

pytest.importorskip('jinja2', reason="needs the extra 'report'")
pytest.importorskip('matplotlib', reason="needs the extra 'report'")

from occ_constraints_pkg.report.comparison import comparison_page, write_comparison_page
from occ_constraints_pkg.report.triage import triage_page

EVIL = '<script>alert("x")</script>'
SPACE = FeatureSpace((Feature(f'speed{EVIL}', 'm/s'), Feature('range', 'm')))
RULES = RuleSet(
    SPACE,
    (Rule(f'FAST{EVIL}', (Literal(0, '>', 2.0),)), Rule('NEAR', (Literal(1, '<', 0.5),))),
    np.array([[0.0, 4.0], [0.0, 2.0]]),
)


def dataset(values, name='d'):
    count = len(values)
    ns = np.arange(count) * 200_000_000
    origins = np.zeros(count, dtype=ORIGIN)
    origins['time_ns'] = ns + 10**18
    numbers = np.zeros(count, dtype=np.int64)
    return Dataset(
        SPACE.names, np.array(values, dtype=float), ns, numbers, times_ns=ns, origins=origins,
        recordings=numbers, sources=({'name': name},),
    )  # fmt: skip


def side(values, name):
    data = dataset(values)
    return Side(name, check_data(data, RULES), RULES, (name,))


NARROW = {'viewport': {'width': 600, 'height': 900}, 'color_scheme': 'dark'}


def look(tab):
    """Return the width of a page's content, and its text."""
    return tab.evaluate('document.documentElement.scrollWidth'), tab.inner_text('main')


def test_the_page_of_a_comparison(tmp_path):
    before = side([(1.0, 1.0)] * 20, 'before')
    after = side([(1.0, 1.0)] * 10 + [(3.0, 1.0)] * 8 + [(np.nan, 1.0)] * 2, f'after{EVIL}')
    result = compare_sides(before, after, [(0, 0), (1, 1)], tolerance=0.1)
    write_comparison_page(tmp_path / 'page.html', f'title{EVIL}', result)
    html = (tmp_path / 'page.html').read_text()
    assert EVIL not in html
    assert 'worse in 1 of 1 recording' in html
    assert '▲ new' in html
    assert '<strong>UNKNOWN</strong>: 0.00 -&gt; 0.40 s' in html
    # Both lanes, on one clock: 10 of 20 samples SAFE after.
    bands = re.findall(r'<svg class="band".*?</svg>', html, re.DOTALL)
    cells = [re.findall(r'width="(\d+)" height="30" class="(\w+)"', band) for band in bands]
    assert [name for _, name in cells[0]] == ['safe']
    assert [name for _, name in cells[1]] == ['safe', 'violated', 'unknown']
    assert [int(count) for count, _ in cells[1]] == pytest.approx([500, 400, 100], abs=2)


def test_the_page_of_a_comparison_with_itself_is_good():
    same = side([(3.0, 1.0)] * 5, 'one')
    page = comparison_page('same', compare_sides(same, same, [(0, 0), (1, 1)]))
    assert page.is_good
    assert [section.id for section in page.sections] == ['all', 'settings']


def test_a_browser_shows_a_comparison(open_page):
    before, after = side([(1.0, 1.0)] * 20, 'one'), side([(3.0, 0.1)] * 20, 'other')
    page = comparison_page('title', compare_sides(before, after, [(0, 0), (1, 1)]))
    width, text = look(open_page(page, **NARROW))
    assert width == 600
    assert f'FAST{EVIL}' in text


def triaged():
    """Return a triage, its first recording, and its page."""
    rng = np.random.default_rng(0)
    units = []
    for number in range(12):
        values = rng.uniform([0.0, 1.0], [1.0, 2.0], (40, 2))
        if number == 7:
            values[20] = [9.0, 1.5]
            values[25] = np.nan
        data = dataset(values)
        unit = Unit(f'{EVIL}{number}', f'path{number}', data, unchanged_for(data, SPACE),
                    np.empty((40, 0)))  # fmt: skip
        units.append(unit)
    result = triage(
        units, SPACE, ConditionalSettings('none'), unreadable=[('bad', 'p', EVIL)],
        rng=np.random.default_rng(0),
    )  # fmt: skip
    first = result.ranked[0]
    link = 'https://app.foxglove.dev/~/view?ds=remote-file&ds.url=a'
    return first, triage_page('triage', result, {key_of(first): Way('clips/a.mcap', link)})


def test_the_page_of_a_triage():
    first, page = triaged()
    assert first.name.endswith('7')
    html = page.html()
    assert EVIL not in html
    assert page.is_good is False
    assert 'href="https://app.foxglove.dev/~/view?ds=remote-file&amp;ds.url=a"' in html
    assert 'clips/a.mcap' in html
    assert 'Cannot be used' in html
    (chart,) = re.findall(r'<svg class="chart".*?</svg>', html, re.DOTALL)
    # The sample that is missing breaks the line.
    traces = re.findall(r'<polyline class="trace" points="([^"]*)"', chart)
    assert [len(points.split()) for points in traces] == [25, 14]
    points = [tuple(map(float, pair.split(','))) for trace in traces for pair in trace.split()]
    limit = float(re.search(r'class="limit".*?y1="([\d.]+)"', chart)[1])
    assert sum(y < limit for _, y in points) == 1


def test_a_browser_shows_a_triage(open_page):
    first, page = triaged()
    width, text = look(open_page(page, **NARROW))
    assert width == 600
    assert f'1. {first.name}' in text
