# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Where one feature comes from and what is done to it, as values and as plain YAML values."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields, replace
from typing import Any, cast

import numpy as np

from occ_constraints_pkg.documents import did_you_mean
from occ_constraints_pkg.errors import ConfigurationError
from occ_constraints_pkg.features.paths import Selector, parse_path

REDUCTIONS = ('min', 'max', 'mean', 'norm', 'count')
# Angles of a quaternion, which are reductions but stand among the steps, too.
ANGLES = ('yaw', 'roll', 'pitch', 'tilt')
# Those that go round, so that their differences take the short way.
ROUND_ANGLES = ('yaw', 'roll')
# What may follow a field after '|', besides the reductions; those with numbers stand in a list.
PLAIN_STEPS = ('abs', *ANGLES, 'rate')
NUMBER_STEPS = ('scale', 'offset', 'round')
STEPS = (*PLAIN_STEPS, *NUMBER_STEPS, 'clip')
FULL_CIRCLE = 360.0
# Directions of four or eight sectors, counter-clockwise from straight ahead.
_FOUR = ('front', 'left', 'rear', 'right')
_EIGHT = (
    *('front', 'front_left', 'left', 'rear_left'),
    *('rear', 'rear_right', 'right', 'front_right'),
)
_PIPED = re.compile(r'\|(\w+)$')

# A step of a transform: its name, then its numbers.
Step = tuple[Any, ...]


@dataclass(frozen=True)
class Reading:
    """One number out of each message of a topic, or one per row of a table.

    Attributes:
        topic: topic name as written; with or without leading slash is the same.
        field: path of a message field, as ``twist.twist.linear.x``, ``ranges[3]``, ``ranges[0:9]``
            (the end not included), ``position[name=elbow]``; None when ``column`` is set.
        column: name of a table's column; None when ``field`` is set.
        reduce: what makes one number of several: ``min``, ``max``, ``mean``, ``norm`` or ``count``;
            ``yaw``, ``roll``, ``pitch`` and ``tilt`` make an angle in rad of a quaternion; None for
            a field that is a number.
        degrees: of the ranges of a LaserScan only those in this sector, from the first angle
            counter-clockwise to the second, which does not belong to it; 0 is the scanner's x
            axis. None for all.
        missing: meaning of a range that was not measured, which a scanner reports as +Inf, NaN or
            0: ``unknown`` leaves it as it is, so that one that is not finite makes the verdict
            UNKNOWN; ``max_range`` puts the message's greatest range in its place, unless all
            values of the field are NaN or 0: then the scanner is blind, and the value is missing;
            ``drop`` leaves it out of the reduction, and if none remains, the value is missing.
            -Inf, which REP 117 defines as an object too close to measure, is never replaced.
        order: of a quaternion that is an array of four numbers, ``xyzw`` or ``wxyz``; None for one
            with named parts, and for px4_msgs, whose order is ``wxyz``.
        range_limits: which ranges are measurements: ``own``, those from the message's own least to
            its greatest; ``(low, high)``; ``ignore``, all; None, those up to the message's own
            greatest where ``missing`` is not ``unknown``.
        exclude_degrees: sectors as in ``degrees`` that are left out: the robot's own body.
        max_age: seconds after which the value counts as missing; None for that of the map.
        age_by: what its age is measured by: ``stamp``, the header stamps where there are some, or
            ``arrival``.
        transform: steps before it is subtracted; of a feature's own reading none.
    """

    topic: str
    field: str | None = None
    column: str | None = None
    reduce: str | None = None
    degrees: tuple[float, float] | None = None
    missing: str = 'unknown'
    order: str | None = None
    range_limits: str | tuple[float, float] | None = None
    exclude_degrees: tuple[tuple[float, float], ...] = ()
    max_age: float | None = None
    age_by: str = 'stamp'
    transform: tuple[Step, ...] = ()

    @property
    def is_sector(self) -> bool:
        """Whether only some beams of a scan are read, so that its angles are needed."""
        return self.degrees is not None or bool(self.exclude_degrees)

    @property
    def selectors(self) -> tuple[Selector, ...]:
        """The names that a message must have to say something of this reading."""
        steps = parse_path(self.field or '')
        if self.reduce == 'count':
            # None of that name is a count, too.
            steps = steps[:-1]
        return tuple(step for step in steps if isinstance(step, Selector))


