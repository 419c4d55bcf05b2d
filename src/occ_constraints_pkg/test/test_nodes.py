# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Monitor and gate start and end with what apt has; needs rclpy."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip('rclpy')
PACKAGE = Path(__file__).resolve().parents[1]
READY = {'monitor': 'waiting for rules on /constraints', 'gate': 'STOP: no verdict yet'}


def start(name, *arguments):
    return subprocess.Popen(
        [sys.executable, PACKAGE / 'scripts' / name, *arguments],
        env={**os.environ, 'ROS_AUTOMATIC_DISCOVERY_RANGE': 'OFF'},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )


@pytest.mark.parametrize('name', READY)
def test_a_node_says_what_it_waits_for_and_ends_on_ctrl_c(name):
    with start(name) as process:
        for line in process.stdout:
            if READY[name] in line:
                process.send_signal(signal.SIGINT)
        assert process.wait(30) == 0


@pytest.mark.parametrize('name', READY)
def test_a_misspelled_parameter_ends_it_with_one_sentence(name):
    with start(name, '--ros-args', '-p', 'timeot:=1.0') as process:
        text, _ = process.communicate(timeout=60)
        assert process.returncode == 2
    assert "did you mean 'timeout'?" in text
    assert 'Traceback' not in text
