# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
import gc
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.worlds.crew import Crew
from occ_constraints_pkg.worlds.shared_arrays import SharedArrays


class Marked:
    """A world that marks in each step which process has stepped a robot, and how often."""

    def __init__(self, num_envs, *, processes=1, arrays=None):
        arrays = SharedArrays() if arrays is None else arrays
        self.costs = arrays.zeros(num_envs)
        self.costs[:] = 1.0
        self.process, self.times = (arrays.zeros(num_envs, np.int64) for _ in range(2))
        self.crew = Crew(type(self), num_envs, arrays.descriptor, processes)
        arrays.close()

    def step(self):
        self.crew.share(self.costs, self.advance)

    def advance(self, rows):
        self.process[rows] = os.getpid()
        self.times[rows] += 1


class Uneven(Marked):
    """Its first robots take longer than the others, which its costs tell."""

    def advance(self, rows):
        super().advance(rows)
        costs = np.where(np.arange(len(self.costs)) < 10, 9.0, 1.0)[rows]
        self.costs[rows] = costs
        # Asleep and not at work, for other programs would change how long work takes.
        time.sleep(costs.sum() * 1e-4)


class Broken(Marked):
    """Its helpers give up."""

    def advance(self, rows):
        if rows.start > 0:
            sys.exit(7)


@pytest.mark.parametrize(('robots', 'processes'), [(7, 1), (1, 2), (7, 2), (7, 3)])
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
    world.crew.close()


def test_robots_that_take_longer_are_fewer():
    world = Uneven(40, processes=2)
    for _ in range(30):
        world.step()
    # 10 x 9 + 30 x 1 = 120, whose half is 6 or 7 of the slow ones.
    assert 5 <= (world.process == os.getpid()).sum() <= 8
    world.crew.close()


def test_a_helper_that_is_gone_is_told(capfd):
    world = Broken(4, processes=2)
    with pytest.raises(OccError, match=r'a process that steps robots .* ended with code 7'):
        world.step()
    with pytest.raises(OccError, match='ended with code 7'):
        world.step()
    world.crew.close()


def test_a_helper_that_is_killed_is_told():
    world = Marked(4, processes=2)
    world.step()
    helper = int(world.process[-1])
    os.kill(helper, signal.SIGKILL)
    assert _ends(helper)
    with pytest.raises(OccError, match='ended with code -9'):
        world.step()
    world.crew.close()


def test_an_error_in_the_callers_share_leaves_the_crew_in_step():
    world = Marked(4, processes=2)

    def fail(_):
        raise ValueError('mine')

    with pytest.raises(ValueError, match='mine'):
        world.crew.share(world.costs, fail)
    assert world.times.tolist() == [0, 0, 1, 1]
    world.step()
    assert world.times.tolist() == [1, 1, 2, 2]
    world.crew.close()


@pytest.mark.parametrize('given_up', [False, True])
def test_helpers_end_with_the_crew(given_up):
    world = Marked(4, processes=2)
    world.step()
    helper = int(world.process[-1])
    assert _runs(helper)
    if given_up:
        del world
        gc.collect()
    else:
        world.crew.close()
        world.crew.close()
    assert _ends(helper)


@pytest.mark.parametrize('number', [signal.SIGKILL, signal.SIGINT])
def test_helpers_end_when_the_program_does(number, tmp_path):
    program = (
        'import time; from test_crew import Marked\n'
        'world = Marked(4, processes=2); world.step()\n'
        'print(world.process[-1], flush=True); time.sleep(60)'
    )
    running = subprocess.Popen(
        [sys.executable, '-c', program],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        cwd=Path(__file__).parent,
        text=True,
    )
    helper = int(running.stdout.readline())
    assert _runs(helper)
    # It sleeps by now, and Ctrl-C goes to all that the terminal runs in the foreground.
    running.send_signal(number)
    running.communicate(timeout=30)
    assert _ends(helper)


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
