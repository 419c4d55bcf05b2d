# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
import errno
import gc
import os
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from occ_constraints_pkg.worlds.worker_pool import SharedArrays, WorkerError, WorkerPool


class Marked:
    """A world that marks in each step which process has stepped a robot, and how often."""

    def __init__(self, num_envs, *, processes=1, arrays=None):
        self.pool = WorkerPool(type(self), num_envs, processes)
        arrays = self.pool.arrays if arrays is None else arrays
        zeros = np.zeros if arrays is None else arrays.zeros
        self.costs = zeros(num_envs)
        self.process, self.times = (zeros(num_envs, np.int64) for _ in range(2))

    def step(self):
        self.pool.share(self.costs, self.advance)

    def advance(self, rows):
        self.process[rows] = os.getpid()
        self.times[rows] += 1
        self.costs[rows] = 1.0


class Slow(Marked):
    """Its workers take a while."""

    def advance(self, rows):
        if rows.start > 0:
            time.sleep(1.0)
        super().advance(rows)


class Broken(Marked):
    """Its workers give up."""

    def advance(self, rows):
        if rows.start > 0:
            sys.exit(7)


@pytest.mark.parametrize(('robots', 'processes'), [(7, 1), (1, 2), (70, 2), (70, 3)])
def test_every_robot_is_stepped_once_and_by_all_processes(robots, processes):
    world = Marked(robots, processes=processes)
    for step in range(1, 20):
        world.step()
        assert (world.times == step).all()
        # Robots in a row, the caller's first.
        runs = 1 + (np.diff(world.process) != 0).sum()
        assert len(set(world.process)) == runs == min(robots, processes)
    if robots >= processes:
        assert world.process[0] == os.getpid()
    world.pool.close()


def test_rows_end_where_the_costs_of_all_are_about_equal():
    pool = WorkerPool(Marked, 40, 1)
    pool.size, pool._parts, pool._times = 3, [1 / 3] * 3, [1.0] * 3
    pool._plan(np.where(np.arange(40) < 10, 9.0, 1.0))
    # 10 x 9 + 30 x 1 = 120; 40 for each are 4.4 of the first robots, 4.4 more, and the rest.
    assert pool._bounds == [4, 9, 40]


def test_who_takes_longer_gets_fewer_robots():
    pool = WorkerPool(Marked, 40, 1)
    pool.size, pool._parts = 2, [0.5, 0.5]
    bounds = []
    for _ in range(40):
        # The second process is half as fast.
        pool._times = [pool._parts[0], 2 * pool._parts[1]]
        pool._plan(np.ones(40))
        bounds.append(pool._bounds[0])
    assert bounds == sorted(bounds)
    assert bounds[0] <= 21
    assert bounds[-1] in (26, 27)


def test_a_worker_that_gives_up_is_told_and_replaced(capfd):
    world = Broken(4, processes=2)
    for _ in range(2):
        with pytest.raises(WorkerError, match=r'a process that steps robots .* ended with code 7'):
            world.step()
    world.pool.close()


def test_a_worker_that_is_killed_is_told_and_replaced():
    world = Marked(4, processes=2)
    world.step()
    worker = int(world.process[-1])
    os.kill(worker, signal.SIGKILL)
    assert _ends(worker)
    with pytest.raises(WorkerError, match='ended with code -9'):
        world.step()
    world.step()
    assert world.process[-1] not in (worker, os.getpid())
    world.pool.close()


def test_nobody_works_on_the_robots_after_an_interruption():
    world = Slow(4, processes=2)

    def interrupted(_):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        world.pool.share(world.costs, interrupted)
    world.times[:] = 5
    time.sleep(1.5)
    assert (world.times == 5).all()
    world.step()
    assert (world.times == 6).all()
    world.pool.close()


def test_a_worker_that_stands_still_does_not_keep_the_pool():
    world = Marked(4, processes=2)
    world.step()
    worker = int(world.process[-1])
    os.kill(worker, signal.SIGSTOP)
    world.pool.close()
    assert _ends(worker)


def test_a_copy_of_the_process_may_not_use_the_pool_nor_keep_it():
    world = Marked(4, processes=2)
    world.step()
    worker = int(world.process[-1])
    told, tell = os.pipe()
    child = os.fork()
    if child == 0:
        try:
            world.step()
        except WorkerError as error:
            os.write(tell, str(error).encode())
        time.sleep(60)
    assert b'used in a copy of the process' in os.read(told, 1000)
    world.step()
    assert (world.times == 2).all()
    world.pool.close()
    assert _ends(worker)
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    os.close(told)
    os.close(tell)


def test_a_closed_pool_cannot_be_used():
    world = Marked(4, processes=2)
    world.pool.close()
    with pytest.raises(WorkerError, match='after it was closed'):
        world.step()


def test_a_class_that_others_cannot_import_is_refused():
    class Local(Marked):
        pass

    assert Local(4).pool.size == 1
    with pytest.raises(WorkerError, match=r'Local of .* was asked for 2 processes; .* by 1'):
        Local(4, processes=2)


