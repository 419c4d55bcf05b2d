# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""What ``--help`` prints for a node: its parameters, topics and services."""

from __future__ import annotations

import io
import sys
from collections.abc import Callable, Sequence
from contextlib import redirect_stdout

_TOPICS = {
    'sim': {
        'subscribes': 'action (or cmd_vel)',
        'publishes': 'observation, odom, imu, scan/..., scene, /tf or transform, /clock',
    },
    'policy': {'subscribes': 'observation, costs', 'publishes': 'action'},
    'recorder': {'subscribes': 'the topics that it records'},
    'player': {
        'publishes': 'the topics of the recording, /clock',
        'services': '~/pause, ~/resume, ~/toggle_paused (std_srvs/Trigger)',
    },
    'tree_learner': {
        'subscribes': 'the topics of the feature map',
        'publishes': 'constraints',
        'services': '~/learn (std_srvs/Trigger)',
    },
    'monitor': {
        'subscribes': 'the topics of the feature map, constraints',
        'publishes': 'costs, cost, margin, time_to_violation, violation, features, rules, '
        'rule_stats, markers, /diagnostics',
        'services': '~/prune, ~/reset_stats (std_srvs/Trigger), ~/enable (std_srvs/SetBool), and '
        'those of a lifecycle node',
    },
    'gate': {'subscribes': 'cmd_vel_in, violation', 'publishes': 'cmd_vel, ~/state, /diagnostics'},
    'event_recorder': {
        'subscribes': 'violation, rules, features, gate/state, and what it records',
        'publishes': 'events, /diagnostics',
        'services': '~/trigger (std_srvs/Trigger)',
    },
    'constrained_learner': {
        'subscribes': 'observation, costs, action',
        'publishes': 'action, training',
    },
    'dashboard': {
        'subscribes': 'violation, features, rules, rule_stats and events of all namespaces, '
        '~/state of gates, /diagnostics',
    },
}


def asks_for_help(argv: Sequence[str]) -> bool:
    """Return whether a command line wants to know about a node, not to run it."""
    return not {'-h', '--help'}.isdisjoint(argv)


def print_help(name: str, main: Callable[[list[str]], int]) -> int:
    """Print what a user needs to start a node; return the exit code.

    Args:
        name: of the node.
        main: its ``main``, which prints the parameters.
    """
    about = sys.modules[main.__module__].__doc__.partition('``: ')[2].strip()
    # In one piece, for a reader such as `head` may close the pipe after its first lines.
    with redirect_stdout(io.StringIO()) as text:
        print(f'{name}: {about}\n')
        print('Parameters and their defaults, for -p NAME:=VALUE after')
        print(f'`occ node {name}` or `ros2 run occ_constraints_pkg {name} --ros-args`:\n')
        code = main(['--help'])
        print()
        for kind, names in _TOPICS[name].items():
            print(f'{kind.capitalize()}: {names}')
        print(
            '\nFurther arguments are those of ROS, such as -r FROM:=TO, -r __ns:=/NAMESPACE, '
            '-r __node:=NAME,\n--params-file FILE. All is explained in docs/nodes.md.'
        )
    print(text.getvalue(), end='')
    return code
