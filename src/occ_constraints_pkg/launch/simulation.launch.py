# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Start a simulated world and, unless told otherwise, a policy that drives in it."""

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
        'world',
        'World to simulate, such as simple_nav, PointGoal1 or CarPush1.',
        default='PointGoal1',
        parameter='sim.world',
    ),
    Argument(
        'num_robots',
        'Number of robots; each is one row of every table.',
        'count',
        default='1',
        parameter='sim.num_robots',
    ),
    Argument('seed', 'Seed of the world and of the policy.', 'count'),
    Argument(
        'policy',
        'What drives: expert, random, a policy file (.npz), or none to leave it to a node '
        'started elsewhere.',
        default='expert',
        parameter='policy.policy',
    ),
    Argument(
        'publish_clock',
        'Let the sim publish /clock: true or false. Default: with use_sim_time:=true.',
        'truth',
    ),
)


def start(values: Values) -> list[LaunchDescriptionEntity]:
    """Return the sim and perhaps a policy."""
    clock = values['publish_clock']
    if clock is None and values['use_sim_time']:
        clock = True
    sim = node(
        'sim',
        # It makes the time that the others live by.
        values.but(use_sim_time=None),
        {
            'world': values['world'],
            'seed': values['seed'],
            'num_robots': values['num_robots'],
            'publish_clock': clock,
        },
        # As navigation stacks do it: the frames of robots in namespaces are told apart by topic.
        remappings=[('/tf', 'tf')],
    )
    if values['policy'] == 'none':
        return [sim]
    return [sim, node('policy', values, {'policy': values['policy'], 'seed': values['seed']})]


def generate_launch_description() -> LaunchDescription:
    """Return the description that ROS 2 launch asks for."""
    return description(ARGUMENTS, start)