@dataclass(frozen=True)
class FeatureSource:
    """A feature: a reading, perhaps less another one, and then some steps.

    Attributes:
        name: the feature's identifier.
        topic: see :class:`Reading`, as for ``field``, ``column``, ``reduce``, ``degrees``,
            ``missing``, ``order``, ``range_limits``, ``exclude_degrees``, ``max_age`` and
            ``age_by``.
        unit: SI unit, or ``1`` for a pure number.
        low: smallest physically possible value, ``-inf`` for none.
        high: largest physically possible value, ``inf`` for none.
        transform: steps, applied in order after ``minus``: ``('abs',)``, ``('rate',)`` (change
            per second), ``('scale', factor)``, ``('offset', summand)``, ``('clip', low, high)``,
            ``('round', step)`` (to the nearest multiple of a resolution). A name alone means one
            step; an angle such as ``yaw`` is taken as what it is, a reduction.
        minus: the reading to subtract; None for none.
        family: features that measure the same in different places or directions; see
            :class:`~occ_constraints_pkg.rules.space.Feature`.
    """

    name: str
    topic: str
    field: str | None = None
    column: str | None = None
    unit: str = '1'
    low: float = -np.inf
    high: float = np.inf
    reduce: str | None = None
    transform: tuple[Step | str, ...] | str | None = ()
    missing: str = 'unknown'
    family: str = ''
    degrees: tuple[float, float] | None = None
    minus: Reading | None = None
    order: str | None = None
    range_limits: str | tuple[float, float] | None = None
    exclude_degrees: tuple[tuple[float, float], ...] = ()
    max_age: float | None = None
    age_by: str = 'stamp'

    def __post_init__(self) -> None:
        given = self.transform or ()
        given = (given,) if isinstance(given, str) else given
        steps = tuple((step,) if isinstance(step, str) else step for step in given)
        reduce, steps = _angle_first(self.reduce, steps)
        object.__setattr__(self, 'reduce', reduce)
        object.__setattr__(self, 'transform', steps)

    @property
    def reading(self) -> Reading:
        """What is read of the feature's own topic."""
        return Reading(**{name: getattr(self, name) for name in _READING_KEYS})

    @property
    def readings(self) -> tuple[Reading, ...]:
        """What is read: of its own topic, and what is subtracted if anything is."""
        return (self.reading,) if self.minus is None else (self.reading, self.minus)

    @property
    def steps(self) -> tuple[Step, ...]:
        """The transform with each step as a tuple, as it always is after construction."""
        return cast(tuple[Step, ...], self.transform)

    @property
    def is_plain_column(self) -> bool:
        """Whether the feature is a table's column and nothing else."""
        return self.column is not None and not self.transform and self.minus is None


_READING_KEYS = tuple(field.name for field in fields(Reading) if field.name != 'transform')


def features_of(entry: Mapping[str, Any], where: str) -> list[FeatureSource]:
    """Build the features of one entry of a map that its schema allows; sectors give several.

    Args:
        entry: plain values.
        where: what errors call the entry.

    Raises:
        OccError: keys that exclude or need each other, or a step that does not exist.
    """
    values = dict(entry)
    low, high = values.pop('bounds', (None, None))
    sectors = values.pop('sectors', None)
    minus = values.pop('minus', None)
    steps = _steps(values.pop('transform', ()), f'{where}.transform')
    values, piped = _unpipe(values, where)
    feature = FeatureSource(
        **values,
        low=-np.inf if low is None else float(low),
        high=np.inf if high is None else float(high),
        transform=(*piped, *steps),
    )
    _check_reading(feature.reading, where, is_sectored=sectors is not None)
    _check_steps(feature.reduce, feature.steps, where)
    if minus is not None:
        read, piped = _unpipe(dict(minus), f'{where}.minus')
        steps = (*piped, *_steps(read.pop('transform', ()), f'{where}.minus.transform'))
        reduce, steps = _angle_first(read.pop('reduce', None), steps)
        subtracted = Reading(**read, reduce=reduce, transform=steps)
        feature = replace(feature, minus=subtracted)
        _check_reading(subtracted, f'{where}.minus')
        _check_steps(reduce, steps, f'{where}.minus')
    return [feature] if sectors is None else _sectors(feature, sectors, where)


