# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Plain lines: where they are used, how they look, and when they end."""

import io
import sys
import time

import pytest
from occ_constraints_pkg.errors import MissingDependencyError
from occ_constraints_pkg.fleet.model import Change
from occ_constraints_pkg.stopping import stop_request
from occ_constraints_pkg.watch.lines import document_of, follow, is_plain, line_of

ABLE = {'TERM': 'xterm-256color'}


class Terminal(io.StringIO):
    def __init__(self, encoding='utf-8', is_terminal=True):
        super().__init__()
        self._encoding, self._is_terminal = encoding, is_terminal

    @property
    def encoding(self):
        return self._encoding

    def isatty(self):
        return self._is_terminal


@pytest.mark.parametrize(
    ('environment', 'expected'),
    [
        (ABLE, False),
        ({**ABLE, 'NO_COLOR': ''}, False),
        ({**ABLE, 'NO_COLOR': '0'}, True),
        ({'TERM': 'dumb'}, True),
        ({}, True),
    ],
)
def test_a_screen_needs_a_terminal_that_can_draw(monkeypatch, environment, expected):
    monkeypatch.setattr(sys, 'stdin', Terminal())
    monkeypatch.setattr(sys, 'stdout', Terminal())
    assert is_plain(environment) is expected


@pytest.mark.parametrize(
    ('stdin', 'stdout'),
    [
        (Terminal(), Terminal(is_terminal=False)),
        (Terminal(is_terminal=False), Terminal()),
        (Terminal(), Terminal('ascii')),
    ],
)
def test_no_screen_where_it_would_not_be_seen(monkeypatch, stdin, stdout):
    monkeypatch.setattr(sys, 'stdin', stdin)
    monkeypatch.setattr(sys, 'stdout', stdout)
    assert is_plain(ABLE)


def test_a_line_is_plain_text_whatever_others_send():
    change = Change(0.0, '/robot1', 'VIOLATED', 'R1: \x1b[2Jx\nabove')
    line = line_of(change, time.mktime((2026, 5, 4, 13, 2, 1, 0, 0, -1)) + 0.259)
    assert line == '13:02:01.25  /robot1  VIOLATED: R1: \\x1b[2Jx\\nabove'
    assert document_of(change, 12.3456)['time'] == 12.346


def test_it_ends_when_it_is_asked_to(fleet, monkeypatch):
    monkeypatch.setattr(stop_request, 'made', False)
    heard = []

    def poll():
        fleet.note(time.monotonic(), 'x', 'note', str(len(heard)))

    def write(change, wall):
        assert abs(wall - time.time()) < 1.0
        heard.append(change.text)
        stop_request.made = len(heard) == 3

    follow(poll, fleet, write)
    assert heard == ['0', '1', '2']


def test_without_textual_there_are_lines_and_a_reason(monkeypatch, run_occ):
    app = pytest.importorskip('occ_constraints_pkg.watch.app', reason="needs the extra 'ros'")

    def no_screen():
        raise MissingDependencyError('the live view needs the module x')

    def run_lines(write):
        write(Change(0.0, '/', 'SAFE', 'margin 1'), 0.0)
        return 0

    monkeypatch.setattr(app, 'run_screen', no_screen)
    monkeypatch.setattr(app, 'run_lines', run_lines)
    monkeypatch.setattr('occ_constraints_pkg.watch.lines.is_plain', lambda _: False)
    code, out, err = run_occ('watch')
    assert code == 0
    assert out.endswith('SAFE: margin 1\n')
    assert err == 'warning: the live view needs the module x; here each change is a line\n'
    assert run_occ('watch --json')[1].startswith('{"time": 0.0, "source": "/"')
