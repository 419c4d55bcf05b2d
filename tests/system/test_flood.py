# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""A node that gets more messages than it can handle still ends when it is asked to."""

import signal
import subprocess
import sys

import pytest
from occ_constraints_pkg.demo.processes import environment
from occ_constraints_pkg.rosbag.recording import Recording

# Publishes as fast as it can, until it is killed.
FLOOD = """
import rclpy
from rclpy.qos import QoSProfile, ReliabilityPolicy
from std_msgs.msg import Float64

rclpy.init()
profile = QoSProfile(depth=1000, reliability=ReliabilityPolicy.BEST_EFFORT)
publisher = rclpy.create_node('flood').create_publisher(Float64, 'flood', profile)
message = Float64()
while True:
    publisher.publish(message)
"""


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_a_node_ends_in_a_flood_of_messages(nodes, observer, number):
    bag = nodes.folder / 'bag'
    recorder = nodes.start('recorder', output=bag, topics=['flood'], compression='none')
    command, environ = [sys.executable, '-c', FLOOD], environment(nodes.domain)
    floods = [subprocess.Popen(command, env=environ) for _ in range(2)]
    try:

        def written():
            return sum(file.stat().st_size for file in bag.glob('*.mcap'))

        # Many messages, so that more have piled up.
        observer.spin_until(lambda: written() > 1_000_000)
        nodes.stop(recorder, number=number)
    finally:
        for flood in floods:
            flood.kill()
            flood.wait()
    assert Recording(bag).message_count > 0
