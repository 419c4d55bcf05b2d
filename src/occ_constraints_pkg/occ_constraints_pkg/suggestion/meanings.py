# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""What a number means, by the words of its name and by how it behaves; and what is no feature."""

from __future__ import annotations

import re
from dataclasses import dataclass

from occ_constraints_pkg.suggestion.inspection import Series

_WORD = re.compile(r'[A-Z]?[a-z]+|[A-Z]+(?![a-z])|\d+')
# Names of fields that say nothing; then the name of what they are in counts.
_EMPTY_WORDS = {'data', 'value', 'values', 'val', 'reading', 'readings', 'measurement'}
_COMMANDS = {
    *('cmd', 'cmds', 'command', 'commands', 'commanded', 'desired', 'target', 'reference', 'ref'),
    *('setpoint', 'setpoints', 'goal', 'sp', 'joy', 'teleop', 'request', 'requested', 'demand'),
    *('manual',),
}
_ON_THE_MAP = 'a coordinate or direction on the map: rules about it are valid only at this place'
# A code, a counter and so on: words of a name, and why it is no feature.
_NO_FEATURES: tuple[tuple[frozenset[str], str], ...] = (
    (
        frozenset(
            (
                *('timestamp', 'time', 'stamp', 'sec', 'secs', 'nsec', 'nanosec', 'usec', 'clock'),
                *('uptime', 'date', 'timeout', 'utc', 'epoch', 'runtime'),
                *('elapsed', 'seconds', 'nanoseconds', 'microseconds', 'milliseconds', 'millis'),
            )
        ),
        'a time, which no two recordings share',
    ),
    (
        frozenset(
            (
                *('counter', 'count', 'cnt', 'counts', 'seq', 'sequence', 'index', 'idx', 'num'),
                *(
                    'tick',
                    'ticks',
                    'number',
                    'cycle',
                    'cycles',
                    'odometer',
                    'tachometer',
                    'encoder',
                    'traveled',
                ),
                *('travelled', 'drawn', 'consumed', 'discharged', 'regen', 'total', 'frames'),
            )
        ),
        'a counter or sequence number',
    ),
    (
        frozenset(('id', 'ids', 'version', 'serial', 'sn', 'crc', 'checksum', 'uuid', 'reserve')),
        'an identifier',
    ),
    (
        frozenset(
            (
                *(
                    'variance',
                    'var',
                    'covariance',
                    'std',
                    'stddev',
                    'sigma',
                    'hdop',
                    'vdop',
                    'pdop',
                ),
                *('eph', 'epv', 'evh', 'evv', 'accuracy', 'uncertainty'),
            )
        ),
        'the uncertainty of another number',
    ),
    (
        frozenset(
            (
                *(
                    'lat',
                    'latitude',
                    'lon',
                    'lng',
                    'longitude',
                    'easting',
                    'northing',
                    'utm',
                    'east',
                ),
                *('north', 'heading', 'yaw', 'course', 'cog', 'azimuth', 'bearing', 'track'),
                *('hdg', 'compass'),
            )
        ),
        _ON_THE_MAP,
    ),
    (
        frozenset(('capacity', 'design', 'nominal', 'min', 'max', 'limit', 'limits', 'scale')),
        'a constant of the device',
    ),
)
_STATUS = {
    *('mode', 'modes', 'status', 'state', 'type', 'flag', 'flags', 'code', 'health', 'technology'),
    *('level', 'gear', 'gait', 'source', 'priority', 'bitfield', 'mask', 'warning', 'service'),
    *('fix', 'quality', 'cells', 'rows', 'cols', 'row', 'col', 'bit', 'bits', 'head', 'lost'),
    *('ready', 'phase', 'stage', 'step', 'progress', 'enum', 'frame', 'bandwidth', 'register'),
    *('instance', 'channel', 'button', 'buttons', 'switch', 'action', 'event', 'result', 'faults'),
}
# Words of a flag whose rise is a danger by itself.
_HAZARDS = {
    *('bump', 'bumper', 'bumped', 'bumpers', 'contact', 'collision', 'cliff', 'drop', 'hazard'),
    *('stall', 'stalled', 'estop', 'emergency', 'overcurrent', 'overheat', 'overtemperature'),
    *('tipped', 'fallen', 'leak', 'fault', 'obstacle', 'touch', 'kidnap', 'slip', 'slipping'),
}


