# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Record demonstrations in a simulated world for a while, then learn their rules from the bag."""

import signal

from launch import LaunchDescription
from launch.actions import (
    DeclareLaunchArgument,
    EmitEvent,
    GroupAction,
    IncludeLaunchDescription,
    RegisterEventHandler,
    TimerAction,
)
from launch.event_handlers import OnProcessExit
from launch.events import matches_action
from launch.events.process import SignalProcess
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution, ThisLaunchFileDir
from launch_ros.actions import Node, PushROSNamespace
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare

PACKAGE = 'occ_constraints_pkg'


def generate_launch_description() -> LaunchDescription:
    """Return the description that ROS 2 launch asks for."""
    namespace = LaunchConfiguration('namespace')
    params_file = LaunchConfiguration('params_file')
    log_arguments = ['--ros-args', '--log-level', LaunchConfiguration('log_level')]
    recorder = Node(
        package=PACKAGE,
        executable='recorder',
        name='recorder',
        namespace=namespace,
        output='screen',
        parameters=[
            params_file,
            {'output': ParameterValue(LaunchConfiguration('bag'), value_type=str)},
        ],
        arguments=log_arguments,
    )
    tree_learner = GroupAction(
        [
            PushROSNamespace(namespace),
            Node(
                package=PACKAGE,
                executable='tree_learner',
                name='tree_learner',
                output='screen',
                parameters=[
                    params_file,
                    {
                        # Two brackets: a list of one text, not a text put together from a list.
                        'bags': [[LaunchConfiguration('bag')]],
                        'feature_map': ParameterValue(
                            LaunchConfiguration('feature_map'), value_type=str
                        ),
                        'output': ParameterValue(
                            LaunchConfiguration('constraints_file'), value_type=str
                        ),
                    },
                ],
                arguments=log_arguments,
            ),
        ]
    )
    return LaunchDescription(
        [
            DeclareLaunchArgument(
                'namespace', default_value='', description='Namespace of the nodes and topics.'
            ),
            DeclareLaunchArgument(
                'params_file',
                default_value=PathJoinSubstitution(
                    [FindPackageShare(PACKAGE), 'config', 'params.yaml']
                ),
                description='YAML file with the parameters of the nodes.',
            ),
            DeclareLaunchArgument(
                'bag', description='Folder of the bag to record; it must not exist yet.'
            ),
            DeclareLaunchArgument(
                'feature_map', description='Feature map, a YAML file or a built-in name.'
            ),
            DeclareLaunchArgument('constraints_file', description='Constraints file to write.'),
            DeclareLaunchArgument(
                'duration', default_value='60.0', description='Seconds to record.'
            ),
            DeclareLaunchArgument(
                'world',
                default_value='PointGoal1',
                description='World to simulate, such as simple_nav, PointGoal1 or CarPush1.',
            ),
            DeclareLaunchArgument(
                'num_robots', default_value='16', description='Number of robots to record.'
            ),
            DeclareLaunchArgument(
                'seed', default_value='0', description='Seed of the world and of the policy.'
            ),
            DeclareLaunchArgument(
                'policy',
                default_value='expert',
                description='What demonstrates: expert, or a policy file (.npz).',
            ),
            DeclareLaunchArgument(
                'log_level',
                default_value='info',
                description='Least level to log: debug, info, warn, error or fatal.',
            ),
            IncludeLaunchDescription(
                PathJoinSubstitution([ThisLaunchFileDir(), 'simulation.launch.py']),
                launch_arguments={
                    name: LaunchConfiguration(name)
                    for name in (
                        'namespace',
                        'params_file',
                        'world',
                        'num_robots',
                        'seed',
                        'policy',
                        'log_level',
                    )
                }.items(),
            ),
            recorder,
            # The recorder closes the bag on SIGINT; the learner must not open it before.
            TimerAction(
                period=LaunchConfiguration('duration'),
                actions=[
                    EmitEvent(
                        event=SignalProcess(
                            signal_number=signal.SIGINT, process_matcher=matches_action(recorder)
                        )
                    )
                ],
            ),
            RegisterEventHandler(OnProcessExit(target_action=recorder, on_exit=[tree_learner])),
        ]
    )