def feature_document(feature: FeatureSource) -> dict[str, Any]:
    """Return a feature's keys, those at their defaults left out."""
    document = {'name': feature.name, **_reading_document(feature.reading)}
    document['unit'] = feature.unit
    bounds = [value if np.isfinite(value) else None for value in (feature.low, feature.high)]
    if bounds != [None, None]:
        document['bounds'] = bounds
    if feature.minus is not None:
        document['minus'] = _reading_document(feature.minus)
    steps = [_step_document(step) for step in feature.steps]
    if steps:
        is_plain = len(steps) == 1 and isinstance(steps[0], str)
        document['transform'] = steps[0] if is_plain else steps
    if feature.family:
        document['family'] = feature.family
    return document


def _reading_document(reading: Reading) -> dict[str, Any]:
    angle = f'|{reading.reduce}' if reading.reduce in ANGLES else ''
    document: dict[str, Any] = {'topic': reading.topic}
    if reading.column is not None:
        document['column'] = reading.column
    else:
        document['field'] = f'{reading.field}{angle}'
    if reading.order is not None:
        document['order'] = reading.order
    if reading.degrees is not None:
        document['degrees'] = list(reading.degrees)
    if reading.exclude_degrees:
        document['exclude_degrees'] = [list(sector) for sector in reading.exclude_degrees]
    if reading.reduce is not None and not angle:
        document['reduce'] = reading.reduce
    if reading.missing != 'unknown':
        document['missing'] = reading.missing
    if reading.range_limits is not None:
        is_word = isinstance(reading.range_limits, str)
        document['range_limits'] = reading.range_limits if is_word else list(reading.range_limits)
    if reading.max_age is not None:
        document['max_age'] = reading.max_age
    if reading.age_by != 'stamp':
        document['age_by'] = reading.age_by
    if reading.transform:
        document['transform'] = [_step_document(step) for step in reading.transform]
    return document


def _step_document(step: Step) -> Any:
    name, *numbers = step
    if not numbers:
        return name
    ends = [number if np.isfinite(number) else None for number in numbers]
    return {name: ends if name == 'clip' else ends[0]}


def _unpipe(values: dict[str, Any], where: str) -> tuple[dict[str, Any], tuple[Step, ...]]:
    """Split ``|min|abs`` off a field or column; return the keys, with reduce, and the steps."""
    key = 'column' if values.get('column') is not None else 'field'
    names: list[str] = []
    while found := _PIPED.search(values[key]):
        name = found[1]
        if name not in REDUCTIONS and name not in PLAIN_STEPS:
            if key == 'column':
                # A column may have any name.
                break
            hint = did_you_mean(name, (*REDUCTIONS, *PLAIN_STEPS)) or ';'
            raise ConfigurationError(
                f"{where}.field: got '|{name}'{hint} allowed after '|' are "
                f'{", ".join((*REDUCTIONS, *PLAIN_STEPS))}'
            )
        names.insert(0, name)
        values[key] = values[key][: found.start()]
    if names and names[0] in REDUCTIONS:
        if values.get('reduce') is not None:
            raise ConfigurationError(
                f"{where}.reduce: got one beside '|{names[0]}'; allowed is one of them"
            )
        values['reduce'] = names.pop(0)
    for name in names:
        if name in REDUCTIONS:
            raise ConfigurationError(
                f"{where}.{key}: got '|{name}' after another step; allowed is to reduce first"
            )
    for name in ('degrees', 'range_limits'):
        if isinstance(values.get(name), list):
            values[name] = tuple(float(number) for number in values[name])
    if 'exclude_degrees' in values:
        values['exclude_degrees'] = tuple(
            (float(low), float(high)) for low, high in values['exclude_degrees']
        )
    if 'max_age' in values:
        values['max_age'] = float(values['max_age'])
    return values, tuple((name,) for name in names)