# Joints that turn without end.
_TURNING = {'wheel', 'rotor', 'propeller', 'caster', 'roller'}
# Joints that slide: m, not rad.
_SLIDING = {
    *('lift', 'slide', 'slider', 'prismatic', 'rail', 'linear', 'telescope', 'extension'),
    *('elevator', 'gantry', 'finger'),
}


@dataclass(frozen=True)
class Role:
    """What kind of quantity a number is.

    Attributes:
        unit: SI unit; ``1`` where it is not known.
        side: on which side danger lies: ``above``, ``below`` or ``both``.
        is_magnitude: whether only the absolute value counts.
        resolution: finer differences do not count; 0 where only the values can tell.
        steps: into so many its range is divided for want of a larger resolution.
        harmless: no magnitude up to it is a danger, whatever was seen.
        left: of what falls as long as the robot works, as a battery, how much of the least value
            seen a next drive may still use; 0 for all else.
    """

    unit: str
    side: str = 'both'
    is_magnitude: bool = False
    resolution: float = 0.0
    steps: int = 10
    harmless: float = 0.0
    left: float = 0.0


ROLES = {
    'speed': Role('m/s', resolution=0.01, steps=20),
    'velocity': Role('m/s', 'above', is_magnitude=True, resolution=0.01),
    'vertical speed': Role('m/s', resolution=0.01, steps=20),
    'turn rate': Role('rad/s', 'above', is_magnitude=True, resolution=0.01, harmless=0.1),
    # More than gravity by an eighth of it.
    'acceleration': Role('m/s^2', 'above', is_magnitude=True, resolution=0.1, harmless=11.0),
    'tilt': Role('rad', 'above', is_magnitude=True, resolution=0.02, harmless=0.1),
    'angle': Role('rad', resolution=0.01, steps=20),
    'height': Role('m', resolution=0.01, steps=20),
    'distance': Role('m', 'below', resolution=0.01),
    'force': Role('N', 'above', is_magnitude=True),
    'torque': Role('N m', 'above', is_magnitude=True),
    'effort': Role('1', 'above', is_magnitude=True, steps=5),
    'voltage': Role('V', 'below', left=0.9),
    'charge': Role('1', 'below', left=0.5),
    'current': Role('A', 'above', is_magnitude=True),
    'power': Role('W', 'above', is_magnitude=True),
    'temperature': Role('degC', 'above'),
    'pressure': Role('Pa', steps=20),
    'error': Role('1', 'above', is_magnitude=True, steps=5),
    'drive': Role('1', 'above', is_magnitude=True),
    'joint position': Role('rad', resolution=0.01, steps=20),
    'joint speed': Role(
        'rad/s', 'above', is_magnitude=True, resolution=0.01, steps=5, harmless=0.1
    ),
    'reception': Role('1', 'below'),
    'flag': Role('1', 'above'),
    'number': Role('1', steps=20),
}
_ERRORS = frozenset(('error', 'err', 'deviation', 'cte', 'xte', 'residual', 'overshoot'))
# The first line of which some word is in the name tells the role.
_ROLE_WORDS: tuple[tuple[str, frozenset[str]], ...] = (
    ('error', _ERRORS),
    ('temperature', frozenset(('temperature', 'temp', 'ntc', 'temperatures', 'temps'))),
    ('voltage', frozenset(('voltage', 'volt', 'volts', 'voltages', 'vbat', 'vbatt', 'vin'))),
    ('charge', frozenset(('percentage', 'percent', 'soc', 'remaining', 'fuel'))),
    ('current', frozenset(('current', 'currents', 'amps', 'ampere', 'amperage', 'ibat'))),
    ('power', frozenset(('watt', 'watts', 'power'))),
    ('drive', frozenset(('rpm', 'erpm', 'pwm', 'throttle', 'duty', 'thrust', 'brake'))),
    ('torque', frozenset(('torque', 'torques', 'moment'))),
    ('effort', frozenset(('effort', 'efforts', 'tau', 'load'))),
    ('force', frozenset(('force', 'forces', 'weight', 'grf'))),
    (
        'turn rate',
        frozenset(('gyro', 'gyroscope', 'angular', 'yawrate', 'omega', 'rollspeed', 'yawspeed')),
    ),
    (
        'acceleration',
        frozenset(('acceleration', 'accel', 'acc', 'accelerometer', 'ax', 'ay', 'az')),
    ),
    ('vertical speed', frozenset(('climb', 'vz', 'sink', 'vertical'))),
    ('speed', frozenset(('speed', 'velocity', 'vel', 'velocities', 'sog'))),
    ('velocity', frozenset(('vx', 'vy', 'lateral', 'rate'))),
    ('tilt', frozenset(('roll', 'pitch', 'tilt', 'heel', 'inclination'))),
    ('angle', frozenset(('angle', 'steering', 'steer', 'rudder', 'trim'))),
    ('height', frozenset(('altitude', 'alt', 'height', 'depth', 'elevation'))),
    (
        'distance',
        frozenset(
            ('range', 'ranges', 'distance', 'clearance', 'dist', 'proximity', 'headway', 'gap')
        ),
    ),
    ('pressure', frozenset(('pressure',))),
    ('reception', frozenset(('satellites', 'sats', 'rssi', 'snr'))),
    ('joint position', frozenset(('q', 'position', 'positions', 'pos'))),
    ('joint speed', frozenset(('dq', 'qd'))),
)
_TURNS = {'yaw', 'heading', 'roll', 'pitch', 'rotation', 'turn'}


