# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Pages in a real browser: what they judge, list and draw, and what they do not execute."""

from dataclasses import replace

import numpy as np
import pytest
from judged_drives import drives
from occ_constraints_pkg.checking.timeline import check_data
from occ_constraints_pkg.report.arrays import packed
from occ_constraints_pkg.report.page import Page, facts_section, table_section
from occ_constraints_pkg.report.recordings import add_recordings, summarize
from occ_constraints_pkg.report.rules import add_rules
from occ_constraints_pkg.report.subjects import Subjects, rules_data
from occ_constraints_pkg.rules import Feature, FeatureSpace, Literal, Rule, RuleSet
from occ_constraints_pkg.rules.constraints_file import Constraints
from occ_constraints_pkg.rules.rule import OPERATORS

HOSTILE = '</script><script>alert(1)</script><img src=x onerror=alert(2)>"\'&{{ 7 * 7 }}'
JUDGE = """([rules, packed]) => {
  const rows = {count: packed.count, known: unpack(packed.known, Uint8Array),
    columns: packed.columns.map(column => unpack(column, Float64Array))};
  const {verdict, first} = judge(rules, rows);
  return [Array.from(verdict), Array.from(first)];
}"""


def page_of(rule_set, timeline, *, title='Drives', **options):
    page = Page(title)
    summarize(page, timeline)
    add_recordings(page, timeline, rule_set, **options)
    add_rules(page, Constraints(rule_set), is_judged=True)
    return page


def random_rules(rng, space):
    """Return rules whose bounds often coincide with values, strict and not, of families too."""
    subjects = [*range(len(space)), *space.families]
    rules = []
    for number in range(rng.integers(0, 9)):
        literals = tuple(
            Literal(
                subjects[rng.integers(len(subjects))],
                OPERATORS[rng.integers(4)],
                float(rng.integers(-8, 9) / 4 + rng.choice([0.0, 0.1])),
            )
            for _ in range(rng.integers(1, 5))
        )
        rules.append(Rule(f'R{number}', literals, bool(rng.random() < 0.8)))
    rules = tuple(rule for rule in rules if not rule.is_contradictory)
    return RuleSet(space, rules, np.tile([-2.0, 2.0], (len(space), 1)))


def random_rows(rng, count, width):
    rows = rng.integers(-9, 10, (count, width)) / 4
    rows += rng.choice([0.0, 0.1, 1e-16], rows.shape)
    odd = rng.random(rows.shape) < 0.01
    rows[odd] = rng.choice([np.nan, np.inf, -np.inf, -0.0, 5e-324, 1e308], odd.sum())
    return rows


def test_the_page_judges_as_the_package_does(open_page):
    tab, rng = open_page(Page('Empty')), np.random.default_rng(0)
    space = FeatureSpace(
        (
            Feature('x', low=-2.0),
            Feature('mode'),
            Feature('d_0', family='d', high=2.25),
            Feature('d_1', family='d', high=2.25),
        )
    )
    points = 0
    seen = set()
    for _ in range(25):
        rule_set = random_rules(rng, space)
        rows = random_rows(rng, 4000, len(space))
        subjects = Subjects(rule_set)
        document = {
            'count': len(rows),
            'known': packed(subjects.knows(rows), np.uint8),
            'columns': [packed(values, np.float64) for values in subjects.values(rows)],
        }
        verdict, rule = tab.evaluate(JUDGE, [rules_data(rule_set, subjects), document])
        points += len(rows)
        if rule_set.problem:
            assert set(verdict) == {2}
            continue
        judged = rule_set.judge(rows)
        np.testing.assert_array_equal(verdict, judged.verdict)
        np.testing.assert_array_equal(rule, judged.rule)
        seen |= set(verdict)
    assert points == 100_000
    assert seen == {0, 1, 2}


