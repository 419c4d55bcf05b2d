# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The page in a real browser: what it shows, and what it never does."""

import json
import math
import time

import pytest
from occ_constraints_pkg.fleet.events import read_event
from occ_constraints_pkg.fleet.margins import BUCKET_SECONDS, BUCKETS
from sites import report_of

TOKEN = 'a-token-of-this-test'
HOSTILE = '</script><script>alert(1)</script><img src=x onerror=alert(2)>"\'&'
PATIENCE_MS = 20_000


@pytest.fixture
def visit(browser):
    """Return a function that opens the page; what the browser complains of fails the test."""
    contexts, said = [], []

    def open_one(address, *, expected=(), **options):
        context = browser.new_context(**options)
        context.set_default_timeout(PATIENCE_MS)
        contexts.append(context)
        tab = context.new_page()

        def note(text):
            if not any(words in text for words in expected):
                said.append(text)

        tab.on('console', lambda message: note(message.text))
        tab.on('pageerror', lambda error: note(str(error)))
        tab.on('dialog', lambda dialog: (note(dialog.message), dialog.dismiss()))
        tab.on('request', lambda request: check_is_ours(request.url, address, said))
        tab.goto(address)
        return tab

    yield open_one
    for context in contexts:
        context.close()
    assert said == []


def check_is_ours(url, address, said):
    if not url.startswith((address.partition('#')[0], 'data:')):
        said.append(url)


def card(tab, name):
    """Return what the page shows of a robot in its list."""
    return tab.locator('.robot', has=tab.get_by_text(name, exact=True))


def state_of(tab, name):
    return card(tab, name).locator('.state').first


def wait_for_state(tab, name, word):
    state_of(tab, name).and_(tab.locator(f'.{word}')).wait_for()


def test_a_violation_appears_within_a_second_and_a_lost_robot_is_grey(site, visit):
    site.robot('/a')
    site.robot('/b')
    site.heard.update({'/a': 0.5, '/b': 0.5})
    tab = visit(site.address)
    wait_for_state(tab, '/a', 'SAFE')
    begin = time.monotonic()
    site.heard['/a'] = -0.25
    wait_for_state(tab, '/a', 'VIOLATED')
    assert time.monotonic() - begin < 1.0
    assert 'FAST: speed above 1 m/s' in card(tab, '/a').inner_text()
    assert state_of(tab, '/b').inner_text() == '✓ SAFE'
    site.heard['/b'] = 'no new input for 1.2 s'
    wait_for_state(tab, '/b', 'UNKNOWN')
    assert 'no new input' in card(tab, '/b').inner_text()
    assert card(tab, '/b').locator('.number').inner_text() == '–'
    del site.heard['/b']
    wait_for_state(tab, '/b', 'LOST')
    assert 'not heard from' in card(tab, '/b').inner_text()
    grey = card(tab, '/b').evaluate('card => getComputedStyle(card).filter')
    assert grey == 'grayscale(1)'
    assert '2 of 2 robots' in tab.title()


def test_a_page_without_its_server_shows_nobody_as_safe_and_is_whole_again_at_once(
    make_site, visit
):
    site = make_site()
    site.robot('/a')
    site.heard['/a'] = 0.5
    tab = visit(site.address, expected=['ERR_CONNECTION_REFUSED', 'ERR_INCOMPLETE_CHUNKED'])
    wait_for_state(tab, '/a', 'SAFE')
    port = site.server.port
    site.close()
    wait_for_state(tab, '/a', 'LOST')
    assert 'no connection' in tab.locator('#link').inner_text()
    assert tab.locator('.state.SAFE, .state.PASS').count() == 0
    again = make_site(port)
    again.robot('/a')
    again.heard['/a'] = -0.5
    wait_for_state(tab, '/a', 'VIOLATED')
    tab.locator('#rules tr.violated').wait_for()
    assert tab.locator('#link').inner_text() == 'live'


