# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""A process that speaks or listens in the ROS domain and reports in JSON, a line for each stage.

``python -m occ_constraints_pkg.doctor.probe speak|hear|survey TOPIC SECONDS``. To survey is to
hear, and then to list who else is there. It ends by itself, also when its parent has gone.
"""

from __future__ import annotations

import json
import math
import os
import sys
import time
from typing import Any

PUBLISHED_HERE = {
    'violation': 'diagnostic_msgs/msg/DiagnosticArray',
    'costs': 'sensor_msgs/msg/PointCloud2',
    'cost': 'std_msgs/msg/Float64',
    'margin': 'std_msgs/msg/Float64',
    'constraints': 'std_msgs/msg/String',
    'rules': 'std_msgs/msg/String',
}
"""Topics of ours, each with exactly one publisher, by the end of the name, and their types."""
_LOOK_SECONDS, _SPEAK_SECONDS = 0.05, 0.05
# How long nodes that are there may take to be found, and to answer. When their first announcements
# are lost, the next ones come after 3 s.
_FOUND_SECONDS, _ANSWER_SECONDS = 4.0, 0.8
_MOST_NODES = 20


def main(argv: list[str]) -> int:
    """Run as one side; return the exit code."""
    mode, topic, seconds = argv[0], argv[1], float(argv[2])
    import rclpy
    from rclpy.node import Node

    rclpy.init(args=[])
    name = f'_occ_doctor_{os.getpid()}'
    node = Node(name, enable_rosout=False, start_parameter_services=False)
    _report(
        {
            'rmw': rclpy.get_rmw_implementation_identifier(),
            'rclpy': str(rclpy.__file__),
            'has_events_executor': _has_events_executor(),
        }
    )
    try:
        if mode == 'speak':
            _speak(node, topic, seconds)
        else:
            _listen(node, topic, seconds, surveys=mode == 'survey')
    finally:
        node.destroy_node()
        rclpy.try_shutdown()
    return 0


def _has_events_executor() -> bool:
    try:
        from rclpy.experimental import EventsExecutor
    except ImportError:
        return False
    return EventsExecutor is not None


def _speak(node: Any, topic: str, seconds: float) -> None:
    from std_msgs.msg import String

    parent, end = os.getppid(), time.monotonic() + seconds
    publisher = node.create_publisher(String, topic, 10)
    while time.monotonic() < end and os.getppid() == parent:
        publisher.publish(String(data=topic))
        time.sleep(_SPEAK_SECONDS)


def _listen(node: Any, topic: str, seconds: float, *, surveys: bool) -> None:
    import rclpy
    from rclpy.qos import QoSProfile, ReliabilityPolicy
    from rosgraph_msgs.msg import Clock
    from std_msgs.msg import String

    begin = time.monotonic()
    heard: list[float] = []
    clock: list[tuple[float, float]] = []

    def on_clock(message: Clock) -> None:
        clock.append((time.monotonic(), message.clock.sec + message.clock.nanosec * 1e-9))

    def wait(until: float, done: Any) -> None:
        while not done() and (left := until - time.monotonic()) > 0:
            rclpy.spin_once(node, timeout_sec=min(left, _LOOK_SECONDS))

    best_effort = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)
    node.create_subscription(String, topic, lambda _: heard.append(time.monotonic() - begin), 10)
    node.create_subscription(Clock, '/clock', on_clock, best_effort)
    wait(begin + seconds, lambda: heard)
    _report({'heard_after_s': heard[0] if heard else None})
    if not surveys:
        return
    wait(begin + _FOUND_SECONDS, lambda: False)
    offsets = _listen_to_verdicts(node, best_effort)
    answers = _ask_for_sim_time(node)
    wait(time.monotonic() + _ANSWER_SECONDS, lambda: False)
    _report(
        {
            'nodes': [f'{space.rstrip("/")}/{one}' for one, space in _nodes(node)],
            'topics': _topics(node),
            'clock_publishers': _publishers(node, '/clock'),
            'clock_messages': len(clock),
            'clock_advanced_s': clock[-1][1] - clock[0][1] if clock else None,
            'clock_took_s': clock[-1][0] - clock[0][0] if clock else None,
            'use_sim_time': {
                name: future.result().values[0].bool_value
                for name, future in answers.items()
                if future.done() and future.result() and future.result().values
            },
            'behind_s': {name: value for name, value in offsets.items() if math.isfinite(value)},
        }
    )


def _nodes(node: Any) -> list[tuple[str, str]]:
    found = node.get_node_names_and_namespaces()
    return [(name, space) for name, space in found if not name.startswith('_occ_')]


def _topics(node: Any) -> dict[str, dict[str, Any]]:
    """Return types and publishers of the topics of ours, and of the commands behind a gate."""
    return {
        topic: {'types': types, 'publishers': _publishers(node, topic)}
        for topic, types in node.get_topic_names_and_types()
        if topic.rpartition('/')[2] in (*PUBLISHED_HERE, 'cmd_vel')
    }


def _publishers(node: Any, topic: str) -> list[str]:
    infos = node.get_publishers_info_by_topic(topic)
    return sorted(f'{item.node_namespace.rstrip("/")}/{item.node_name}' for item in infos)


def _listen_to_verdicts(node: Any, qos: Any) -> dict[str, float]:
    """Return, growing, by how much the clocks of those who publish verdicts are behind ours."""
    from diagnostic_msgs.msg import DiagnosticArray

    offsets: dict[str, float] = {}
    for topic, types in node.get_topic_names_and_types():
        if not topic.endswith('/violation') or types != [PUBLISHED_HERE['violation']]:
            continue
        offsets[topic] = math.inf

        def on_message(_: Any, info: Any, topic: str = topic) -> None:
            behind = (info['received_timestamp'] - info['source_timestamp']) / 1e9
            offsets[topic] = min(offsets[topic], behind)

        node.create_subscription(DiagnosticArray, topic, on_message, qos)
    return offsets


def _ask_for_sim_time(node: Any) -> dict[str, Any]:
    """Ask the monitors and gates whether they live in simulated time; return the answers to be."""
    from rcl_interfaces.srv import GetParameters

    services = {name for name, _ in node.get_service_names_and_types()}
    ours = {
        publisher
        for topic in _topics(node)
        if topic.endswith(('/violation', '/cmd_vel'))
        for publisher in _publishers(node, topic)
    }
    names = sorted(name for name in ours if f'{name}/get_parameters' in services)[:_MOST_NODES]
    request = GetParameters.Request(names=['use_sim_time'])
    return {
        name: node.create_client(GetParameters, f'{name}/get_parameters').call_async(request)
        for name in names
    }


def _report(facts: dict[str, Any]) -> None:
    print(json.dumps(facts), flush=True)


if __name__ == '__main__':
    sys.exit(main(sys.argv[1:]))
