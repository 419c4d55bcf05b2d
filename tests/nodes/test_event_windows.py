# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Which seconds around events are recorded, and what the recording says of itself."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from occ_constraints_pkg.nodes.event_recorder.windows import EventWindows, Extent
from occ_constraints_pkg.rosbag.event_bags import EventBags, event_bags, event_document
from occ_constraints_pkg.rosbag.event_writer import EventBagWriter
from occ_constraints_pkg.rosbag.recording import Recording
from occ_constraints_pkg.rosbag.ring import Batch, LiveTopic

NOW = 1_700_000_000_000_000_000
SAID = LiveTopic('/said', 'std_msgs/msg/String', [{'durability': 'volatile'}])
RULES = LiveTopic('/rules', 'std_msgs/msg/String', [{'durability': 'transient_local'}])
EXTENT = Extent(before=2.0, after=1.0, longest=5.0, max_bytes=1 << 24)


def event(name, phase='began', *, kind='violation', at=None):
    began = NOW if at is None else NOW + round(at * 1e9)
    return {'id': name, 'phase': phase, 'kind': kind, 'rule': 'R1', 'began': began}


class Drive:
    """A drive with ten batches a second, the second of which is in each message."""

    def __init__(self, folder, extent=EXTENT):
        self.bags = EventBags(folder)
        self.writer = EventBagWriter(self.bags)
        self.warnings = []
        self.windows = EventWindows(extent, self.bags, self.writer, self.warnings.append, 0.0)
        self.tick = 0

    @property
    def now(self):
        return self.tick / 10

    def until(self, seconds, size=0):
        while self.now < seconds:
            self.tick += 1
            messages = [self.message(SAID, size)]
            if self.tick == 1:
                messages.insert(0, self.message(RULES))
            self.windows.add(Batch.of(self.now, messages))
        return self

    def message(self, topic, size=0):
        text = f'{self.now:g}'.encode() + b' ' * size
        data = b'\0\1\0\0' + (len(text) + 1).to_bytes(4, 'little') + text + b'\0'
        when = NOW + self.tick * 10**8
        return topic, when, when, data

    def event(self, *args, **options):
        wall = NOW + self.tick * 10**8
        return self.windows.on_event(event(*args, **{'at': self.now, **options}), self.now, wall)

    def end(self):
        self.windows.end(self.now, 'the recorder was ended')
        self.writer.close()
        return list(self.writer.outcomes)


def said(path):
    recording = Recording(path)
    return [float(recording.decode(raw).data) for raw in recording.messages(['/said'])]


def ticks(first, last):
    return [tick / 10 for tick in range(round(10 * first), round(10 * last) + 1)]


def test_an_event_is_recorded_from_before_it_began_to_after_it_ended(tmp_path):
    drive = Drive(tmp_path).until(10.0)
    path = drive.event('a')
    assert drive.until(11.5).event('a', 'update') == path
    assert drive.event('a', 'ended') == path
    (outcome,) = drive.until(20.0).end()
    assert outcome.path == path
    assert said(path) == ticks(8.0, 12.5)
    document = outcome.document
    assert (document['complete'], document['reason']) == (True, '')
    assert [one['phase'] for one in document['events']] == ['ended']
    assert document['missing_before'] == 0.0
    assert document['seconds_after'] == pytest.approx(2.5)
    # The rules in force were latched long before: they come first, at the start of the window.
    first = next(iter(Recording(path).messages()))
    assert (first.topic, first.log_time_ns) == ('/rules', NOW + 80 * 10**8)


def test_an_event_that_is_told_late_is_recorded_from_before_it_began(tmp_path):
    drive = Drive(tmp_path).until(10.0)
    path = drive.event('a', at=7.0)
    drive.event('a', 'ended', at=7.0)
    drive.until(20.0).end()
    assert said(path) == ticks(5.0, 11.0)


@pytest.mark.parametrize('at', [-1e9, -100.0, 11.0, 1e9])
def test_an_event_by_another_clock_began_now(tmp_path, at):
    drive = Drive(tmp_path).until(10.0)
    path = drive.event('a', at=at)
    drive.event('a', 'ended', at=at)
    drive.until(20.0).end()
    assert said(path) == ticks(8.0, 11.0)


