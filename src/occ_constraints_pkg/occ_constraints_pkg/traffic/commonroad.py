# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""CommonRoad scenarios (XML 2018b and 2020a), in which NGSIM's recordings are published.

Source: documentation of the CommonRoad XML format, commonroad.in.tum.de. Positions are the centres
of the vehicles' rectangles, in metres; speeds in m/s along the orientation, in rad.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

import numpy as np

from occ_constraints_pkg.errors import DataError
from occ_constraints_pkg.traffic.lanelets import Lanelet, RoadMap
from occ_constraints_pkg.traffic.neighbours import gaps_by_lane, standing_inside
from occ_constraints_pkg.traffic.plausible import (
    ALLOWED_LENGTH,
    OTHER_WAY,
    implausible_heading,
    implausible_motion,
    is_length,
)
from occ_constraints_pkg.traffic.recorded import Traffic
from occ_constraints_pkg.traffic.xml_file import XmlFile

_VERSIONS = ('2018b', '2020a')
_VEHICLES = ('car', 'truck', 'bus', 'motorcycle', 'priorityVehicle', 'taxi')
_NUMBERS = ('time/exact', 'position/point/x', 'position/point/y', 'velocity/exact')
_NUMBERS += ('orientation/exact',)
# What a scenario may state inexactly, as predictions are.
_INTERVALS = ('time/intervalStart', 'velocity/intervalStart', 'orientation/intervalStart')


def read_commonroad(path: Path, progress: Callable[[int, int], None] | None = None) -> Traffic:
    """Read the vehicles of a scenario.

    Args:
        path: the XML file.
        progress: called with (vehicles read, vehicles in all).

    Raises:
        OccError: the file is no scenario of a highway in versions 2018b or 2020a, or is damaged;
            the sentence names the line and the element.
    """
    file = XmlFile(path)
    root = file.root
    if root.tag != 'commonRoad':
        file.fail(root, 'is no scenario; allowed is <commonRoad> as the outermost element')
    version = file.attribute(root, 'commonRoadVersion')
    if version not in _VERSIONS:
        file.fail(root, f'has the version {version!r}; allowed are {", ".join(_VERSIONS)}')
    step = file.number_attribute(root, 'timeStepSize')
    if step <= 0.0:
        file.fail(root, f'has timeStepSize {step:g}; allowed is a number of seconds above 0')
    lanelets = [_lanelet(file, element) for element in root.iterfind('lanelet')]
    if not lanelets:
        file.fail(root, 'has no <lanelet>; allowed are one or more')
    road = RoadMap(lanelets)
    vehicles, left_out = _vehicles(file)
    blocks, shapes = [], []
    for number, (vehicle, element) in enumerate(vehicles):
        if progress is not None:
            progress(number, len(vehicles))
        states = _states(file, element)
        blocks.append(np.column_stack([np.full(len(states), vehicle), states]))
        shapes.append(_size(file, element))
    if not blocks:
        others = ', '.join(f'{count} {kind}' for kind, count in left_out.items())
        raise DataError(
            f'{path} has no moving vehicles'
            + (f' but {others}' if others else '')
            + '; allowed are one or more'
        )
    rows = np.concatenate(blocks)
    size = np.repeat(shapes, [len(block) for block in blocks], axis=0)
    return _traffic(file, dict(vehicles), rows, size, step, road, left_out)


def _traffic(
    file: XmlFile,
    elements: Mapping[int, ET.Element],
    rows: np.ndarray,
    size: np.ndarray,
    step: float,
    road: RoadMap,
    left_out: Counter[str],
) -> Traffic:
    path = file.path
    vehicle, instant, points = rows[:, 0].astype(np.int64), rows[:, 1], rows[:, 2:4]
    speed, orientation = rows[:, 4], rows[:, 5]
    found = implausible_motion(vehicle, instant * step, points, speed)
    if found is not None:
        row, sentence = found
        file.fail(elements[vehicle[row]], f'{sentence}, from time step {instant[row]:g} on')
    strayed = implausible_heading(vehicle, instant * step, points, orientation)
    if strayed is not None:
        file.fail(
            elements[vehicle[strayed]], f'{OTHER_WAY}, from time step {instant[strayed]:g} on'
        )
    placed = road.place(points)
    on_road = placed.lane >= 0
    warnings = [f'{path}: {count} {kind} left out' for kind, count in left_out.items()]
    if not on_road.any():
        raise DataError(f'{path}: no vehicle is on a lanelet; allowed are one or more')
    if not on_road.all():
        warnings.append(
            f'{path}: {np.sum(~on_road)} of {len(rows)} rows left out, in which a vehicle is '
            'beyond the lanelets'
        )
    turn = (orientation - placed.angle)[on_road]
    moment, lane, size = instant[on_road], placed.lane[on_road], size[on_road]
    along, left = placed.along[on_road], placed.left[on_road]
    said = {
        key: file.root.attrib.get(key, '') for key in ('benchmarkID', 'author', 'source', 'date')
    }
    return Traffic(
        vehicle=vehicle[on_road],
        time=moment * step,
        v_x=speed[on_road] * np.cos(turn),
        v_y=speed[on_road] * np.sin(turn),
        gaps=gaps_by_lane(moment, along, left, size, lane, road.beside),
        inside=standing_inside(moment, along, left, size),
        d_left=placed.d_left[on_road],
        d_right=placed.d_right[on_road],
        source={f'commonroad.{key}': value for key, value in said.items() if value},
        warnings=tuple(warnings),
    )


