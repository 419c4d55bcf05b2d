# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Start a simulated world and, unless told otherwise, a policy that drives in it."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, GroupAction
from launch.conditions import IfCondition
from launch.substitutions import (
    LaunchConfiguration,
    NotEqualsSubstitution,
    PathJoinSubstitution,
)
from launch_ros.actions import Node, PushROSNamespace
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare

PACKAGE = 'occ_constraints_pkg'


def generate_launch_description() -> LaunchDescription:
    """Return the description that ROS 2 launch asks for."""
    seed = ParameterValue(LaunchConfiguration('seed'), value_type=int)
    log_arguments = ['--ros-args', '--log-level', LaunchConfiguration('log_level')]
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
                'world',
                default_value='PointGoal1',
                description='World to simulate, such as simple_nav, PointGoal1 or CarPush1.',
            ),
            DeclareLaunchArgument(
                'num_robots',
                default_value='1',
                description='Number of robots; each is one row of every table.',
            ),
            DeclareLaunchArgument(
                'seed', default_value='0', description='Seed of the world and of the policy.'
            ),
            DeclareLaunchArgument(
                'policy',
                default_value='expert',
                description='What drives: expert, random, a policy file (.npz), or none to leave '
                'it to a node started elsewhere.',
            ),
            DeclareLaunchArgument(
                'log_level',
                default_value='info',
                description='Least level to log: debug, info, warn, error or fatal.',
            ),
            GroupAction(
                [
                    PushROSNamespace(LaunchConfiguration('namespace')),
                    Node(
                        package=PACKAGE,
                        executable='sim',
                        name='sim',
                        output='screen',
                        parameters=[
                            LaunchConfiguration('params_file'),
                            {
                                'world': ParameterValue(
                                    LaunchConfiguration('world'), value_type=str
                                ),
                                'seed': seed,
                                'num_robots': ParameterValue(
                                    LaunchConfiguration('num_robots'), value_type=int
                                ),
                            },
                        ],
                        arguments=log_arguments,
                    ),
                    Node(
                        package=PACKAGE,
                        executable='policy',
                        name='policy',
                        output='screen',
                        condition=IfCondition(
                            NotEqualsSubstitution(LaunchConfiguration('policy'), 'none')
                        ),
                        parameters=[
                            LaunchConfiguration('params_file'),
                            {
                                'policy': ParameterValue(
                                    LaunchConfiguration('policy'), value_type=str
                                ),
                                'seed': seed,
                            },
                        ],
                        arguments=log_arguments,
                    ),
                ]
            ),
        ]
    )