def test_twenty_robots_are_listed_ordered_and_reached_by_keys(site, visit):
    names = [f'/robot{number:02d}' for number in range(20)]
    for number, name in enumerate(names):
        site.robot(name)
        site.heard[name] = -0.5 if number == 13 else 0.2 + number / 100
    tab = visit(site.address)
    wait_for_state(tab, names[13], 'VIOLATED')
    assert tab.locator('.robot .called').all_inner_texts() == names
    assert tab.locator('#counts .state').all_inner_texts() == ['▲ 1 VIOLATED', '✓ 19 SAFE']
    tab.locator('.robot').first.focus()
    for _ in range(3):
        tab.keyboard.press('ArrowDown')
    assert tab.locator('#name').inner_text() == names[3]
    assert tab.locator('.robot[aria-current=true] .called').inner_text() == names[3]
    tab.keyboard.press('End')
    assert tab.locator('#name').inner_text() == names[19]
    tab.locator('#order').select_option('worst')
    first = tab.locator('.robot .called').first
    assert first.inner_text() == names[13]
    tab.locator('#unsafe').check()
    assert tab.locator('.robot:visible').count() == 1
    tab.reload()
    tab.locator('.robot').nth(19).wait_for()
    assert tab.locator('#name').inner_text() == names[19]


def test_the_chosen_robot_is_shown_with_rules_gate_health_and_margins(site, visit):
    site.robot('/a')
    site.heard['/a'] = 0.125
    site.gate('/a', 'STOP', 'VIOLATED: speed above 1 m/s')
    tab = visit(site.address)
    wait_for_state(tab, '/a', 'SAFE')
    rows = tab.locator('#rules tr')
    rows.nth(2).wait_for()
    cells = rows.first.locator('th, td').all_inner_texts()
    assert cells[:4] == ['FAST', '0.125', 'speed above 1 m/s', 'speed 0.875']
    assert rows.last.locator('th').inner_text() == 'OFF'
    assert rows.last.locator('td').first.inner_text() == 'off'
    gates = tab.locator('#gates').inner_text()
    assert gates.startswith('■ STOP /a/gate: VIOLATED: speed above 1 m/s (since ')
    health = tab.locator('#health').inner_text()
    assert '/a/monitor' in health
    assert '20 ms' in health
    assert tab.locator('#chart svg').get_attribute('aria-label').startswith('margin over the last')
    assert tab.locator('#control').is_hidden()


def test_events_are_listed_with_their_recordings(site, visit):
    site.robot('/a')
    site.robot('/b')
    tab = visit(site.address)
    tab.get_by_text('No event_recorder is heard').wait_for()
    event = {
        **{'schema': 1, 'id': 'e' * 24, 'phase': 'began', 'kind': 'violation', 'robot': '/b'},
        **{'rule': 'FAST', 'text': 'speed above 1 m/s', 'values': {'speed': 1.25}, 'bounds': []},
        **{'margin': -0.25, 'began': time.time_ns(), 'worst': time.time_ns(), 'ended': None},
        **{'rule_set': 'x', 'reason': '', 'bag': None, 'cause': None, 'stamps': None},
    }

    def tell(**more):
        with site.lock:
            site.fleet.events.hear(read_event(json.dumps({**event, **more}), '/b/events'))

    tell()
    row = tab.locator('#event-rows tr')
    tab.get_by_text('going on').wait_for()
    assert '▲ violation: speed above 1 m/s; speed 1.25' in row.inner_text()
    tell(phase='ended', ended=event['began'] + 2_500_000_000, bag='/bags/one')
    tab.locator('#event-rows code').wait_for()
    assert row.count() == 1
    assert '2.5 s' in row.inner_text()
    assert tab.locator('#event-rows code').inner_text() == '/bags/one'
    tab.locator('#own').check()
    assert row.count() == 0
    card(tab, '/b').click()
    assert row.count() == 1


def test_nothing_that_robots_say_is_executed(site, visit):
    robot = site.robot('/a')
    site.heard['/a'] = HOSTILE
    robot.problem = robot.health.doubts = robot.monitor = HOSTILE
    site.gate('/a', HOSTILE, HOSTILE)
    said = dict.fromkeys(('kind', 'robot', 'rule', 'text', 'reason', 'bag', 'phase'), HOSTILE)
    said |= {'id': HOSTILE, 'values': {HOSTILE: HOSTILE}, 'began': time.time_ns(), 'margin': 'x'}
    with site.lock:
        site.fleet.events.hear(read_event(json.dumps(said), HOSTILE))
        site.fleet.note(time.monotonic(), HOSTILE, HOSTILE, HOSTILE)
        other = site.fleet.robot(f'{HOSTILE}/violation', time.monotonic())
        other.health.doubts = HOSTILE
    tab = visit(site.address)
    wait_for_state(tab, '/a', 'UNKNOWN')
    tab.locator('#event-rows code').wait_for()
    card(tab, '/a').click()
    assert HOSTILE in tab.locator('#standing').inner_text()
    assert HOSTILE in tab.locator('#changes').inner_text()
    assert HOSTILE in tab.locator('#health').inner_text()
    assert tab.locator('script').count() == 2
    assert tab.locator('img').count() == 0


