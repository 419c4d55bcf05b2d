# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Start the monitor, which checks the rules of a constraints file, and the gate if wanted."""

from launch import LaunchDescription, LaunchDescriptionEntity
from occ_constraints_pkg.ros.launching import (
    COMMON,
    RESPAWN,
    Argument,
    Values,
    description,
    node,
)

ARGUMENTS = (
    *COMMON,
    RESPAWN,
    Argument(
        'constraints_file',
        'Constraints file to check; empty: the one that params_file names, or else the one that '
        'arrives on the topic constraints.',
        'path',
    ),
    Argument(
        'autostart',
        'Let the monitor configure and activate itself; false: leave that to a lifecycle manager.',
        'truth',
    ),
    Argument(
        'gate',
        'Also start the gate, which slows and stops the robot: true or false.',
        'truth',
        default='false',
    ),
    Argument('stamped', 'With gate: commands are TwistStamped, not Twist: true or false.', 'truth'),
    Argument(
        'cmd_vel_in',
        'With gate: topic of the commands, as from a navigation stack.',
        default='cmd_vel_in',
    ),
    Argument(
        'cmd_vel', 'With gate: topic that the base of the robot listens to.', default='cmd_vel'
    ),
)


def start(values: Values) -> list[LaunchDescriptionEntity]:
    """Return the monitor and perhaps the gate."""
    monitor = node(
        'monitor',
        values,
        {'constraints_file': values['constraints_file'], 'autostart': values['autostart']},
    )
    if not values['gate']:
        return [monitor]
    remappings = [(name, values[name]) for name in ('cmd_vel_in', 'cmd_vel') if values[name]]
    return [
        monitor,
        node('gate', values, {'stamped': values['stamped']}, remappings=remappings),
    ]


def generate_launch_description() -> LaunchDescription:
    """Return the description that ROS 2 launch asks for."""
    return description(ARGUMENTS, start)
