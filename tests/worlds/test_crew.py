# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
import gc
import threading
import time

import pytest
from occ_constraints_pkg.worlds.crew import Crew


@pytest.mark.parametrize('size', [1, 2, 3])
def test_each_share_is_done_by_a_thread_of_its_own(size):
    crew = Crew(size)
    # Passed only when all of them are there at once.
    together = threading.Barrier(size)
    done = {}

    def work(number):
        together.wait(timeout=10)
        done[number] = threading.get_ident()

    crew.share(work)
    assert sorted(done) == list(range(size))
    assert len(set(done.values())) == size
    assert done[0] == threading.get_ident()
    crew.close()


def test_an_error_on_any_thread_is_raised_once_all_have_ended():
    crew = Crew(3)
    ended = []

    def work(number):
        ended.append(number)
        if number == 1:
            raise ValueError('share 1')

    with pytest.raises(ValueError, match='share 1'):
        crew.share(work)
    assert sorted(ended) == [0, 1, 2]
    crew.close()


def test_closing_stops_the_threads():
    before = threading.active_count()
    crew = Crew(3)
    together = threading.Barrier(3)
    crew.share(lambda number: together.wait(timeout=10))
    assert threading.active_count() == before + 2
    crew.close()
    assert threading.active_count() == before


def test_the_threads_of_a_crew_that_is_given_up_end():
    before = threading.active_count()
    crew = Crew(2)
    crew.share(lambda number: None)
    del crew
    gc.collect()
    end = time.monotonic() + 10
    while threading.active_count() > before and time.monotonic() < end:
        time.sleep(0.01)
    assert threading.active_count() == before
