# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""How late messages come: correctly stamped, but delayed, as by a backlogged bridge."""

from __future__ import annotations

from occ_constraints_pkg.features.feature_map import FeatureMap, topic_key

SECOND_NS = 1_000_000_000
# What is allowed unless somebody says otherwise: sensors of robots come 0.01 s after their stamp,
# what is computed of them up to 0.45 s.
MAX_LAG_SECONDS = 1.0
# A stamp that is this close to the time of publishing is of the same clock, or of one that is kept
# in step with it; one that is further off is of a clock that is set otherwise, and beyond a day it
# is the time of a simulation or of an old recording, which may run at any rate and pause.
_SAME_CLOCK_NS = 15 * SECOND_NS
_ANY_RATE_NS = 86_400 * SECOND_NS
# A clock that is set otherwise counts once it was seen to run as fast as ours over this time,
# within so much; a recording that is played slowly never does.
_PROOF_NS = 2 * SECOND_NS
_PROOF = 0.05
# The smallest delay seen is forgotten at this rate (1 ms per second), which is more than clocks
# drift apart and less than matters.
_FORGETTING = 1e-3


class Delay:
    """A delay that is known but for a constant, as between two clocks; its smallest value is none.

    A step of the later clock, or of the earlier one back, is no delay: whoever knows of one makes
    a new object.
    """

    def __init__(self) -> None:
        self._least_ns: float | None = None
        self._now_ns = 0

    def growth_ns(self, delay_ns: int, now_ns: int) -> int:
        """Return by how much a delay is above the smallest recent one.

        Args:
            delay_ns: the delay and a constant, in ns.
            now_ns: when it was seen.
        """
        least = self._least_ns
        if least is None:
            least = delay_ns
        else:
            least = min(delay_ns, least + _FORGETTING * max(now_ns - self._now_ns, 0))
        self._least_ns, self._now_ns = least, now_ns
        return round(delay_ns - least)


class Lateness:
    """Says how late each message of one topic is, whatever clock its stamps are of.

    Two delays are added: from the header stamp to the time of publishing, and from there to the
    arrival. Of each, what it has grown by since its smallest recent value counts, so that clocks
    may differ. The first one counts in full where both times are of one clock, which shows in
    their being at most 15 s apart, unless the stamps' clock was seen to be set back. Where they
    are more than a day apart it does not count, for then the stamps are of a simulation or an old
    recording, whose time may run at any rate.

    Args:
        limit_ns: a time that goes back by more than this was set back.
    """

    def __init__(self, limit_ns: int) -> None:
        self._limit_ns = limit_ns
        self._age, self._way = Delay(), Delay()
        self._stamp = self._published = 0
        self._is_real_time = self._was_set_back = False
        # Time and age at which the proof of a clock's rate began.
        self._proof: tuple[int, int] | None = None

    def lag_ns(self, stamp: int | None, published: int, arrival: int | None = None) -> int:
        """Return how late a message is, in ns.

        Args:
            stamp: its header stamp; None without one.
            published: when it was published, by the publisher's system clock; or when it arrived
                by the clock that stamps are compared with, where that is all that is known.
            arrival: when it arrived, on a clock that never jumps; None where it is not known when
                it was published.
        """
        lag = 0
        if arrival is not None:
            if published < self._published - self._limit_ns:
                self._way = Delay()
            self._published = published
            lag += self._way.growth_ns(arrival - published, arrival)
        if stamp is not None:
            lag += self._age_ns(stamp, published, is_sure=arrival is not None)
        return lag

    def _age_ns(self, stamp: int, published: int, *, is_sure: bool) -> int:
        if stamp < self._stamp - self._limit_ns:
            self._reset()
            self._was_set_back = True
        self._stamp = stamp
        age = published - stamp
        # Then it tells the right time again.
        self._was_set_back = self._was_set_back and age > self._limit_ns
        is_same_clock = abs(age) <= _SAME_CLOCK_NS
        if abs(age) > _ANY_RATE_NS:
            self._reset()
            return 0
        if is_same_clock:
            self._is_real_time = True
        elif not self._is_real_time and not self._runs_like_ours(age, published):
            return 0
        growth = self._age.growth_ns(age, published)
        is_absolute = is_same_clock and is_sure and not self._was_set_back
        return max(growth, age) if is_absolute else growth

    def _runs_like_ours(self, age: int, now_ns: int) -> bool:
        begin, first = self._proof or (now_ns, age)
        span = now_ns - begin
        if self._proof is None or span >= _PROOF_NS or span < 0:
            self._is_real_time = span >= _PROOF_NS and abs(age - first) <= _PROOF * span
            self._proof = now_ns, age
        return self._is_real_time

    def _reset(self) -> None:
        self._age, self._is_real_time, self._proof = Delay(), False, None


def lateness_of(feature_map: FeatureMap, limit_ns: int) -> dict[str, Lateness]:
    """Return what tells how late a topic's messages are, for each whose stamps tell the time.

    Args:
        feature_map: names the topics; tables are left out.
        limit_ns: the lateness that is allowed; 0 for any, and then no topic is looked at.
    """
    timed = [topic for topic in feature_map.topics if topic not in feature_map.table_topics]
    return {topic_key(topic): Lateness(limit_ns) for topic in timed if limit_ns}


def describe_lateness(topic: str, lag_ns: int, limit_ns: int) -> str:
    """Return the reason why a message was not judged."""
    return (
        f'a message on {topic!r} is {lag_ns / SECOND_NS:.3g} s late; allowed is '
        f'{limit_ns / SECOND_NS:g} s, by max_lag'
    )