def _lanelet(file: XmlFile, element: ET.Element) -> Lanelet:
    number = file.integer(element, 'id')
    beside: dict[str, int | None] = {}
    for tag in ('adjacentLeft', 'adjacentRight'):
        other = element.find(tag)
        same = other is not None and file.attribute(other, 'drivingDir') == 'same'
        beside[tag] = file.integer(other, 'ref') if other is not None and same else None
    return Lanelet(
        number,
        file.place_of(element, f'lanelet {number}'),
        _bound(file, file.child(element, 'leftBound')),
        _bound(file, file.child(element, 'rightBound')),
        tuple(file.integer(item, 'ref') for item in element.iterfind('successor')),
        beside['adjacentLeft'],
        beside['adjacentRight'],
    )


def _bound(file: XmlFile, element: ET.Element) -> np.ndarray:
    points = [[file.number(p, 'x'), file.number(p, 'y')] for p in element.iterfind('point')]
    if len(points) < 2 or points[0] == points[-1]:
        file.fail(element, f'has {len(points)} points; allowed are two or more, along a way')
    return np.array(points)


def _vehicles(file: XmlFile) -> tuple[list[tuple[int, ET.Element]], Counter[str]]:
    """Return number and element of each moving vehicle, and how many others there are."""
    vehicles: dict[int, ET.Element] = {}
    left_out: Counter[str] = Counter()
    for kind, element in _obstacles(file):
        if kind not in _VEHICLES:
            left_out[f'of kind {kind!r}'] += 1
            continue
        if inexact := _inexact(element):
            left_out[inexact] += 1
            continue
        number = file.integer(element, 'id')
        if number in vehicles:
            file.fail(element, f'has the id {number} of another one; ids must be unique')
        vehicles[number] = element
    return list(vehicles.items()), left_out


def _inexact(element: ET.Element) -> str:
    """Say why an obstacle has no exact trajectory of a rectangle; empty if it may have one."""
    shapes = {item.tag for item in element.iterfind('shape/*')}
    if shapes and 'rectangle' not in shapes:
        return f'with the shape {", ".join(sorted(shapes))}'
    if element.find('trajectory') is None and element.find('occupancySet') is not None:
        return 'given by occupied areas'
    for state in (*element.iterfind('initialState'), *element.iterfind('trajectory/state')):
        if any(state.find(name) is not None for name in _INTERVALS):
            return 'with intervals instead of exact values'
        positions = {item.tag for item in state.iterfind('position/*')}
        if positions and 'point' not in positions:
            return 'at areas instead of points'
    return ''


def _obstacles(file: XmlFile) -> Iterator[tuple[str, ET.Element]]:
    for element in file.root:
        if element.tag == 'dynamicObstacle':
            yield file.text(element, 'type'), element
        elif element.tag == 'obstacle':
            moves = file.text(element, 'role') == 'dynamic'
            yield file.text(element, 'type') if moves else 'static', element
        elif element.tag == 'staticObstacle':
            yield 'static', element


def _size(file: XmlFile, element: ET.Element) -> tuple[float, float]:
    length = file.number(element, 'shape/rectangle/length')
    if not is_length(length):
        place = file.child(element, 'shape/rectangle/length')
        file.fail(place, f'is {length:g} m; {ALLOWED_LENGTH}')
    return length, file.number(element, 'shape/rectangle/width')


def _states(file: XmlFile, element: ET.Element) -> np.ndarray:
    """Return (n, 5) time step, x, y, speed and orientation of each state."""
    following = file.child(element, 'trajectory').iterfind('state')
    states = []
    for state in (file.child(element, 'initialState'), *following):
        states.append([file.number(state, name) for name in _NUMBERS])
        step, last = states[-1][0], states[-2][0] if len(states) > 1 else -1.0
        if step != int(step) or step <= last:
            file.fail(state, f'has the time step {step:g}; allowed are whole numbers that grow')
    return np.array(states)