def test_every_violation_is_listed_and_shown_against_its_bound(open_page, rule_set):
    timeline = drives(rule_set)
    tab = open_page(page_of(rule_set, timeline))
    assert tab.locator('.recording').count() == 2
    for summary in tab.locator('.recording').all()[1:]:
        summary.locator('details > summary').first.click()
        summary.locator('[data-violation]').first.wait_for()
    listed = tab.locator('[data-violation]').count()
    assert listed == len(timeline.violations) > 10
    last = tab.locator('[data-recording="1"] [data-violation] button').last
    last.focus()
    tab.keyboard.press('Enter')
    detail = tab.locator('[data-detail="1"]')
    chart = detail.locator('svg.chart').first
    assert 'violated when' in chart.get_attribute('aria-label')
    assert chart.locator('.limit').count() >= 1
    assert chart.locator('.worst').count() == 1
    assert chart.locator('.trace').get_attribute('points').count(',') > 10
    tab.get_by_role('button', name='previous').last.click()
    number = len([item for item in timeline.violations if item.source == 1])
    assert f'Violation {number - 1} of {number}' in detail.inner_text()


def test_the_episode_is_told_even_if_only_one_violates(open_page, rule_set):
    data = drives(rule_set).data
    values = data.values.copy()
    values[data.episodes == 0] = [0.5, 2.0, 2.2]
    one = replace(
        data, values=values, recordings=np.zeros_like(data.episodes), sources=data.sources[:1]
    )
    timeline = check_data(one, rule_set)
    assert {item.episode for item in timeline.violations} == {1}
    tab = open_page(page_of(rule_set, timeline))
    tab.locator('[data-violation]').first.wait_for()
    assert 'episode' in tab.locator('[data-list="0"] th').all_inner_texts()
    assert tab.locator('[data-violation] td').nth(3).inner_text() == '1'


def tried(rule_set, place, literal, bound):
    """Return the rule set with another bound."""
    rule = rule_set.rules[place]
    literals = list(rule.literals)
    literals[literal] = replace(literals[literal], bound=bound)
    rules = list(rule_set.rules)
    rules[place] = replace(rule, literals=tuple(literals))
    return replace(rule_set, rules=tuple(rules))


def violations_of(tab, place):
    return int(tab.locator(f'[data-count="{place}"]').inner_text())


@pytest.mark.parametrize('bound', [1.02, 1.5, 0.9])
def test_what_if_counts_violations_as_a_new_check_would(open_page, rule_set, bound):
    tab = open_page(page_of(rule_set, drives(rule_set)))
    tab.locator('[data-bound="0"]').fill(str(bound))
    again = drives(tried(rule_set, 0, 0, bound))
    assert violations_of(tab, 0) == sum(item.rule == 0 for item in again.violations)
    answer = tab.locator('#answer')
    assert answer.is_visible()
    tab.locator('#reset').click()
    assert not answer.is_visible()
    assert float(tab.locator('[data-bound="0"]').input_value()) == 1.0
    before = drives(rule_set)
    assert violations_of(tab, 0) == sum(item.rule == 0 for item in before.violations)


def test_rules_can_be_disabled_and_enabled(open_page, rule_set):
    timeline = drives(rule_set)
    tab = open_page(page_of(rule_set, timeline))
    tab.get_by_label('rule fast enabled').uncheck()
    own = sum(item.rule == 0 for item in timeline.violations)
    assert f'{own} gone, 0 new' in tab.locator('#answer').inner_text()
    for name in ('near', 'fast-near'):
        tab.get_by_label(f'rule {name} enabled', exact=True).uncheck()
    assert 'every verdict would be UNKNOWN' in tab.locator('#answer').inner_text()
    # A rule that the file disables can be tried, too.
    tab.locator('[data-enable="3"]').check()
    tab.locator('[data-bound="3"]').fill('0.1')
    assert violations_of(tab, 3) > 0