@dataclass(frozen=True)
class Meaning:
    """What a number is taken for.

    Attributes:
        role: one of :data:`ROLES`; empty for what is no feature.
        reason: why it is no feature; empty for one.
        is_command: whether it says what is wanted, not what is measured.
    """

    role: str
    reason: str = ''
    is_command: bool = False


def words_of(name: str) -> list[str]:
    """Return the words of a name in lower case, as of ``imuState/foot_force[2]``."""
    return [word.lower() for word in _WORD.findall(name)]


def is_command(name: str) -> bool:
    """Tell whether a topic or field says by its name that it holds commands."""
    return bool(_COMMANDS.intersection(words_of(name)))


def is_turning(name: str) -> bool:
    """Tell whether a name is that of a joint that turns without end, such as a wheel."""
    return bool(_TURNING.intersection(words_of(name)))


def slides(name: str) -> bool:
    """Tell whether a name is that of a joint that slides, such as a mast."""
    words = set(words_of(name))
    # A shoulder that lifts an arm turns.
    return bool(_SLIDING & words) and 'shoulder' not in words


def names_a_hazard(name: str) -> bool:
    """Tell whether a name is that of a danger, such as that of a bumper."""
    return bool(_HAZARDS.intersection(words_of(name)))


def meaning_of(path: str, topic: str, msgtype: str, series: Series) -> Meaning:
    """Say what a number of a message is.

    Args:
        path: of its field.
        topic: name of its topic.
        msgtype: type of its message.
        series: its values.
    """
    leaf = words_of(re.sub(r'\[[^\]]*\]', ' ', path.rpartition('.')[2]))
    known = [word for word in leaf if word not in _EMPTY_WORDS]
    context = [*words_of(path), *words_of(topic.rpartition('/')[2])]
    own = set(known or context)
    commanded = bool(_COMMANDS.intersection([*words_of(path), *words_of(topic)]))
    context_set = {*words_of(path), *words_of(topic), *words_of(msgtype.rpartition('/')[2])}
    if series.is_flag or series.is_integer:
        reason = _whole_number(own, context_set, series)
        if reason is not None:
            return Meaning('flag') if reason == '' else Meaning('', reason)
    role = _role(own | _ERRORS.intersection(words_of(path)))
    for words, reason in _NO_FEATURES:
        # A cross-track error and a yaw rate are no directions.
        is_relative = reason is _ON_THE_MAP and role in ('error', 'turn rate')
        if own & words and not is_relative:
            return Meaning('', reason)
    if series.is_integer and series.is_constant:
        return Meaning('', 'a whole number that never changes')
    if series.only_rises and not ROLES[role].left:
        way = 'rises' if series.values[-1] > series.values[0] else 'falls'
        return Meaning('', f'only {way}, as clocks, counters and sums do')
    return Meaning(role, is_command=commanded)


def _whole_number(own: set[str], context: set[str], series: Series) -> str | None:
    """Say why a flag or code is no feature; '' for a flag that tells a danger, None for others."""
    is_small = series.low >= 0.0 and series.high <= 1.0
    if is_small and context & _HAZARDS and not own & {'code', 'type', 'mode'}:
        return ''
    if series.is_flag:
        return 'a switch, of which no value is a danger by itself'
    if own & _STATUS:
        return 'a code or mode, not a quantity'
    return None


def _role(own: set[str]) -> str:
    if own & _TURNS and own & {'rate', 'speed', 'velocity', 'vel'}:
        return 'turn rate'
    if 'power' in own and own & {'v', 'a'}:
        return 'voltage' if 'v' in own else 'current'
    for role, words in _ROLE_WORDS:
        if own & words:
            return role
    return 'number'