def _angle_first(
    reduce: str | None, steps: tuple[Step, ...]
) -> tuple[str | None, tuple[Step, ...]]:
    """Return reduction and steps, an angle as first step taken as the reduction that it is."""
    if reduce is None and steps and steps[0][0] in ANGLES:
        return steps[0][0], steps[1:]
    return reduce, steps


def _check_steps(reduce: str | None, steps: tuple[Step, ...], where: str) -> None:
    names = [step[0] for step in steps]
    for angle in ANGLES:
        if angle in names:
            raise ConfigurationError(
                f'{where}: got transform {angle!r} '
                + (
                    f"with reduce '{reduce}'; allowed is one of them"
                    if reduce
                    else f'after another step; allowed is {angle} as the first'
                )
            )
    if names.count('rate') > 1:
        raise ConfigurationError(f"{where}.transform: got 'rate' twice; allowed is once")


def _steps(given: Any, where: str) -> tuple[Step, ...]:
    """Return the steps of a document's ``transform``."""
    steps = []
    for index, item in enumerate([given] if isinstance(given, str) else given):
        place = where if isinstance(given, str) else f'{where}[{index}]'
        pairs = [(item, None)] if isinstance(item, str) else list(item.items())
        if len(pairs) != 1:
            raise ConfigurationError(
                f'{place}: got {len(pairs)} keys; allowed is one, such as scale: 0.001'
            )
        name, numbers = pairs[0]
        if name not in STEPS:
            hint = did_you_mean(name, STEPS) or ';'
            raise ConfigurationError(f'{place}: got {name!r}{hint} allowed are {", ".join(STEPS)}')
        steps.append((name, *_numbers(name, numbers, place)))
    return tuple(steps)


