# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Train a policy in a simulated world, with the monitor's costs as its constraint."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, GroupAction, IncludeLaunchDescription
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution, ThisLaunchFileDir
from launch_ros.actions import Node, PushROSNamespace
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare

PACKAGE = 'occ_constraints_pkg'


def include(name: str, *arguments: str, **fixed: str) -> IncludeLaunchDescription:
    """Return another launch file of this folder, with arguments handed on and fixed ones."""
    values = {argument: LaunchConfiguration(argument) for argument in arguments} | fixed
    return IncludeLaunchDescription(
        PathJoinSubstitution([ThisLaunchFileDir(), name]), launch_arguments=values.items()
    )


def generate_launch_description() -> LaunchDescription:
    """Return the description that ROS 2 launch asks for."""
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
                'constraints_file', description='Constraints file whose rules give the cost.'
            ),
            DeclareLaunchArgument(
                'output', description='Folder for the policy, the checkpoints and the metrics.'
            ),
            DeclareLaunchArgument(
                'world',
                default_value='PointGoal1',
                description='World to simulate, such as simple_nav, PointGoal1 or CarPush1.',
            ),
            DeclareLaunchArgument(
                'num_robots',
                default_value='128',
                description='Number of robots that gather experience side by side.',
            ),
            DeclareLaunchArgument(
                'seed', default_value='0', description='Seed of the world and of the learner.'
            ),
            DeclareLaunchArgument(
                'log_level',
                default_value='info',
                description='Least level to log: debug, info, warn, error or fatal.',
            ),
            include(
                'simulation.launch.py',
                'namespace',
                'params_file',
                'world',
                'num_robots',
                'seed',
                'log_level',
                policy='none',
            ),
            include(
                'monitor.launch.py',
                'namespace',
                'params_file',
                'constraints_file',
                'log_level',
                use_sim_time='false',
            ),
            GroupAction(
                [
                    PushROSNamespace(LaunchConfiguration('namespace')),
                    Node(
                        package=PACKAGE,
                        executable='constrained_learner',
                        name='constrained_learner',
                        output='screen',
                        parameters=[
                            LaunchConfiguration('params_file'),
                            {
                                'output': ParameterValue(
                                    LaunchConfiguration('output'), value_type=str
                                ),
                                'seed': ParameterValue(LaunchConfiguration('seed'), value_type=int),
                            },
                        ],
                        arguments=['--ros-args', '--log-level', LaunchConfiguration('log_level')],
                    ),
                ]
            ),
        ]
    )
