# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The screen, driven by keys: choice, questions, size, and an end on every way."""

import asyncio

import pytest

pytest.importorskip('textual', reason="needs the extra 'report'")

import time

import numpy as np
from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.rules.listing import rules_in_force_text
from occ_constraints_pkg.stopping import stop_request
from occ_constraints_pkg.watch.view import WatchApp


class Source:
    """Stands for the network: keeps robots fresh and notes what is asked of it."""

    def __init__(self, fleet, report, rule_set):
        self.fleet, self.report, self.rule_set = fleet, report, rule_set
        self.calls = self
        self.asked, self.under_way = [], []
        self.found, self.fails = ['/robot1/tree_learner'], None
        for topic in ('/robot1/violation', '/robot2/violation'):
            robot = fleet.robot(topic, time.monotonic())
            robot.monitor = topic.replace('violation', 'monitor')
            robot.hear_rules(rules_in_force_text(rule_set), time.monotonic())

    def poll(self):
        if self.fails:
            raise self.fails
        now = time.monotonic()
        for robot in self.fleet.robots.values():
            robot.hear(self.report(0.1), now)
            robot.hear_features(np.array([[0.9, 1.0]]), self.rule_set.fingerprint, now)
        self.fleet.tick(now)

    def learners(self, _robot):
        return self.found

    def forget_lost(self):
        self.asked.append(('forget_lost',))

    def __getattr__(self, name):
        return lambda *arguments: self.asked.append((name, *arguments))


@pytest.fixture
def source(fleet, report, rule_set):
    return Source(fleet, report, rule_set)


@pytest.fixture
def drive(fleet, source):
    """Return a function that presses keys one by one and returns the screen's lines after it."""

    def run(*keys, size=(100, 30), resize=None):
        async def session():
            app = WatchApp(fleet, source)
            async with app.run_test(size=size) as pilot:
                await pilot.pause()
                for key in keys:
                    await pilot.press(key)
                if resize:
                    await pilot.resize_terminal(*resize)
                await pilot.pause(0.3)
                shown = [
                    ''.join(segment.text for segment in strip)
                    for strip in app.screen._compositor.render_strips()
                ]
                return app, shown

        return asyncio.run(session())

    return run


def test_robots_rules_events_and_keys_are_shown(drive):
    _, lines = drive(size=(80, 24))
    assert 'c clear' in lines[-1]
    text = '\n'.join(lines)
    for words in (
        '> /robot1 SAFE',
        '  /robot2 SAFE',
        'rules of /robot1',
        'FAST   0.100  speed 0.9',
        'speed above 1 m/s',
        'events',
        '2 rules of 3 in force',
        'Space switch',
    ):
        assert words in text


def test_another_robot_is_chosen(drive):
    assert '> /robot2' in '\n'.join(drive('tab')[1])
    assert '> /robot1' in '\n'.join(drive('tab', 'tab')[1])
    assert 'rules of /robot2' in '\n'.join(drive('left')[1])


QUESTIONS = {
    ('down', 'space'): ('enable_rule', '/robot1/monitor', 'FAST', False),
    ('down', 'down', 'down', 'up', 'space'): ('enable_rule', '/robot1/monitor', 'NEAR', False),
    ('down', 'down', 'down', 'space'): ('enable_rule', '/robot1/monitor', 'OFF', True),
    ('p',): ('prune', '/robot1/monitor'),
    ('r',): ('reset_stats', '/robot1/monitor'),
    ('e',): ('enable', '/robot1/monitor', True),
    ('d',): ('enable', '/robot1/monitor', False),
    ('l',): ('learn', '/robot1/tree_learner'),
}


@pytest.mark.parametrize('keys', list(QUESTIONS), ids=' '.join)
def test_nothing_is_changed_without_a_yes(drive, source, keys):
    _, lines = drive(*keys)
    assert '(y/n)' in lines[-1]
    assert source.asked == []
    # Any other key than y is a no; it does nothing else.
    drive(*keys, 'p')
    assert source.asked == []
    _, lines = drive(*keys, 'y')
    assert source.asked == [QUESTIONS[keys]]
    assert 'quit' in lines[-1]


def test_what_cannot_be_done_is_said(drive, source, fleet):
    assert 'no rule is chosen' in '\n'.join(drive('space')[1])
    source.found = []
    assert 'learn: found none' in '\n'.join(drive('l')[1])
    fleet.robots['/robot1/violation'].monitor = ''
    assert 'no monitor is known' in '\n'.join(drive('p')[1])
    assert source.asked == []


def test_without_robots_it_says_what_to_do(drive, source, fleet):
    fleet.robots.clear()
    text = '\n'.join(drive('down', 'space', 'tab', 'p', 'l', 'c')[1])
    assert 'no monitor is heard' in text
    assert source.asked == [('forget_lost',)]


def test_calls_under_way_are_shown(drive, source):
    source.under_way = ['/robot1/monitor: prune rules']
    assert '/robot1/monitor: prune rules ...' in drive()[1][-1]


@pytest.mark.parametrize('size', [(20, 6), (40, 12), (80, 24), (200, 60)])
def test_it_fits_a_terminal_of_any_size_also_when_that_changes(drive, size):
    for lines in (drive(size=size)[1], drive(size=(90, 30), resize=size)[1]):
        assert len(lines) == size[1]
        assert {len(line) for line in lines} == {size[0]}


@pytest.mark.parametrize('key', ['q', 'ctrl+c', 'ctrl+q'])
def test_it_ends_on_a_key_also_while_a_question_is_open(drive, key):
    assert drive(key)[0].return_code == 0
    assert drive('p', key)[0].return_code == 0


def test_it_ends_on_a_signal_and_on_an_error(drive, source, monkeypatch):
    monkeypatch.setattr(stop_request, 'made', True)
    assert drive()[0].error is None
    monkeypatch.setattr(stop_request, 'made', False)
    source.fails = OccError('ROS has gone')
    assert str(drive()[0].error) == 'ROS has gone'