def _numbers(name: str, given: Any, where: str) -> tuple[float, ...]:
    """Check the numbers of a step."""
    allowed = 'nothing'
    if name in PLAIN_STEPS:
        if given is None:
            return ()
    elif name in NUMBER_STEPS:
        allowed = {
            'scale': 'a finite number other than 0',
            'offset': 'a finite number',
            'round': 'a finite number above 0',
        }[name]
        if _is_number(given) and np.isfinite(given):
            fits = {'scale': given != 0, 'offset': True, 'round': given > 0}
            if fits[name]:
                return (float(given),)
    else:
        allowed = '[low, high], null for none, the smaller first'
        ends = given if isinstance(given, list) and len(given) == 2 else ['', '']
        if all(item is None or _is_number(item) for item in ends):
            low = -np.inf if ends[0] is None else float(ends[0])
            high = np.inf if ends[1] is None else float(ends[1])
            if low < high:
                return low, high
    raise ConfigurationError(f'{where}: got {given!r} for {name}; allowed is {allowed}')


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _check_reading(reading: Reading, where: str, *, is_sectored: bool = False) -> None:
    """Refuse what the schema cannot see: keys that exclude or need each other."""
    if reading.max_age is not None and not np.isfinite(reading.max_age):
        raise ConfigurationError(
            f'{where}.max_age: got {reading.max_age}; allowed is a finite number'
        )
    if reading.column is not None:
        if reading.reduce in ANGLES:
            raise ConfigurationError(
                f'{where}.transform: got {reading.reduce!r} for a table column; it needs a '
                'quaternion field'
            )
        for key in ('reduce', 'missing', 'degrees', 'exclude_degrees', 'range_limits', 'order'):
            value = getattr(reading, key)
            if value not in (None, 'unknown', ()):
                raise ConfigurationError(
                    f'{where}.{key}: got {value!r} for a table column, which is one number; '
                    f'allowed is to leave {key} out'
                )
        if is_sectored:
            raise ConfigurationError(
                f'{where}.sectors: got a table column; allowed is a field of ranges'
            )
        return
    # The schema asks for one of the two.
    assert reading.field is not None
    sectors = [('degrees', reading.degrees)] if reading.degrees is not None else []
    for key, (low, high) in sectors + [
        (f'exclude_degrees[{index}]', sector)
        for index, sector in enumerate(reading.exclude_degrees)
    ]:
        if not (abs(low) <= FULL_CIRCLE and low < high <= low + FULL_CIRCLE):
            raise ConfigurationError(
                f'{where}.{key}: got [{low:g}, {high:g}]; allowed are two angles, the first '
                'from -360 to 360, the second larger by at most 360'
            )
    if isinstance(reading.range_limits, tuple):
        low, high = reading.range_limits
        if not low < high:
            raise ConfigurationError(
                f'{where}.range_limits: got [{low:g}, {high:g}]; allowed are own, ignore and '
                '[low, high], the smaller first'
            )
    is_angle = reading.reduce in ANGLES
    if reading.order is not None and not is_angle:
        raise ConfigurationError(
            f'{where}.order: got {reading.order!r} without an angle; allowed is order beside '
            f'{", ".join(ANGLES)}'
        )
    steps = parse_path(reading.field)
    is_sector = is_sectored or reading.is_sector
    if is_sector and not all(isinstance(step, str) for step in steps):
        raise ConfigurationError(
            f'{where}.field: got {reading.field!r} beside a sector; allowed is the whole array, '
            'such as ranges'
        )
    is_several = is_sector or any(isinstance(step, slice) for step in steps)
    if is_several and (reading.reduce is None or is_angle):
        what = 'a sector' if is_sector else f'field {reading.field!r}'
        raise ConfigurationError(
            f'{where}: the key "reduce" is missing, which {what} needs to '
            f'become one number; allowed are {", ".join(REDUCTIONS)}'
        )


def _sectors(feature: FeatureSource, count: int, where: str) -> list[FeatureSource]:
    """Return one feature of the family for each of ``count`` sectors of equal width.

    Sectors of the full circle begin with the one around straight ahead; those of a part of it
    follow one another from its first angle on.
    """
    if feature.degrees is None:
        width = FULL_CIRCLE / count
        first = -width / 2
    else:
        width = (feature.degrees[1] - feature.degrees[0]) / count
        first = feature.degrees[0]
    if width < 1.0:
        raise ConfigurationError(
            f'{where}.sectors: got {count}, which makes sectors of {width:.3g} degrees; '
            'allowed are sectors of at least 1 degree'
        )
    words = {4: _FOUR, 8: _EIGHT}.get(count) if feature.degrees is None else None
    sectors = []
    for index in range(count):
        # Neighbours get the same number where they touch, so that no beam is lost between them.
        low, high = (first + width * end for end in (index, index + 1))
        if _is_within(low, high, feature.exclude_degrees):
            continue
        name = words[index] if words else f'{round((low + high) / 2) % 360}'
        sectors.append(
            replace(
                feature,
                name=f'{feature.name}_{name}',
                degrees=(low, high),
                family=feature.family or feature.name,
            )
        )
    if not sectors:
        raise ConfigurationError(
            f'{where}.exclude_degrees: got all of the {count} sectors; allowed is to leave some'
        )
    return sectors


def _is_within(low: float, high: float, excluded: Iterable[tuple[float, float]]) -> bool:
    """Tell whether a sector lies within one of those that are left out."""
    return any(
        last - first >= FULL_CIRCLE or (low - first) % FULL_CIRCLE + high - low <= last - first
        for first, last in excluded
    )
