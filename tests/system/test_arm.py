# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The arm of the second tutorial, live: recorded, and judged when a box stands in its way."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from occ_constraints_pkg.demo.processes import environment
from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.rosbag.recording import Recording
from occ_constraints_pkg.stopping import PARENT_VARIABLE

pytest.importorskip('mujoco', reason="needs the extra 'train'")
TOPICS = ('/joint_commands', '/wrist/wrench', '/joint_states')
SCRIPT = Path(__file__).parents[2] / 'scripts' / 'arm.py'
# Messages of a topic until its recording runs evenly.
SETTLING = 50


def start_arm(nodes, *arguments):
    variables = {**environment(nodes.domain), PARENT_VARIABLE: str(os.getpid())}
    return subprocess.Popen([sys.executable, SCRIPT, *arguments], env=variables)


def run_arm(*arguments):
    return subprocess.run(
        [sys.executable, SCRIPT, *map(str, arguments)], capture_output=True, text=True, timeout=120
    )


def test_a_box_in_the_way_is_a_violation(nodes, observer, run_occ):
    folder = nodes.folder
    assert run_arm('--bag', folder / 'safe', '--count', 3).returncode == 0
    safe = ' '.join(str(folder / f'safe_{number:02}') for number in (1, 2, 3))
    assert run_occ(f'features suggest {safe} -o {folder}/arm.yaml')[0] == 0
    code, _, error = run_occ(f'learn {safe} -m {folder}/arm.yaml -o {folder}/constraints.yaml')
    assert code == 0, error

    nodes.start('monitor', constraints_file=folder / 'constraints.yaml')
    arm = start_arm(nodes, '--seed', '2', '--box-at', '0')
    try:
        observer.spin_until(lambda: 'wrench_force above' in told(observer))
    finally:
        arm.send_signal(signal.SIGINT)
        assert arm.wait(30) == 0


def told(observer):
    return ' '.join(
        status.message
        for message in observer.heard.violations.values()
        for status in message.status
    )


def test_what_is_recorded_live_is_what_is_written_without_ros(nodes, observer):
    bag = nodes.folder / 'live'
    recorder = nodes.start('recorder', output=bag, topics=list(TOPICS))
    arm = start_arm(nodes, '--seed', '4')
    try:
        # The recorder flushes several times a second, so what has come can be read.
        observer.spin_until(lambda: has_begun(bag))
    finally:
        arm.send_signal(signal.SIGINT)
        assert arm.wait(30) == 0
    nodes.stop(recorder)
    assert run_arm('--bag', nodes.folder / 'dry', '--seed', 4).returncode == 0
    live, dry = (readings(nodes.folder / name) for name in ('live', 'dry'))
    assert {topic: len(found) for topic, found in dry.items()} == dict.fromkeys(TOPICS, 1500)
    for topic in TOPICS:
        # While a topic is being found, some messages are missed.
        found = live[topic][SETTLING:]
        begin = dry[topic].index(found[0])
        assert found == dry[topic][begin : begin + len(found)]
        assert set(live[topic]) <= set(dry[topic])


def has_begun(bag):
    try:
        return all(len(found) > 2 * SETTLING for found in readings(bag).values())
    except OccError:
        # Of a recording without messages nothing can be read.
        return False


def readings(bag):
    """Return the messages of each topic of the arm without their stamps."""
    found = {topic: [] for topic in TOPICS}
    for message in Recording(bag).messages(TOPICS):
        # Four bytes of encapsulation, eight of the stamp.
        found[message.topic].append(bytes(message.data[12:]))
    return found


def test_mistakes(tmp_path):
    assert run_arm('--bag', tmp_path / 'one', '--seconds', 0.1).returncode == 0
    again = run_arm('--bag', tmp_path / 'one', '--seconds', 0.1)
    assert (again.returncode, again.stderr) == (
        2,
        f'error: {tmp_path}/one exists already; allowed is a new directory for each recording\n',
    )
    assert run_arm('--count', 2).returncode == 2
