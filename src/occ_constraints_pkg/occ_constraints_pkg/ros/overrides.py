# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Parameters given to a node that it does not have, or that ask for what ROS does not offer."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any

import yaml
from rclpy.parameter import Parameter

from occ_constraints_pkg.documents import did_you_mean, read_text
from occ_constraints_pkg.errors import ConfigurationError

ROS_SWITCHES = ('use_sim_time', 'start_type_description_service')
"""Parameters, true or false, that every node has from rclpy."""

QOS_PREFIX = 'qos_overrides.'
"""How the parameters begin that override the quality of service of a topic."""

_POLICIES = {
    'history': ('keep_last', 'keep_all', 'system_default'),
    'reliability': ('reliable', 'best_effort', 'system_default', 'best_available'),
    'depth': (),
}
OF_SUBSCRIPTION = re.compile(rf'{re.escape(QOS_PREFIX)}.+\.subscription\.({"|".join(_POLICIES)})')
"""The overrides that a subscription of a node may ask for."""

_QOS = re.compile(r'qos_overrides\.(?P<topic>.+)\.(?P<end>[^.]+)\.(?P<policy>[^.]+)')
# Those that ROS has besides, which is no slip.
_OTHER_POLICIES = (
    'avoid_ros_namespace_conventions',
    'deadline',
    'durability',
    'lifespan',
    'liveliness',
    'liveliness_lease_duration',
)
_MOST_DEPTH = 2**31 - 1


def check_qos_overrides(overrides: Iterable[Parameter]) -> None:
    """Look at the values of overrides of quality of service that a node may act on.

    Raises:
        OccError: one has a value that its policy does not take.
    """
    for item in overrides:
        match = _QOS.fullmatch(item.name)
        if match is None or match['policy'] not in _POLICIES:
            continue
        allowed, value = _POLICIES[match['policy']], item.value
        if allowed:
            if not isinstance(value, str) or value.lower() not in allowed:
                raise ConfigurationError(
                    f'parameter {item.name!r}: got {value!r}; allowed are {", ".join(allowed)}'
                )
        elif isinstance(value, bool) or not isinstance(value, int) or not 1 <= value <= _MOST_DEPTH:
            raise ConfigurationError(
                f'parameter {item.name!r}: got {value!r}; allowed is a whole number from 1 up to '
                f'{_MOST_DEPTH}'
            )


def check_unknown(
    ignored: Sequence[str],
    declared: Sequence[str],
    argv: Sequence[str],
    node: str,
    warn: Callable[[str], Any],
) -> None:
    """Refuse parameters that a node does not have, unless they may be meant for other nodes.

    Those of a section of a parameter file that speaks of any node (``/**``) may; of these, one
    that looks like a slip is warned of.

    Args:
        ignored: names that were given and that the node has not declared.
        declared: names that it has.
        argv: the command line with the parameters and the files of them.
        node: its full name.
        warn: takes a warning.

    Raises:
        OccError: one was given to this node by its name, or on its command line.
    """
    if not ignored:
        return
    ours = set(_of_command_line(argv))
    for path in params_files(argv):
        ours |= set(_of_sections(yaml.safe_load(read_text(path)), node))
    for name in ignored:
        hint, allowed = _similar(name, declared)
        if name in ours:
            raise ConfigurationError(
                f'node {node!r} has no parameter {name!r}{hint or ";"} allowed are {allowed}'
            )
        if hint:
            warn(f'parameter {name!r} is ignored: this node has no such parameter{hint}')


def params_files(argv: Sequence[str]) -> Iterator[str]:
    """Yield the paths of the parameter files that a command line names."""
    for flag, value in zip(argv, argv[1:], strict=False):
        if flag == '--params-file':
            yield value


def _of_command_line(argv: Sequence[str]) -> Iterator[str]:
    for flag, value in zip(argv, argv[1:], strict=False):
        if flag in ('-p', '--param'):
            # NAME:=VALUE or NODE:NAME:=VALUE; those for other nodes are not among the ignored.
            yield value.partition(':=')[0].rpartition(':')[2]


def _of_sections(content: Any, node: str, key: str = '') -> Iterator[str]:
    """Yield the names of parameters in the sections of a file that speak of ``node`` by name."""
    if not isinstance(content, dict):
        return
    for part, value in content.items():
        if part != 'ros__parameters':
            yield from _of_sections(value, node, f'{key}/{part}')
        elif _names(key, node):
            yield from _flat(value, '')


def _names(key: str, node: str) -> bool:
    """Return whether the key of a section means a node, and no other one of its namespace."""
    parts = [part for part in key.split('/') if part]
    patterns = {'**': '(/[^/]+)*', '*': '/[^/]+'}
    pattern = ''.join(patterns.get(part, f'/{re.escape(part)}') for part in parts)
    return bool(parts) and parts[-1] not in patterns and bool(re.fullmatch(pattern, node))


def _flat(content: Any, prefix: str) -> Iterator[str]:
    if not isinstance(content, dict):
        yield prefix
        return
    for part, value in content.items():
        yield from _flat(value, f'{prefix}.{part}' if prefix else str(part))


def _similar(name: str, declared: Sequence[str]) -> tuple[str, str]:
    """Return the hint at a similar name, and in words what is allowed in place of ``name``."""
    qos = [item for item in declared if item.startswith(QOS_PREFIX)]
    if not name.startswith(QOS_PREFIX):
        known = [item for item in declared if item not in (*qos, *ROS_SWITCHES)]
        return did_you_mean(name, (*known, *ROS_SWITCHES)), ', '.join(known)
    if not qos:
        return '', 'none of quality of service'
    policies = ', '.join(_POLICIES)
    match = _QOS.fullmatch(name)
    if match is not None and match['policy'] not in _POLICIES:
        is_slip = match['policy'] not in _OTHER_POLICIES
        hint = did_you_mean(match['policy'], _POLICIES) if is_slip else ''
        return hint, f'the policies {policies}'
    ends = sorted({item.rpartition('.')[0] for item in qos})
    hint = did_you_mean(name.rpartition('.')[0], ends)
    return hint, f'qos_overrides./TOPIC.publisher or .subscription, then {policies}'
