# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The event store: kills, full disks, damage, its bound, and other programs beside it."""

import os
import sqlite3
import subprocess
import sys
from contextlib import closing
from dataclasses import replace

import pytest
from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.events.event import Event, new_id
from occ_constraints_pkg.events.journal import Journal
from occ_constraints_pkg.events.store import (
    EventReader,
    EventStore,
    Filter,
    StoreFullError,
    pin_event,
)

SECOND = 10**9


def event(seconds, *, ended=True, **more):
    began = round(seconds * SECOND)
    fields = {
        'id': new_id(began),
        'kind': 'violation',
        'robot': '/robot1',
        'text': 'speed above 1 m/s',
        'began': began,
        'worst': began,
        'ended': began + SECOND if ended else None,
        'rule': 'R1',
    }
    return Event(**{**fields, **more})


@pytest.fixture
def store(tmp_path):
    store = EventStore(tmp_path)
    yield store
    store.close()


def told(store, **wanted):
    return [item.event.began // SECOND for item in store.events(Filter(**wanted))]


def test_a_later_state_replaces_the_earlier_and_takes_no_number(store):
    one, two = event(1, ended=False), event(2)
    store.keep([one], now=0)
    for margin in (-0.1, -0.2):
        store.keep([replace(one, margin=margin)], now=0)
    store.keep([replace(one, ended=3 * SECOND), two], now=0)
    assert [(item.number, item.event.ended) for item in store.events()] == [
        (1, 3 * SECOND),
        (2, 3 * SECOND),
    ]


def test_events_are_found_by_rule_robot_kind_and_time(store):
    store.keep(
        [
            event(1),
            event(2, robot='/robot1#3'),
            event(3, robot='/robot10', rule='R2'),
            event(4, kind='unknown', rule=None),
            event(5, ended=False),
        ],
        now=0,
    )
    assert told(store, robot='/robot1') == [1, 2, 4, 5]
    assert told(store, robot='/robot_') == []
    assert told(store, rule='R2') == [3]
    assert told(store, kind='unknown') == [4]
    assert told(store, since=4 * SECOND) == [3, 4, 5]
    assert told(store, since=3 * SECOND, until=4 * SECOND) == [2, 3]
    assert [item.event.began // SECOND for item in store.events(newest=2)] == [4, 5]


def test_what_was_open_when_the_writer_died_is_closed_as_interrupted(tmp_path):
    with closing(EventStore(tmp_path)) as store:
        store.keep([event(1, ended=False), event(2)], now=2 * SECOND)
        store.hear_open(9 * SECOND)
    with closing(EventStore(tmp_path)) as store:
        [interrupted] = store.interrupted
        assert interrupted.ended == 9 * SECOND
        assert 'interrupted' in interrupted.reason
        assert [item.event.ended for item in store.events()] == [9 * SECOND, 3 * SECOND]
    with closing(EventStore(tmp_path)) as store:
        assert store.interrupted == []


def test_no_acknowledged_event_is_lost_by_a_kill(tmp_path):
    from benchmarks.events import endure

    endured = endure(tmp_path, kills=3, seconds=1.0)
    assert endured.events > 30
    assert (endured.lost, endured.twice, endured.unopened) == (0, 0, 0)


def test_the_oldest_make_room_and_pinned_ones_stay(tmp_path):
    limit = 200_000
    with closing(EventStore(tmp_path, max_bytes=limit)) as store:
        first = event(0)
        store.keep([first, event(0.5, ended=False)], now=0)
        store.pin(1)
        for batch in range(40):
            store.keep([event(1 + batch * 100 + place) for place in range(100)], now=0)
            assert store.used_bytes < limit + 100_000
        numbers = [item.number for item in store.events()]
        # What goes on stays too, and the others are the newest.
        assert numbers[:2] == [1, 2]
        assert numbers[2:] == list(range(numbers[2], 4003))
        assert 100 < len(numbers) < 1000
        # The file does not grow beyond it, whatever comes.
        assert store.path.stat().st_size < 2 * limit


def test_a_store_full_of_pinned_events_refuses_more_with_a_sentence(tmp_path):
    with closing(EventStore(tmp_path, max_bytes=100_000)) as store:
        store.keep([event(place) for place in range(300)], now=0)
        for number in range(1, 301):
            store.pin(number)
        with pytest.raises(StoreFullError, match='pinned events; allowed are more bytes, or fewer'):
            store.keep([event(1000)], now=0)
        assert len(store) == 300
        store.pin(7, pinned=False)
        store.pin(8, pinned=False)


def test_a_second_writer_is_refused_and_readers_are_not(store, tmp_path):
    store.keep([event(1)], now=0)
    with pytest.raises(OccError, match='another program is writing to'):
        EventStore(tmp_path)
    reader = EventReader(store.path)
    assert pin_event(store.path, 1, pinned=True)
    store.keep([event(2)], now=0)
    assert [(item.number, item.pinned) for item in reader.events()] == [(1, True), (2, False)]
    assert reader.find('1') == reader.find(reader.events()[0].event.id[:20])
    assert reader.find('3') is None
    reader.close()


def test_a_directory_that_may_only_be_read_is_read(tmp_path):
    with closing(EventStore(tmp_path / 'store')) as store:
        store.keep([event(1)], now=0)
    for path in (tmp_path / 'store').iterdir():
        path.chmod(0o444)
    (tmp_path / 'store').chmod(0o555)
    try:
        with closing(EventReader(store.path)) as reader:
            assert len(reader.events()) == 1
    finally:
        (tmp_path / 'store').chmod(0o755)


def test_a_newer_schema_and_another_database_are_refused_and_left_alone(tmp_path):
    with closing(EventStore(tmp_path)) as store:
        store.keep([event(1)], now=0)
    with closing(sqlite3.connect(store.path)) as connection:
        connection.execute('PRAGMA user_version = 2')
    for make in (lambda: EventStore(tmp_path), lambda: EventReader(store.path)):
        with pytest.raises(OccError, match='of schema 2; allowed is 1 at most'):
            make()
    with closing(sqlite3.connect(store.path)) as connection:
        connection.execute('PRAGMA application_id = 1')
    before = store.path.read_bytes()
    for make in (lambda: EventStore(tmp_path), lambda: EventReader(store.path)):
        with pytest.raises(OccError, match='is no event store but another database'):
            make()
    assert store.path.read_bytes() == before


@pytest.mark.parametrize('content', [b'no database at all' * 100, b''])
def test_what_is_no_database_is_set_aside(tmp_path, content):
    (tmp_path / 'events.db').write_bytes(content)
    with closing(EventStore(tmp_path)) as store:
        store.keep([event(1)], now=0)
        assert len(store) == 1
        if content:
            assert store.damaged.read_bytes() == content


def test_a_store_that_is_damaged_or_removed_while_it_runs_is_begun_anew(tmp_path):
    store, heard = EventStore(tmp_path), []
    journal = Journal(store, lambda event, phase: heard.append(event))
    journal.add([(event(1), 'began')], wall=0, steady=0)
    store.path.unlink()
    journal.add([(event(2), 'began')], wall=0, steady=1)
    for second in (11, 12, 13):
        journal.tick(wall=0, steady=second * SECOND)
    # All that is remembered is in the new one.
    with closing(EventReader(store.path)) as reader:
        assert len(reader.events()) == 2
    store.close()


def test_while_the_disk_is_full_events_wait_and_are_told_all_the_same(tmp_path):
    store, heard = EventStore(tmp_path), []
    journal = Journal(store, lambda event, phase: heard.append(event.began // SECOND))
    journal.add([(event(1), 'ended')], wall=0, steady=0)
    pages = store._connection.execute('PRAGMA page_count').fetchone()[0]
    store._connection.execute(f'PRAGMA max_page_count = {pages}')
    for number in range(2, 200):
        journal.add([(event(number), 'ended')], wall=0, steady=number * SECOND)
    assert 'database or disk is full' in journal.problem
    assert heard == list(range(1, 200))
    kept = told(store)
    assert kept == list(range(1, len(kept) + 1))
    assert journal.waiting == 199 - len(kept) > 0
    store._connection.execute('PRAGMA max_page_count = 100000')
    journal.tick(wall=0, steady=300 * SECOND)
    assert (journal.problem, journal.waiting) == ('', 0)
    assert told(store) == list(range(1, 200))
    store.close()


def test_what_gets_worse_is_told_once_a_second(tmp_path):
    store, heard = EventStore(tmp_path), []
    journal = Journal(store, lambda event, phase: heard.append((phase, event.margin)))
    one = event(1, ended=False)
    journal.add([(replace(one, margin=-0.1), 'began')], wall=0, steady=0)
    for step in range(1, 25):
        worse = replace(one, margin=-0.1 - step / 100)
        journal.add([(worse, 'update')], wall=0, steady=step * SECOND // 10)
        journal.tick(wall=0, steady=step * SECOND // 10)
    assert heard == [('began', -0.1), ('update', -0.2), ('update', pytest.approx(-0.3))]
    journal.add([(replace(worse, ended=2 * SECOND), 'ended')], wall=0, steady=5 * SECOND // 2)
    journal.tick(wall=0, steady=10 * SECOND)
    assert heard[3:] == [('ended', pytest.approx(-0.34))]
    store.close()


def test_a_bag_is_named_once_it_is_there_and_stays_named(tmp_path):
    store, heard = EventStore(tmp_path), []
    journal = Journal(store, lambda event, phase: heard.append((phase, event.bag)))
    one = event(1, ended=False)
    journal.add([(one, 'began')], wall=0, steady=0)
    journal.name_bag([one.id, 'f' * 24], '/bags/1', wall=0, steady=0)
    journal.add([(replace(one, ended=SECOND), 'ended')], wall=0, steady=0)
    assert heard == [('began', None), ('update', '/bags/1'), ('ended', '/bags/1')]
    assert store.events()[0].event.bag == '/bags/1'
    store.pin(1)
    assert store.pinned_bags() == {'/bags/1'}
    journal.name_bag([one.id], None, wall=0, steady=0)
    assert store.events()[0].event.bag is None
    store.close()


TINY_DISK = """
mount -t tmpfs -o size=2m tmpfs "$1" && "$2" -c '
import os, sys
from pathlib import Path
from occ_constraints_pkg.events.event import Event, new_id
from occ_constraints_pkg.events.journal import Journal
from occ_constraints_pkg.events.store import EventStore
store, heard = EventStore(Path(sys.argv[1]) / "store"), []
journal = Journal(store, lambda event, phase: heard.append(event.id))
def add(count, steady):
    for number in range(count):
        event = Event(new_id(number), "violation", "/", "x" * 300, number, number, number)
        journal.add([(event, "ended")], wall=number, steady=steady + number * 10**10)
add(100, 0)
kept = len(store)
room = os.statvfs(sys.argv[1])
Path(sys.argv[1], "filling").write_bytes(bytes(room.f_bavail * room.f_frsize - 100_000))
add(700, 10**13)
print(journal.problem, kept, len(store) >= kept, journal.waiting > 0, len(heard))
Path(sys.argv[1], "filling").unlink()
journal.tick(wall=0, steady=10**14)
print(len(store) - len(set(heard)) + journal.waiting)
store.close()
print(len(EventStore(Path(sys.argv[1]) / "store")) >= kept)
' "$1"
"""


def test_a_really_full_disk_keeps_the_old_events_and_takes_new_ones_later(tmp_path):
    may_mount = ['unshare', '--map-root-user', '--mount']
    try:
        subprocess.run([*may_mount, 'true'], check=True, capture_output=True)
    except (OSError, subprocess.CalledProcessError):
        pytest.skip('needs the right to mount in a name space of its own')
    result = subprocess.run(
        [*may_mount, 'sh', '-c', TINY_DISK, 'sh', str(tmp_path), sys.executable],
        capture_output=True,
        text=True,
        timeout=60,
        env={**os.environ, 'PYTHONPATH': os.pathsep.join(sys.path)},
    )
    if 'permission denied' in result.stderr:
        pytest.skip('needs the right to mount in a name space of its own')
    first, rest, opened = result.stdout.splitlines()
    assert 'full' in first or 'I/O error' in first, result.stderr
    assert first.endswith('100 True True 800')
    assert (rest, opened) == ('0', 'True')
