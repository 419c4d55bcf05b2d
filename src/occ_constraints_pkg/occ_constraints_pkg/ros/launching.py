# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""What the launch files share: arguments checked before anything starts, nodes, and ends.

Needs ``launch`` and ``launch_ros`` of ROS 2 Jazzy, which PyPI does not have. A launch file lists
its :class:`Argument` s, and what it starts is a function of their checked :class:`Values`.
"""

from __future__ import annotations

import difflib
import math
import os
from collections.abc import Callable, Mapping, Sequence
from copy import copy
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml
from launch import LaunchContext, LaunchDescription, LaunchDescriptionEntity
from launch.actions import (
    DeclareLaunchArgument,
    IncludeLaunchDescription,
    LogInfo,
    OpaqueFunction,
    Shutdown,
)
from launch.events.process import ProcessExited
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

from occ_constraints_pkg.errors import ConfigurationError
from occ_constraints_pkg.ros.parameter_files import names_for_any_node, names_of_sections

PACKAGE = 'occ_constraints_pkg'
# What a node ends with that was given a mistake, which the next start would find again.
_BAD_INPUT = 2
_RESPAWN_SECONDS = 2.0
_TRUTHS = {'true': True, 'True': True, 'false': False, 'False': False}


@dataclass(frozen=True)
class Argument:
    """An argument of a launch file. One that is not given, or empty, overrides no parameter file.

    Attributes:
        name: as in ``NAME:=VALUE``.
        description: one or more sentences.
        kind: ``text``, ``path``, ``texts`` (separated by commas), ``truth``, ``count`` or
            ``seconds`` (above 0) and ``number``.
        default: its value where it is not given; empty for none, None where it must be given.
        parameter: ``NODE.PARAMETER`` that it sets, whose value in a parameter file goes before
            ``default``; empty for none.
    """

    name: str
    description: str
    kind: str = 'text'
    default: str | None = ''
    parameter: str = ''

    def declaration(self) -> DeclareLaunchArgument:
        """Return the action that declares it."""
        choices = ['', *_TRUTHS] if self.kind == 'truth' else None
        description = self.description
        if self.parameter:
            description += f' Default: that of params_file, else {self.default or "the node’s"}.'
        default = '' if self.parameter else self.default
        return DeclareLaunchArgument(
            self.name, default_value=default, description=description, choices=choices
        )

    def value(self, text: str) -> Any:
        """Return what a text means; None for an empty one.

        Raises:
            OccError: it means nothing.
        """
        if not text:
            if self.default is None:
                raise self._refusal(text, 'what is not empty')
            return None
        if self.kind == 'truth':
            return _TRUTHS[text]
        if self.kind == 'path':
            return os.path.expanduser(text)
        if self.kind == 'texts':
            return [part.strip() for part in text.split(',') if part.strip()]
        if self.kind == 'count':
            if not text.isdecimal():
                raise self._refusal(text, 'a whole number from 0')
            return int(text)
        if self.kind in ('seconds', 'number'):
            try:
                number = float(text)
            except ValueError:
                number = math.nan
            if not math.isfinite(number) or (self.kind == 'seconds' and number <= 0.0):
                raise self._refusal(text, 'a number' + ' above 0' * (self.kind == 'seconds'))
            return number
        return text

    def _refusal(self, text: str, allowed: str) -> ConfigurationError:
        return ConfigurationError(
            f'launch argument {self.name!r}: got {text!r}; allowed is {allowed}'
        )


# Those of every launch file.
COMMON = (
    Argument('namespace', 'Namespace of the nodes and their topics, one for each robot.'),
    Argument(
        'params_file',
        'YAML file with parameters of the nodes; config/params.yaml of the package lists all.',
        'path',
    ),
    Argument(
        'use_sim_time',
        'Take the time from /clock: true or false. Default: as the parent launch file or '
        'params_file says.',
        'truth',
    ),
    Argument('log_level', 'Least level to log: debug, info, warn, error or fatal.', default='info'),
)
RESPAWN = Argument(
    'respawn',
    'Start a node that was killed or crashed again, after 2 s, in place of ending the launch: '
    'true or false.',
    'truth',
    default='false',
)


class Values(dict[str, Any]):
    """The checked values of the arguments by name; None for what is not given.

    Args:
        arguments: of the launch file.
        context: of the launch.

    Raises:
        OccError: a value means nothing, or there is no such parameter file.
    """

    def __init__(self, arguments: Sequence[Argument], context: LaunchContext) -> None:
        given = context.launch_configurations
        super().__init__((item.name, item.value(given[item.name])) for item in arguments)
        self._content: Any = None
        self._parents_namespace = given.get('ros_namespace', '')
        if self['params_file']:
            self._content = _content(self['params_file'])
        for item in arguments:
            if self[item.name] is None and item.parameter and item.default:
                node, _, parameter = item.parameter.partition('.')
                if parameter not in self._set_in_file(node):
                    self[item.name] = item.value(item.default)

    def but(self, **changed: Any) -> Values:
        """Return a copy with some values changed."""
        values = copy(self)
        values.update(changed)
        return values

    def texts(self, *names: str, **others: str) -> list[tuple[str, str]]:
        """Return arguments for an included launch file, some handed on and some given."""
        handed = {name: _text(self[name]) for name in names}
        return list((handed | others).items())

    def _set_in_file(self, node: str) -> set[str]:
        parts = (self._parents_namespace, self['namespace'] or '', node)
        name = '/' + '/'.join(part.strip('/') for part in parts if part.strip('/'))
        return {*names_of_sections(self._content, name), *names_for_any_node(self._content)}


def description(
    arguments: Sequence[Argument],
    start: Callable[[Values], Sequence[LaunchDescriptionEntity]],
) -> LaunchDescription:
    """Return a launch description that checks its arguments before it starts anything.

    Args:
        arguments: of the launch file.
        start: returns what to start; it may raise an :class:`OccError` too.
    """

    def check_and_start(context: LaunchContext) -> list[LaunchDescriptionEntity]:
        values = Values(arguments, context)
        return [*_misspelled(arguments, context), *start(values)]

    return LaunchDescription(
        [*(item.declaration() for item in arguments), OpaqueFunction(function=check_and_start)]
    )


def node(
    name: str,
    values: Values,
    parameters: Mapping[str, Any],
    *,
    remappings: Sequence[tuple[str, str]] = (),
    on_success: Callable[[], LaunchDescriptionEntity] | None = None,
) -> Node:
    """Return a node that ends the whole launch when it ends.

    With exit code 0 that is a shutdown, with any other one a failure, so that ``ros2 launch`` ends
    with exit code 1. With ``respawn`` among the values, a node that was killed is started again.

    Args:
        name: of the executable, and of the node.
        values: checked arguments.
        parameters: None for what is left to the parameter file.
        remappings: of topics.
        on_success: returns what to do after exit code 0 instead.
    """
    given = {'use_sim_time': values['use_sim_time'], **parameters}
    own = {key: _parameter(value) for key, value in given.items() if value is not None}
    respawn = bool(values.get('respawn'))

    def on_exit(event: ProcessExited, context: LaunchContext) -> LaunchDescriptionEntity | None:
        code = event.returncode
        if context.is_shutdown or (respawn and code not in (0, _BAD_INPUT)):
            return None
        if code == 0:
            return on_success() if on_success else Shutdown(reason=f'{name} has ended')
        # Launch ends by it, and with exit code 1.
        raise RuntimeError(f'{name} ended with exit code {code}, see above')

    return Node(
        package=PACKAGE,
        executable=name,
        name=name,
        namespace=values['namespace'] or '',
        output='screen',
        parameters=[*([values['params_file']] if values['params_file'] else []), own],
        remappings=remappings,
        arguments=['--ros-args', '--log-level', values['log_level']],
        on_exit=on_exit,
        respawn=respawn,
        respawn_delay=_RESPAWN_SECONDS,
    )


def include(path: str | Path, arguments: Sequence[tuple[str, str]]) -> IncludeLaunchDescription:
    """Return another launch file with arguments for it."""
    return IncludeLaunchDescription(str(path), launch_arguments=arguments)


def _text(value: Any) -> str:
    if isinstance(value, list):
        return ','.join(value)
    return '' if value is None else str(value)


def _parameter(value: Any) -> ParameterValue:
    # Without its type, launch would read the text '2024' as a number.
    kind = list[str] if isinstance(value, list) else type(value)
    return ParameterValue(value, value_type=kind)


def _content(path: str) -> Any:
    """Return what is in a parameter file.

    Of one that is not there, launch would only warn, and start the nodes with their defaults.

    Raises:
        OccError: it cannot be read.
    """
    try:
        return yaml.safe_load(Path(path).read_text(encoding='utf-8'))
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        reason = ' '.join(str(error).split())
        raise ConfigurationError(f'params_file {path} cannot be read: {reason}') from error


def _misspelled(arguments: Sequence[Argument], context: LaunchContext) -> list[LogInfo]:
    """Warn of launch arguments that look like a misspelled one; others may be a parent's."""
    names = [item.name for item in arguments]
    unknown = [name for name in context.launch_configurations if name not in names]
    return [
        LogInfo(msg=f'warning: there is no launch argument {name!r}; did you mean {close[0]!r}?')
        for name in unknown
        if (close := difflib.get_close_matches(name, names, n=1))
    ]
