# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""A simulation whose robots several processes step."""

import os
import signal
from pathlib import Path

import pytest

pytest.importorskip('mujoco', reason="needs the extra 'train'")


@pytest.fixture
def started(nodes, observer):
    """Return the simulation, once it steps, and the id of its helping process."""
    nodes.start('policy', policy='straightv')
    sim = nodes.start('sim', world='PointGoal1', num_robots=4, processes=2, wait_for_subscribers=2)
    observer.spin_until(lambda: len(observer.heard.true_cost) >= 10)
    return sim, *_children(sim.pid)


def test_ends_cleanly_with_its_helper(nodes, started):
    sim, helper = started
    nodes.stop(sim)
    assert not Path(f'/proc/{helper}').exists()


def test_says_so_and_ends_when_its_helper_is_gone(nodes, started):
    sim, helper = started
    os.kill(helper, signal.SIGKILL)
    assert sim.join() == 2
    assert 'a process that steps robots of this world has ended with code -9' in sim.last_words()
    nodes.started.remove(sim)


def test_ends_cleanly_when_its_helper_sleeps(nodes, observer, started):
    sim, helper = started
    os.kill(helper, signal.SIGSTOP)
    steps = -1

    def stands():
        nonlocal steps
        before, steps = steps, len(observer.heard.true_cost)
        return steps == before

    # It waits for the helper, if nothing comes for long; otherwise this shows less, but holds.
    while not stands():
        observer.spin(1.0)
    nodes.stop(sim)
    assert not Path(f'/proc/{helper}').exists()


def _children(process):
    children = []
    for entry in Path('/proc').glob('[0-9]*/stat'):
        try:
            parent = entry.read_text(encoding='ascii').rsplit(') ', 1)[1].split()[1]
        except (FileNotFoundError, ProcessLookupError):
            continue
        if int(parent) == process:
            children.append(int(entry.parent.name))
    return children
