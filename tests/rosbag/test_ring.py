# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The ring of the last seconds: what it holds, for how long, and in how many bytes."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from occ_constraints_pkg.rosbag.ring import MESSAGE_BYTES, MOST_LATCHED, Batch, LiveTopic, Ring

LATCHED = {'durability': 'transient_local'}


def topic(name='/said', *, latched=False):
    return LiveTopic(name, 'std_msgs/msg/String', [LATCHED] if latched else [])


def batch(time, *messages):
    """Return a batch of ``(topic, bytes)``."""
    now = round(time * 1e9)
    return Batch.of(time, [(one, now, now, data) for one, data in messages])


@st.composite
def batches(draw):
    topics = [topic('/a'), topic('/b'), topic('/rules', latched=True)]
    message = st.tuples(st.sampled_from(topics), st.binary(max_size=400))
    steps = draw(st.lists(st.tuples(st.floats(0.0, 2.0), st.lists(message, max_size=4))))
    time, found = 0.0, []
    for step, messages in steps:
        time += step
        found.append(batch(time, *messages))
    return found


@given(batches(), st.floats(0.0, 5.0), st.integers(0, 6000))
def test_it_holds_what_is_young_enough_and_no_more_than_allowed(added, seconds, most):
    ring = Ring(seconds, most)
    seen = []
    for one in added:
        ring.add(one)
        seen.append(one)
        held = list(ring)
        # The newest ones, without a gap.
        assert held == seen[len(seen) - len(held) :]
        assert all(item.time >= one.time - seconds for item in held)
        # All that is younger than what it says it has let go of.
        assert [item for item in seen if item.time > ring.complete_since] == [
            item for item in held if item.time > ring.complete_since
        ]
        if ring.complete_since >= one.time - seconds:
            # Then bytes were short, and would be with one batch more.
            assert sum(item.size for item in seen[len(seen) - len(held) - 1 :]) > most or any(
                message[0].is_latched for item in seen for message in item.messages
            )
        last_ones = 400 + MESSAGE_BYTES
        assert ring.size <= most + last_ones


@given(batches(), st.integers(0, 20))
def test_of_latched_topics_the_last_messages_are_kept_for_ever(added, place):
    ring = Ring(1.0, 1 << 20)
    for one in added:
        ring.add(one)
    start = added[min(place, len(added) - 1)].time if added else 0.0
    latched, since = ring.since(start)
    before = [
        message
        for one in added
        if one not in since
        for message in one.messages
        if message[0].is_latched
    ]
    assert latched == before[-MOST_LATCHED:]
    assert [one for one in added if one.time >= max(start, added[-1].time - 1.0)] == since


def test_latched_messages_beyond_the_last_one_take_a_tenth_at_most():
    ring, rules, maps = Ring(1.0, 100_000), topic(latched=True), topic('/map', latched=True)
    for number in range(50):
        ring.add(batch(float(2 * number), (rules, bytes([number]))))
        ring.add(batch(float(2 * number), (maps, bytes(5000))))
    ring.expire(1000.0)
    latched, since = ring.since(0.0)
    assert since == []
    assert [message[0] for message in latched].count(maps) == 1
    assert latched[-1][3] == bytes(5000)
    assert [message[3] for message in latched if message[0] is rules][-1] == bytes([49])
    assert ring.size == sum(len(message[3]) + MESSAGE_BYTES for message in latched) <= 10_000


def test_the_last_message_of_a_latched_topic_stays_however_large_it_is():
    ring, maps = Ring(1.0, 1000), topic('/map', latched=True)
    ring.add(batch(0.0, (maps, bytes(5000))))
    ring.add(batch(5.0, (topic(), b'now')))
    latched, _ = ring.since(5.0)
    assert [len(message[3]) for message in latched] == [5000]


def test_a_clock_that_stands_still_changes_nothing():
    ring = Ring(1.0, 1 << 20)
    for _ in range(3):
        ring.add(batch(7.0, (topic(), b'x')))
    assert len(list(ring)) == 3
    assert ring.complete_since == pytest.approx(-float('inf'))
