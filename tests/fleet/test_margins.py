# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The ring of margins says what a list of all of them would."""

import math

from hypothesis import given
from hypothesis import strategies as st
from occ_constraints_pkg.fleet.margins import BUCKET_SECONDS, BUCKETS, MarginHistory

PAUSES = st.floats(0.0, 3.0) | st.floats(0.0, 2.0 * BUCKETS * BUCKET_SECONDS)


@given(st.lists(st.tuples(PAUSES, st.floats(-9.0, 9.0) | st.just(math.nan)), max_size=40), PAUSES)
def test_each_span_has_the_smallest_of_what_came_in_it(verdicts, silence):
    history, least, now = MarginHistory(), {}, 1000.0
    for pause, margin in verdicts:
        now += pause
        history.keep(margin, now)
        value, span = -math.inf if math.isnan(margin) else margin, int(now / BUCKET_SECONDS)
        least[span] = min(value, least.get(span, math.inf))
    newest = max(least, default=0)
    now += silence
    last = int(now / BUCKET_SECONDS)
    for count in (1, 8, BUCKETS):
        spans = range(last - count + 1, last + 1)
        kept = [least.get(span) if span > newest - BUCKETS else None for span in spans]
        assert history.newest(count, now) == kept


def test_what_comes_late_counts_for_the_newest_span():
    history = MarginHistory()
    history.keep(0.5, 100.0)
    history.keep(0.25, 90.0)
    assert history.newest(1, 100.0) == [0.25]
    assert history.newest(30, 100.0)[:-1] == [None] * 29
