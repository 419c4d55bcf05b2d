# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Tracking errors: how far what is measured is from what was commanded."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from occ_constraints_pkg.suggestion.candidate import Candidate, label_of
from occ_constraints_pkg.suggestion.meanings import ROLES, words_of

# Roles of which a command and a measurement are compared.
_TRACKED = [ROLES[role] for role in ('speed', 'velocity', 'angle', 'turn rate', 'number', 'height')]
# Names of commands, names of measurements, and the name of their difference.
_PAIRS = (
    ('commanded_speed', 'speed', 'speed_error'),
    ('commanded_turn_rate', 'turn_rate', 'turn_rate_error'),
    ('commanded_steering_angle', 'steering_angle', 'steering_error'),
    ('commanded_altitude', 'altitude', 'altitude_error'),
    ('commanded_height', 'height', 'height_error'),
)


def tracking_errors(candidates: Sequence[Candidate]) -> list[Candidate]:
    """Return the differences between commands and what is measured of the same.

    Args:
        candidates: all of one robot.
    """
    able = [item for item in candidates if not item.aside]
    return [*_named(able), *_joints(able), *_numbers(able)]


def _named(candidates: Sequence[Candidate]) -> Iterator[Candidate]:
    for command, measured, name in _PAIRS:
        orders = [item for item in candidates if item.entry['name'] == command]
        values = [
            item
            for item in candidates
            if item.entry['name'] == measured and item.kind not in ('command', 'position')
        ]
        if orders and values:
            found = _difference(orders[0], values[0], name)
            found.coupled = values[0].coupled = measured
            yield found


def _joints(candidates: Sequence[Candidate]) -> Iterator[Candidate]:
    measured = {
        item.entry['name']: item
        for item in candidates
        if item.topic.msgtype == 'sensor_msgs/msg/JointState' and item.kind == 'joints'
    }
    for item in candidates:
        if item.topic.msgtype != 'sensor_msgs/msg/JointState' or item.kind != 'command':
            continue
        own = measured.get(item.entry['name'])
        if own is not None and item.group in ('position', 'velocity'):
            name = f'{item.group}_error_{item.entry["name"].removeprefix(item.group + "_")}'
            found = _difference(item, own, name)
            found.group, found.coupled = f'{item.group}_error', label_of(own.entry['field'])
            yield found


def _numbers(candidates: Sequence[Candidate]) -> Iterator[Candidate]:
    """Yield differences of numbers of unknown types, where one command fits one measurement."""
    numbers = [item for item in candidates if item.is_brief and not item.group]
    measured = [item for item in numbers if item.kind != 'command' and item.role in _TRACKED]
    pairs: list[tuple[Candidate, Candidate]] = []
    for command in numbers:
        if command.kind == 'command':
            pairs += [(command, item) for item in measured if _fit(command, item)]
    for command, item in pairs:
        if sum(command is other or item is found for other, found in pairs) == 1:
            yield _difference(command, item, f'{item.entry["name"]}_error')


def _fit(command: Candidate, measured: Candidate) -> bool:
    """Tell whether two numbers are of the same, by the words of their names."""
    space = [item.topic.name.rpartition('/')[0] for item in (command, measured)]
    if command.entry['field'] == measured.entry['field'] == 'data':
        return space[0] == space[1] != ''
    own = words_of(measured.entry['field'].rpartition('.')[2])
    return command.role is measured.role and set(own) <= set(words_of(command.entry['field']))


def _difference(command: Candidate, measured: Candidate, name: str) -> Candidate:
    """Return what is measured less what is commanded."""
    read = {
        key: measured.entry[key] for key in ('topic', 'field', 'order') if key in measured.entry
    }
    # Of a velocity the part ahead is commanded.
    read['field'] = read['field'].replace('linear|norm', 'linear.x')
    wanted = {key: command.entry[key] for key in ('topic', 'field') if key in command.entry}
    entry = {'name': name, **read, 'minus': wanted, 'unit': measured.entry['unit']}
    role = ROLES['error']
    item = Candidate(entry, measured.topic, 'error', role=role)
    item.remark = f'how far it is from what {command.topic.name} commands'
    item.is_extra = True
    return item