def test_events_that_overlap_share_a_recording_and_later_ones_do_not(tmp_path):
    drive = Drive(tmp_path).until(10.0)
    first = drive.event('a')
    assert drive.until(10.5).event('b') == first
    assert drive.until(11.0).event('a', 'ended') == first
    assert drive.until(12.5).event('b', 'ended') == first
    # Within what is recorded after an event.
    assert drive.until(13.0).event('c', kind='trigger') == first
    drive.event('c', 'ended', kind='trigger')
    second = drive.until(14.5).event('d')
    assert second != first
    # Of an event that began in the first one.
    assert drive.event('a', 'ended') is None
    drive.event('d', 'ended')
    outcomes = drive.until(20.0).end()
    assert [one.path for one in outcomes] == [first, second]
    assert [one['id'] for one in outcomes[0].document['events']] == ['a', 'b', 'c']
    assert said(first) == ticks(8.0, 14.0)
    assert said(second) == ticks(12.5, 15.5)


def test_an_event_that_goes_on_does_not_keep_a_recording_open(tmp_path):
    drive = Drive(tmp_path).until(10.0)
    path = drive.event('a')
    (outcome,) = drive.until(30.0).end()
    assert said(path) == ticks(8.0, 15.0)
    assert not outcome.document['complete']
    assert 'longer than 5 s' in outcome.document['reason']
    assert drive.windows.on_event(event('a', 'ended'), 30.0, NOW) is None


def test_a_recorder_that_is_ended_ends_the_recording(tmp_path):
    drive = Drive(tmp_path).until(10.0)
    path = drive.event('a')
    (outcome,) = drive.until(10.5).end()
    assert said(path) == ticks(8.0, 10.5)
    assert event_document(path) == outcome.document
    assert outcome.document['reason'] == 'the recorder was ended'


def test_it_says_when_the_start_is_missing(tmp_path):
    drive = Drive(tmp_path / 'early').until(0.5)
    drive.event('a')
    drive.event('a', 'ended')
    (outcome,) = drive.until(5.0).end()
    assert outcome.document['missing_before'] == pytest.approx(1.5)
    # It had just been started, which is no lack of memory.
    assert drive.warnings == []

    drive = Drive(tmp_path / 'small', Extent(2.0, 1.0, 5.0, 1 << 20)).until(10.0, size=100_000)
    path = drive.event('a')
    drive.event('a', 'ended')
    (outcome,) = drive.until(20.0).end()
    assert outcome.document['missing_before'] == pytest.approx(1.0, abs=0.11)
    assert said(path)[-1] == 11.0
    assert len(drive.warnings) == 1
    assert 'max_bytes' in drive.warnings[0]


def test_a_thousand_events_at_once_are_counted(tmp_path):
    drive = Drive(tmp_path).until(10.0)
    for number in range(1000):
        drive.event(str(number))
    for number in range(1000):
        drive.event(str(number), 'ended')
    (outcome,) = drive.until(20.0).end()
    assert len(outcome.document['events']) == 200
    assert outcome.document['other_events'] == 800
    assert said(outcome.path) == ticks(8.0, 11.0)


def test_an_event_late_in_a_long_recording_has_its_seconds_after(tmp_path):
    drive = Drive(tmp_path).until(10.0)
    first = drive.event('a')
    assert drive.until(14.9).event('b') == first
    second = drive.until(15.5).event('c')
    assert second != first
    drive.event('c', 'ended')
    outcomes = drive.until(30.0).end()
    assert said(first) == ticks(8.0, 15.5)
    assert outcomes[0].document['reason'] == 'it goes on in the next recording'
    assert said(second) == ticks(13.5, 16.5)


@settings(max_examples=15)
@given(st.lists(st.tuples(st.integers(1, 40), st.integers(0, 70)), max_size=5))
def test_no_second_around_the_beginning_of_an_event_is_missing(tmp_path_factory, events):
    folder = tmp_path_factory.mktemp('bags')
    drive, paths, begin = Drive(folder).until(5.0), {}, 50
    changes = []
    for number, (pause, lasts) in enumerate(events):
        begin += pause
        changes += [(begin, 'began', number), (begin + lasts, 'ended', number)]
    for tick, phase, number in sorted(changes):
        path = drive.until(tick / 10).event(str(number), phase)
        paths.setdefault(number, path)
    drive.until(drive.now + 10.0).end()
    recorded = {bag.path: said(bag.path) for bag in event_bags(folder)}
    assert set(recorded) == set(paths.values())
    for seconds in recorded.values():
        assert seconds == ticks(seconds[0], seconds[-1])
        assert seconds[-1] - seconds[0] <= 2.0 + 5.0 + 1.0
    everything = set().union(*recorded.values())
    for tick, phase, number in changes:
        if phase == 'began':
            # The very first one depends on how a sum of seconds is rounded.
            assert recorded[paths[number]][0] <= (tick - 19) / 10
            assert {other / 10 for other in range(tick - 19, tick + 11)} <= everything
