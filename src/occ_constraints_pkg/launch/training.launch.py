# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Train a policy in a simulated world, with the monitor's costs as its constraint."""

from pathlib import Path

from launch import LaunchDescription, LaunchDescriptionEntity
from occ_constraints_pkg.ros.launching import (
    COMMON,
    RESPAWN,
    Argument,
    Values,
    description,
    include,
    node,
)

ARGUMENTS = (
    *COMMON,
    RESPAWN,
    Argument('constraints_file', 'Constraints file whose rules give the cost.', 'path', None),
    Argument('output', 'Folder for the policy, the checkpoints and the metrics.', 'path', None),
    Argument(
        'world',
        'World to simulate, such as simple_nav, PointGoal1 or CarPush1.',
        default='PointGoal1',
        parameter='sim.world',
    ),
    Argument(
        'num_robots',
        'Number of robots that gather experience side by side.',
        'count',
        default='128',
        parameter='sim.num_robots',
    ),
    Argument('seed', 'Seed of the world and of the learner.', 'count'),
    Argument('total_steps', 'Robot steps after which training ends, and the launch.', 'count'),
    Argument('cost_limit', 'Mean cost per episode to stay under.', 'number'),
    Argument(
        'resume', 'Go on from the checkpoint in output, if there is one: true or false.', 'truth'
    ),
)


def start(values: Values) -> list[LaunchDescriptionEntity]:
    """Return simulation, monitor and learner; the launch ends with the learner."""
    common = [item.name for item in (*COMMON, RESPAWN)]
    folder = Path(__file__).parent
    simulation = values.texts(*common, 'world', 'num_robots', 'seed', policy='none')
    monitor = values.texts(*common, 'constraints_file', gate='false')
    names = ('output', 'seed', 'total_steps', 'cost_limit', 'resume')
    return [
        include(folder / 'simulation.launch.py', simulation),
        include(folder / 'monitor.launch.py', monitor),
        node('constrained_learner', values, {name: values[name] for name in names}),
    ]


def generate_launch_description() -> LaunchDescription:
    """Return the description that ROS 2 launch asks for."""
    return description(ARGUMENTS, start)
