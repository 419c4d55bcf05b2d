# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
import gc
import os
import threading
import time

import pytest
from occ_constraints_pkg.worlds.wake_up_channel import WakeUpChannel


@pytest.fixture
def channel():
    ends = WakeUpChannel.pair()
    yield ends
    for end in ends:
        end.close()


def test_messages_arrive_whole_and_in_order_both_ways(channel):
    for one, other in (channel, channel[::-1]):
        for number in range(50):
            one.send(b'x' * (number % 8 + 1))
        assert [len(other.receive(8)) for _ in range(50)] == [n % 8 + 1 for n in range(50)]


# Shorter than the receiver's patience, and longer.
@pytest.mark.parametrize('pause', [0.0, 0.05])
def test_a_receiver_waits_awake_or_asleep(channel, pause):
    one, other = channel
    answers = []

    def answer():
        while message := other.receive(8):
            time.sleep(pause)
            answers.append(message)
            other.send(message)

    thread = threading.Thread(target=answer)
    thread.start()
    for number in range(10):
        one.send(bytes([number]))
        assert one.receive(8) == bytes([number])
        time.sleep(pause)
    assert len(answers) == 10
    one.close()
    thread.join(timeout=10)
    assert not thread.is_alive()


def test_a_closed_end_is_told_to_the_other(channel):
    one, other = channel
    one.send(b'last')
    one.close()
    assert other.receive(8) == b'last'
    assert other.receive(8) == b''
    with pytest.raises(ConnectionError):
        other.send(b'x')


def test_closing_leaves_no_descriptor_open():
    gc.collect()
    before = len(os.listdir('/proc/self/fd'))
    one, other = WakeUpChannel.pair()
    assert len(os.listdir('/proc/self/fd')) == before + 6
    for end in (one, other, one):
        end.close()
    assert len(os.listdir('/proc/self/fd')) == before