def test_nothing_that_a_file_brings_is_executed(open_page):
    space = FeatureSpace((Feature(HOSTILE, HOSTILE), Feature('y')))
    rules = (
        Rule(HOSTILE, (Literal(0, '>', 0.9), Literal(1, '>', 0.0)), note=HOSTILE),
        Rule('R2', (Literal(1, '<', -1.0),), note=HOSTILE, enabled=False),
    )
    rule_set = RuleSet(space, rules, np.array([[0.0, 1.0], [0.3, 4.0]]))
    other = RuleSet(
        FeatureSpace((Feature('speed'), Feature('d_0', family='d'), Feature('d_1', family='d'))),
        (),
        np.array([[0.0, 1.0]] * 3),
    )
    data = drives(other).data
    data = replace(
        data,
        names=space.names,
        values=data.values[:, :2],
        sources=({'name': HOSTILE, 'sha256': HOSTILE}, {'name': HOSTILE, 'sha256': ''}),
    )
    page = page_of(rule_set, check_data(data, rule_set), title=HOSTILE)
    page.add(table_section(HOSTILE, [HOSTILE], [[HOSTILE]], id='table', intro=HOSTILE))
    page.add(facts_section(HOSTILE, {HOSTILE: {HOSTILE: [HOSTILE]}}, id='facts'))
    tab = open_page(page)
    for place in range(2):
        tab.evaluate(f'document.querySelector(\'[data-jumps="{place}"]\').open = true')
    assert tab.title() == HOSTILE
    tab.wait_for_selector('[data-violation]')
    # The programs of the page and its data, and no more; and no picture but ours.
    assert tab.locator('script').count() == 4
    assert tab.locator('img:not([src^="data:image/png"])').count() == 0
    assert HOSTILE in tab.locator('h1').inner_text()
    assert '49' not in tab.locator('h1').inner_text()


@pytest.mark.parametrize('scheme', ['light', 'dark'])
def test_narrow_and_dark(open_page, rule_set, scheme):
    size = {'width': 600, 'height': 800}
    tab = open_page(page_of(rule_set, drives(rule_set)), viewport=size, color_scheme=scheme)
    assert tab.evaluate('document.documentElement.scrollWidth') <= 600
    contrast = tab.evaluate(
        """() => {
          const light = color => {
            const [r, g, b] = color.match(/[\\d.]+/g).slice(0, 3).map(Number).map(v => v / 255)
              .map(v => v <= 0.03928 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4);
            return 0.2126 * r + 0.7152 * g + 0.0722 * b;
          };
          const paper = light(getComputedStyle(document.body).backgroundColor);
          return ['body', 'a', '.hint', 'th'].map(name => {
            const ink = light(getComputedStyle(document.querySelector(name)).color);
            return (Math.max(ink, paper) + 0.05) / (Math.min(ink, paper) + 0.05);
          });
        }"""
    )
    # What WCAG asks of text.
    assert min(contrast) >= 4.5


def test_by_keyboard_and_for_screen_readers(open_page, rule_set):
    tab = open_page(page_of(rule_set, drives(rule_set)))
    tab.keyboard.press('Tab')
    assert tab.evaluate('document.activeElement.textContent') == 'Skip to the content'
    unnamed = tab.evaluate(
        """() => [...document.querySelectorAll('button, input, [role=img], [role=region]')]
          .filter(item => !item.getAttribute('aria-label') && !item.textContent.trim())
          .map(item => item.outerHTML)"""
    )
    assert unnamed == []
    # A verdict is told by more than its colour.
    hatched = tab.locator('.band rect[fill="url(#hatch)"]').count()
    assert hatched == tab.locator('.band rect.violated').count() > 0


def test_a_thinned_page_lists_every_violation_and_says_that_it_is_thinned(open_page, rule_set):
    timeline = drives(rule_set, recordings=2, samples=20_000)
    page = page_of(rule_set, timeline, most_bytes=100_000)
    assert len(page.html()) < 600_000
    tab = open_page(page)
    assert 'of 40000 samples' in tab.locator('.hint').first.inner_text()
    listed = 0
    for place in range(2):
        tab.evaluate(f'document.querySelector(\'[data-jumps="{place}"]\').open = true')
        own = tab.locator(f'[data-list="{place}"]')
        own.locator('[data-violation]').first.wait_for()
        more = own.get_by_role('button', name='Show', exact=False).last
        while more.is_visible() and 'more' in more.inner_text():
            more.click()
        listed += own.locator('[data-violation]').count()
    assert listed == len(timeline.violations) > 500
    # Each has its worst moment in the rows.
    found = tab.evaluate(
        """() => {
          const data = JSON.parse(document.getElementById('data').textContent);
          return data.recordings.every(recording => {
            const times = new Set(unpackRows(recording.rows).times);
            return recording.violations.every(item => times.has(item[2]) && times.has(item[4]));
          });
        }"""
    )
    assert found
