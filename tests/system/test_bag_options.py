# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""``occ record`` and ``occ play`` with the options of ``ros2 bag``, as processes of their own."""

import signal
import subprocess
import sys
from pathlib import Path

from occ_constraints_pkg.demo.processes import environment
from occ_constraints_pkg.rosbag.recording import Recording

BAG = Path(__file__).parents[2] / 'bags' / 'simple_nav_straight'


def test_a_bag_is_played_under_other_names_and_recorded_by_them(nodes, tmp_path):
    def occ(line):
        return subprocess.Popen(
            [sys.executable, '-m', 'occ_constraints_pkg', *line.split()],
            cwd=tmp_path,
            env=environment(nodes.domain),
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
        )

    record = occ('record --topics /left /right --exclude-topics /right -o bag --node-name mine')
    try:
        play = occ(
            f'play {BAG} --topics /observation /action --remap /observation:=/left '
            '/action:=/right --rate 20 --wait-for-subscribers 1'
        )
        assert (play.wait(60), 'Traceback' in play.stderr.read()) == (0, False)
    finally:
        record.send_signal(signal.SIGINT)
    assert (record.wait(30), '[mine]' in record.stderr.read()) == (0, True)
    recorded = Recording(tmp_path / 'bag')
    assert list(recorded.topics) == ['/left']
    assert recorded.message_count == sum(1 for _ in Recording(BAG).messages(['/observation']))
