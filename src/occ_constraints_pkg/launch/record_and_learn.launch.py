# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Record demonstrations in a simulated world for a while, then learn their rules from the bag."""

from pathlib import Path

from launch import LaunchDescription, LaunchDescriptionEntity
from occ_constraints_pkg.errors import ConfigurationError
from occ_constraints_pkg.ros.launching import (
    COMMON,
    Argument,
    Values,
    description,
    include,
    node,
)

ARGUMENTS = (
    *COMMON,
    Argument('bag', 'Folder of the bag to record; it must not exist yet.', 'path', None),
    Argument('feature_map', 'Feature map, a YAML file or a built-in name.', 'path', None),
    Argument('constraints_file', 'Constraints file to write.', 'path', None),
    Argument('duration', 'Seconds to record, from the first message.', 'seconds', '60.0'),
    Argument('topics', 'Topics to record, separated by commas; empty: all.', 'texts'),
    Argument(
        'world',
        'World to simulate, such as simple_nav, PointGoal1 or CarPush1.',
        default='PointGoal1',
        parameter='sim.world',
    ),
    Argument(
        'num_robots',
        'Number of robots to record.',
        'count',
        default='16',
        parameter='sim.num_robots',
    ),
    Argument('seed', 'Seed of the world and of the policy.', 'count'),
    Argument(
        'policy',
        'What demonstrates: expert, or a policy file (.npz).',
        default='expert',
        parameter='policy.policy',
    ),
)


def check(values: Values) -> None:
    """Find out now what would fail only once everything is recorded.

    Raises:
        OccError: something would.
    """
    if Path(values['bag']).exists():
        raise ConfigurationError(f'{values["bag"]} exists already; allowed is a new folder')
    folder = Path(values['constraints_file']).absolute().parent
    if not folder.is_dir():
        raise ConfigurationError(f'there is no folder {folder} to write the constraints file to')
    try:
        from occ_constraints_pkg.features.feature_map import load_feature_map
    except ImportError:
        # Launch may run outside of the environment that the nodes run in.
        return
    load_feature_map(values['feature_map'])


def start(values: Values) -> list[LaunchDescriptionEntity]:
    """Return the simulation and the recorder, which the learner follows."""
    check(values)

    def learner() -> LaunchDescriptionEntity:
        return node(
            'tree_learner',
            values,
            {
                'bags': [values['bag']],
                'feature_map': values['feature_map'],
                'output': values['constraints_file'],
                'exit_when_done': True,
            },
        )

    recorder = node(
        'recorder',
        values,
        {'output': values['bag'], 'duration': values['duration'], 'topics': values['topics']},
        on_success=learner,
    )
    handed = (*(item.name for item in COMMON), 'world', 'num_robots', 'seed', 'policy')
    simulation = Path(__file__).with_name('simulation.launch.py')
    # It waits for the recorder, too: nothing that is to be recorded is missed.
    return [include(simulation, values.texts(*handed)), recorder]


def generate_launch_description() -> LaunchDescription:
    """Return the description that ROS 2 launch asks for."""
    return description(ARGUMENTS, start)
