# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""``occ events`` reads stores, and says in one sentence what it cannot."""

import csv
import io
import json
import time
from contextlib import closing

import pytest
from occ_constraints_pkg.cli import main
from occ_constraints_pkg.events.event import Event, new_id
from occ_constraints_pkg.events.store import EventStore

HOUR = 3600 * 10**9


def event(hours_ago, **more):
    began = time.time_ns() - round(hours_ago * HOUR)
    fields = {
        'id': new_id(began),
        'kind': 'violation',
        'robot': '/robot1',
        'text': 'clearance below 0.35 m',
        'began': began,
        'worst': began,
        'ended': began + 12_400_000_000,
        'rule': 'R1',
        'values': {'clearance': 0.3},
        'bounds': ({'feature': 'clearance', 'operator': '<', 'bound': 0.35},),
        'margin': -0.08,
    }
    return Event(**{**fields, **more})


@pytest.fixture
def store(tmp_path, monkeypatch):
    monkeypatch.setenv('ROS_HOME', str(tmp_path / 'ros'))
    one = event(5)
    with closing(EventStore(tmp_path / 'ros' / 'occ_events' / 'robot1')) as store:
        stop = event(4, kind='stop', cause=one.id, text='stopped 02:14:07: \x1b[2Jclearance')
        store.keep([one, stop, event(1, rule='R2', text='=1+1', ended=None)], now=0)
    return store.path


def occ(capsys, *arguments):
    code = main(['events', *map(str, arguments)])
    out, err = capsys.readouterr()
    return code, out, err


def test_what_the_default_directory_holds_is_listed(store, capsys):
    code, out, _ = occ(capsys, 'list')
    assert code == 0
    head, first, stop, last = out.splitlines()
    assert head.split() == ['N', 'began', 'lasted', 'kind', 'robot', 'margin', 'what']
    assert first.split()[3:6] == ['12.4', 's', 'violation']
    assert first.endswith('/robot1  -0.08   R1: clearance below 0.35 m')
    # What comes from outside cannot take over the terminal.
    assert '\\x1b[2J' in stop
    assert ' s so far ' in last


@pytest.mark.parametrize(
    ('options', 'numbers'),
    [
        (['--since', '4.5h'], [2, 3]),
        (['--since', '4.5h', '--until', '2h'], [2]),
        (['--rule', 'R2'], [3]),
        (['--kind', 'stop'], [2]),
        (['--robot', 'robot1', '--newest', '1'], [3]),
        (['--robot', '/robot2'], []),
        (['--since', '2020-01-01'], [1, 2, 3]),
        (['--until', '2020-01-01 02:14'], []),
    ],
)
def test_filters(store, capsys, options, numbers):
    code, out, _ = occ(capsys, 'list', '--json', *options)
    assert code == 0
    [part] = json.loads(out)
    assert part['store'] == str(store)
    assert [item['number'] for item in part['events']] == numbers


def test_one_event_is_shown_with_its_cause_and_its_bag(store, capsys, tmp_path):
    code, out, _ = occ(capsys, 'show', 2)
    assert code == 0
    assert 'event 2: stop of /robot1' in out
    assert 'is event 1' in out
    assert 'bounds    clearance < 0.35' in out
    assert '(12.4 s)' in out
    assert 'bag       none' in out
    with closing(EventStore(store.parent)) as opened:
        ids = [item.event.id for item in opened.events()]
        opened.name_bag(ids[:1], str(tmp_path))
        opened.name_bag(ids[1:2], str(tmp_path / 'gone'))
    _, out, _ = occ(capsys, 'show', ids[0])
    assert f'occ check {tmp_path} -c CONSTRAINTS' in out
    _, out, _ = occ(capsys, 'show', 2)
    assert 'gone (is not there any more)' in out
    _, out, _ = occ(capsys, 'show', 1, '--json')
    assert json.loads(out)['values'] == {'clearance': 0.3}


def test_export_as_json_and_csv(store, capsys, tmp_path):
    _, out, _ = occ(capsys, 'export')
    assert [item['number'] for item in json.loads(out)['events']] == [1, 2, 3]
    target = tmp_path / 'week.csv'
    code, out, err = occ(capsys, 'export', '-o', target)
    assert (code, out, err) == (0, '', f'3 events written to {target}\n')
    rows = list(csv.DictReader(io.StringIO(target.read_text())))
    assert [row['number'] for row in rows] == ['1', '2', '3']
    assert (rows[0]['margin'], rows[0]['seconds']) == ('-0.08', '12.4')
    # No spreadsheet takes it for a formula.
    assert rows[2]['text'] == "'=1+1"
    # Once more is fine, over a file of somebody else is not.
    assert occ(capsys, 'export', '-o', target)[0] == 0
    target.write_text('my own list')
    code, _, err = occ(capsys, 'export', '-o', target)
    assert (code, target.read_text()) == (2, 'my own list')
    assert 'cannot write' in err


def test_pinning(store, capsys):
    assert occ(capsys, 'pin', 1) == (0, '', 'event 1 is pinned\n')
    assert '\n1*' in occ(capsys, 'list')[1]
    assert occ(capsys, 'pin', 1, '--off') == (0, '', 'event 1 is no longer pinned\n')


def test_a_number_that_several_stores_have_needs_the_store(store, capsys):
    with closing(EventStore(store.parent.parent / 'robot2')) as other:
        other.keep([event(1, robot='/robot2')], now=0)
    code, _, err = occ(capsys, 'show', 1)
    assert code == 2
    assert 'name one with --store' in err
    assert occ(capsys, 'show', 1, '--store', other.path)[0] == 0
    _, out, _ = occ(capsys, 'list')
    assert f'{store}:' in out
    assert f'{other.path}:' in out


@pytest.mark.parametrize(
    ('arguments', 'sentence'),
    [
        (['show', '9'], "there is no event '9'; allowed is a number that occ events list prints"),
        (['list', '--since', 'monday'], 'allowed are 2026-12-01'),
        (['list', '--since', '9999999d'], 'allowed are 2026-12-01'),
        (['list', '--store', 'nowhere'], 'there is no event store nowhere'),
        (['export', '-o', 'week.pdf'], 'allowed is a name that ends in .json or .csv'),
    ],
)
def test_mistakes_are_one_sentence(store, capsys, arguments, sentence):
    code, _, err = occ(capsys, *arguments)
    assert code == 2
    assert sentence in err
    assert 'Traceback' not in err


def test_without_any_store_it_says_where_it_looked(tmp_path, monkeypatch, capsys):
    monkeypatch.setenv('ROS_HOME', str(tmp_path))
    code, _, err = occ(capsys, 'list')
    assert code == 2
    assert f'there is no event store in {tmp_path}/occ_events' in err


def test_a_damaged_store_is_a_sentence(store, capsys):
    store.write_bytes(b'SQLite format 3\0' + bytes(5000))
    code, _, err = occ(capsys, 'list')
    assert code == 2
    assert 'cannot read the event store' in err
    store.write_bytes(b'')
    assert occ(capsys, 'list')[0] == 2