def test_only_the_token_unlocks_what_changes_something(make_site, visit):
    site = make_site(token=TOKEN)
    site.robot('/a')
    site.heard['/a'] = 0.5
    tab = visit(site.address, expected=['status of 401'])
    wait_for_state(tab, '/a', 'SAFE')
    assert tab.locator('#buttons').is_hidden()
    tab.locator('#token').fill('wrong-wrong-wrong')
    tab.locator('#unlock button').click()
    tab.get_by_role('button', name='Prune rules').click()
    assert 'disable the rules that were rarely violated?' in tab.locator('#question').inner_text()
    tab.locator('#yes').click()
    tab.get_by_text('refused: the token is missing or wrong').wait_for()
    assert site.wishes == []
    assert tab.locator('#buttons').is_hidden()
    # As the node prints it; it does not stay in the address.
    tab = visit(f'{site.address}#token={TOKEN}')
    wait_for_state(tab, '/a', 'SAFE')
    assert TOKEN not in tab.url
    tab.get_by_role('button', name='disable rule FAST').click()
    tab.keyboard.press('Escape')
    tab.get_by_role('button', name='disable rule FAST').click()
    tab.locator('#yes').click()
    tab.get_by_text('asked …').wait_for()
    with site.lock:
        site.fleet.note(time.monotonic(), '/a/monitor', 'done', 'disable rule FAST: in force')
    tab.get_by_text('done: disable rule FAST: in force').wait_for()
    assert [(item.action, item.rule) for item in site.wishes] == [('disable_rule', 'FAST')]


@pytest.mark.parametrize('scheme', ['light', 'dark'])
def test_narrow_and_dark(site, visit, scheme):
    site.robot('/a-robot-with-quite-a-long-name/in_a_namespace')
    site.heard['/a-robot-with-quite-a-long-name/in_a_namespace'] = -0.25
    tab = visit(
        site.address,
        viewport={'width': 600, 'height': 800},
        color_scheme=scheme,
        reduced_motion='reduce',
    )
    tab.locator('#rules tr.violated').wait_for()
    assert tab.evaluate('document.documentElement.scrollWidth') <= 600
    # Contrast of the state's word to its ground, as WCAG counts it.
    ink, ground = tab.locator('.robot .state').first.evaluate(
        'node => [getComputedStyle(node).color, getComputedStyle(node).backgroundColor]'
    )
    assert contrast(ink, ground) >= 4.5


def contrast(*colours):
    lights = sorted(luminance(colour) for colour in colours)
    return (lights[1] + 0.05) / (lights[0] + 0.05)


def luminance(colour):
    parts = [int(part) / 255 for part in colour[4:-1].split(',')]
    linear = [
        part / 12.92 if part <= 0.04045 else ((part + 0.055) / 1.055) ** 2.4 for part in parts
    ]
    return sum(weight * part for weight, part in zip((0.2126, 0.7152, 0.0722), linear, strict=True))


@pytest.mark.slow
def test_a_page_that_is_left_open_does_not_grow(make_site, visit):
    # Ticks come ten times as fast as those of the node.
    site = make_site(seconds=0.02)
    names = [f'/robot{number:02d}' for number in range(20)]
    now = time.monotonic()
    for name in names:
        robot = site.robot(name)
        # All margins that are kept, and more changes than are kept.
        with site.lock:
            for span in range(BUCKETS):
                margin = math.sin(span / 3.0)
                robot.hear(report_of(margin), now - (BUCKETS - span) * BUCKET_SECONDS)
    tab = visit(site.address)
    tools = tab.context.new_cdp_session(tab)
    tools.send('Performance.enable')

    def drive(seconds):
        """Let all robots change for a while; return what the page takes up then."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            for number, name in enumerate(names):
                site.heard[name] = math.sin(2.0 * time.monotonic() + number)
            time.sleep(0.02)
        tools.send('HeapProfiler.collectGarbage')
        sizes = {
            item['name']: item['value'] for item in tools.send('Performance.getMetrics')['metrics']
        }
        return [sizes[name] for name in ('JSHeapUsedSize', 'Nodes', 'JSEventListeners')]

    before = drive(4.0)
    heap, nodes, listeners = (now / then for now, then in zip(drive(6.0), before, strict=True))
    assert heap < 1.15
    assert nodes < 1.25
    assert listeners < 1.25