def test_workers_that_cannot_be_started_are_told(monkeypatch):
    before = _descriptors()

    def refuse(*_, **__):
        raise OSError(errno.EAGAIN, 'too many')

    monkeypatch.setattr(subprocess, 'Popen', refuse)
    with pytest.raises(WorkerError, match='3 processes, which cannot be started: too many'):
        Marked(4, processes=3)
    gc.collect()
    assert _descriptors() == before


def test_a_world_of_one_process_opens_nothing():
    before = _descriptors()
    worlds = [Marked(4) for _ in range(50)]
    assert _descriptors() == before
    assert {world.pool.size for world in worlds} == {1}


@pytest.mark.parametrize('given_up', [False, True])
def test_workers_end_with_the_pool(given_up):
    world = Marked(4, processes=2)
    world.step()
    worker = int(world.process[-1])
    assert _runs(worker)
    if given_up:
        del world
        gc.collect()
    else:
        world.pool.close()
        world.pool.close()
    assert _ends(worker)


PROGRAM = """
import os, signal, sys, time
from test_worker_pool import Marked
# Whatever started the tests may have it ignored, as shells do for what runs in the background.
signal.signal(signal.SIGINT, signal.default_int_handler)
world = Marked(4, processes=2)
world.step()
if 'fork' in sys.argv and os.fork() == 0:
    time.sleep(60)
print(world.process[-1], os.getpid(), flush=True)
time.sleep(60)
"""


# SIGINT as a terminal sends it: to the whole group of the program in the foreground.
@pytest.mark.parametrize('way', ['SIGKILL', 'SIGINT', 'SIGKILL and a fork lives on'])
def test_workers_end_when_the_program_does(way):
    running = _start(PROGRAM, *(['fork'] if 'fork' in way else []))
    worker, program = map(int, running.stdout.readline().split())
    assert _runs(worker)
    if way == 'SIGINT':
        os.killpg(running.pid, signal.SIGINT)
    else:
        os.kill(program, signal.SIGKILL)
    running.wait(timeout=30)
    assert _ends(worker)
    running.stdout.close()
    with suppress(ProcessLookupError):
        os.killpg(running.pid, signal.SIGKILL)


def test_workers_leave_the_end_to_the_program():
    running = _start(PROGRAM)
    worker = int(running.stdout.readline().split()[0])
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        os.kill(worker, number)
    time.sleep(0.5)
    assert _runs(worker)
    os.killpg(running.pid, signal.SIGKILL)
    running.communicate()
    assert _ends(worker)


def test_standard_streams_may_be_closed():
    program = f'{sys.executable} -c "$PROGRAM" <&- 2>&-'
    running = _start(PROGRAM, shell=program)
    worker = int(running.stdout.readline().split()[0])
    assert _runs(worker)
    os.killpg(running.pid, signal.SIGKILL)
    running.communicate()
    assert _ends(worker)


def _start(program, *arguments, shell=None):
    return subprocess.Popen(
        [sys.executable, '-c', program, *arguments] if shell is None else ['sh', '-c', shell],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        cwd=Path(__file__).parent,
        env=os.environ | {'PROGRAM': program},
        start_new_session=True,
        text=True,
    )


def _descriptors():
    gc.collect()
    return len(os.listdir('/proc/self/fd'))


def _ends(process):
    end = time.monotonic() + 30
    while _runs(process) and time.monotonic() < end:
        time.sleep(0.01)
    return not _runs(process)


def _runs(process):
    try:
        state = Path(f'/proc/{process}/stat').read_text(encoding='ascii').rsplit(') ', 1)[1]
    except FileNotFoundError:
        return False
    return state[0] != 'Z'


SHAPES = [((3, 2), np.float64), (5000, np.int64), ((4, 0, 2), np.float64), (7, bool)]


def test_who_asks_in_the_same_order_gets_the_same_arrays():
    mine = SharedArrays(100_000)
    theirs = SharedArrays(100_000, os.dup(mine.descriptor))
    first = [mine.zeros(shape, dtype) for shape, dtype in SHAPES]
    second = [theirs.zeros(shape, dtype) for shape, dtype in SHAPES]
    mine.close()
    theirs.close()
    for number, (a, b) in enumerate(zip(first, second, strict=True)):
        assert a.shape == b.shape
        assert a.dtype == b.dtype
        assert not a.any()
        a[...] = number + 1
        np.testing.assert_array_equal(b, a)
        b[...] = 0
        assert not a.any()
    assert first[1].nbytes == 40_000
    assert [array.size for array in first] == [6, 5000, 0, 7]


def test_arrays_do_not_overlap():
    arrays = SharedArrays(50_000)
    made = [arrays.zeros(shape) for shape in (1, 511, 512, 513, 3)]
    arrays.close()
    arrays.close()
    for number, array in enumerate(made):
        array[:] = number
    for number, array in enumerate(made):
        assert (array == number).all()


def test_room_is_limited():
    arrays = SharedArrays(1000)
    arrays.zeros(125)
    with pytest.raises(TypeError):
        arrays.zeros(1)
    arrays.close()
