# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Start the monitor, which checks the rules of a constraints file, and the gate if wanted."""

from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, GroupAction, OpaqueFunction
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node, PushROSNamespace, SetParameter
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare

PACKAGE = 'occ_constraints_pkg'


def start_monitor(context: LaunchContext) -> list[Node]:
    """Return the node; an argument that was left empty does not hide the parameter file's value."""
    parameters = [LaunchConfiguration('params_file')]
    constraints_file = LaunchConfiguration('constraints_file').perform(context)
    if constraints_file:
        parameters.append({'constraints_file': constraints_file})
    return [
        Node(
            package=PACKAGE,
            executable='monitor',
            name='monitor',
            output='screen',
            parameters=parameters,
            arguments=['--ros-args', '--log-level', LaunchConfiguration('log_level')],
        )
    ]


def generate_launch_description() -> LaunchDescription:
    """Return the description that ROS 2 launch asks for."""
    return LaunchDescription(
        [
            DeclareLaunchArgument(
                'namespace',
                default_value='',
                description='Namespace of the nodes and their topics, one for each robot.',
            ),
            DeclareLaunchArgument(
                'use_sim_time',
                default_value='false',
                description='Take the time from /clock: true or false.',
            ),
            DeclareLaunchArgument(
                'params_file',
                default_value=PathJoinSubstitution(
                    [FindPackageShare(PACKAGE), 'config', 'params.yaml']
                ),
                description='YAML file with the parameters of the nodes.',
            ),
            DeclareLaunchArgument(
                'constraints_file',
                default_value='',
                description='Constraints file to check; empty: the one that params_file names, '
                'or else the one that arrives on the topic constraints.',
            ),
            DeclareLaunchArgument(
                'gate',
                default_value='false',
                description='Also start the gate, which slows and stops the robot: true or false.',
            ),
            DeclareLaunchArgument(
                'stamped',
                default_value='false',
                description='With gate: commands are TwistStamped, not Twist: true or false.',
            ),
            DeclareLaunchArgument(
                'cmd_vel_in',
                default_value='cmd_vel_in',
                description='With gate: topic of the commands, as from a navigation stack.',
            ),
            DeclareLaunchArgument(
                'cmd_vel',
                default_value='cmd_vel',
                description='With gate: topic that the base of the robot listens to.',
            ),
            DeclareLaunchArgument(
                'log_level',
                default_value='info',
                description='Least level to log: debug, info, warn, error or fatal.',
            ),
            GroupAction(
                [
                    PushROSNamespace(LaunchConfiguration('namespace')),
                    SetParameter('use_sim_time', LaunchConfiguration('use_sim_time')),
                    OpaqueFunction(function=start_monitor),
                    Node(
                        package=PACKAGE,
                        executable='gate',
                        name='gate',
                        output='screen',
                        condition=IfCondition(LaunchConfiguration('gate')),
                        parameters=[
                            LaunchConfiguration('params_file'),
                            {
                                'stamped': ParameterValue(
                                    LaunchConfiguration('stamped'), value_type=bool
                                )
                            },
                        ],
                        remappings=[
                            ('cmd_vel_in', LaunchConfiguration('cmd_vel_in')),
                            ('cmd_vel', LaunchConfiguration('cmd_vel')),
                        ],
                        arguments=['--ros-args', '--log-level', LaunchConfiguration('log_level')],
                    ),
                ]
            ),
        ]
    )
