# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Recordings of traffic that tests write in the formats of others."""

from __future__ import annotations

import sqlite3
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from occ_constraints_pkg.errors import OccError

FRAME_RATE = 25
MARKINGS = {1: (8.5, 12.5, 16.5), 2: (22.0, 26.0, 30.0, 34.0)}
_WAY = {1: -1.0, 2: 1.0}


@dataclass(frozen=True)
class Car:
    """A vehicle at constant speed, as its driver sees the road.

    Attributes:
        id: its number.
        direction: 1 upper carriageway, 2 lower one.
        start: metres of its centre along its way at frame 1, from the middle of the picture.
        right: metres of its centre from the right edge of its carriageway.
        speed: m/s.
        length: metres.
        width: metres.
        drift: m/s to the left.
        frames: first and last frame.
    """

    id: int
    direction: int
    start: float
    right: float
    speed: float
    length: float = 4.0
    width: float = 2.0
    drift: float = 0.0
    frames: tuple[int, int] = (1, 10)

    def centre(self, frame: int) -> tuple[float, float]:
        """Return metres along the way and from the right edge."""
        seconds = (frame - 1) / FRAME_RATE
        return self.start + self.speed * seconds, self.right + self.drift * seconds

    def lane(self, frame: int) -> int:
        """Return the number of the lane, from the right edge."""
        return int(self.centre(frame)[1] // 4.0)


CARS = (
    Car(1, 1, 0.0, 2.0, 30.0),
    Car(2, 1, 40.0, 2.5, 30.0, length=12.0),
    Car(3, 1, -30.0, 6.0, 33.0, frames=(3, 12)),
    Car(4, 2, 0.0, 6.0, 28.0, drift=0.5),
    Car(5, 2, 3.0, 10.0, 28.0),
    Car(6, 2, -25.0, 2.0, 25.0),
    Car(7, 2, 50.0, 6.5, 24.0, length=16.0, width=2.5),
)
HEADER = (
    'frame,id,x,y,width,height,xVelocity,yVelocity,xAcceleration,yAcceleration,frontSightDistance,'
    'backSightDistance,dhw,thw,ttc,precedingXVelocity,precedingId,followingId,leftPrecedingId,'
    'leftAlongsideId,leftFollowingId,rightPrecedingId,rightAlongsideId,rightFollowingId,laneId'
)


def highd_texts(cars: Sequence[Car] = CARS, frame_rate: int = FRAME_RATE) -> dict[str, str]:
    """Return the three files of a recording in the format of highD, by the end of their name."""
    rows = [HEADER]
    metas = [
        'id,width,height,initialFrame,finalFrame,numFrames,class,drivingDirection,'
        'traveledDistance,minXVelocity,maxXVelocity,meanXVelocity,minDHW,minTHW,minTTC,'
        'numLaneChanges'
    ]
    for car in cars:
        way, count = _WAY[car.direction], car.frames[1] - car.frames[0] + 1
        kind = 'Truck' if car.length > 8.0 else 'Car'
        distance = car.speed * (count - 1) / frame_rate
        metas.append(
            f'{car.id},{car.length:.2f},{car.width:.2f},{car.frames[0]},{car.frames[1]},{count},'
            f'{kind},{car.direction},{distance:.2f},{way * car.speed:.2f},{way * car.speed:.2f},'
            f'{way * car.speed:.2f},-1.00,-1.00,-1.00,0'
        )
        for frame in range(car.frames[0], car.frames[1] + 1):
            along, right = car.centre(frame)
            edges = MARKINGS[car.direction]
            x = 210.0 + way * along
            y = edges[0] + right if car.direction == 1 else edges[-1] - right
            values = [frame, car.id, x - car.length / 2, y - car.width / 2, car.length, car.width]
            values += [way * car.speed, -way * car.drift, 0, 0, 0, 0, 0, 0, 0, 0]
            rows.append(
                ','.join(f'{value:.4f}'.rstrip('0').rstrip('.') for value in values)
                + ','
                + ','.join(str(number) for number in _neighbours(car, frame, cars))
                + f',{car.lane(frame) + 2}'
            )
    upper, lower = (';'.join(f'{y:.2f}' for y in MARKINGS[number]) for number in (1, 2))
    recording = (
        'id,frameRate,locationId,speedLimit,month,weekDay,startTime,duration,totalDrivenDistance,'
        'totalDrivenTime,numVehicles,numCars,numTrucks,upperLaneMarkings,lowerLaneMarkings\n'
        f'1,{frame_rate},2,-1.00,9.2017,Tue,08:38,0.48,100.0,3.0,{len(cars)},5,2,{upper},{lower}\n'
    )
    return {
        'tracks': '\n'.join(rows) + '\n',
        'tracksMeta': '\n'.join(metas) + '\n',
        'recordingMeta': recording,
    }


def _neighbours(car: Car, frame: int, cars: Sequence[Car]) -> list[int]:
    """Return the eight ids of neighbours in the order of the columns."""
    found: dict[tuple[int, str], tuple[float, int]] = {}
    along, _ = car.centre(frame)
    for other in cars:
        there = other.frames[0] <= frame <= other.frames[1]
        if other is car or other.direction != car.direction or not there:
            continue
        side, ahead = other.lane(frame) - car.lane(frame), other.centre(frame)[0] - along
        beside = abs(ahead) < (car.length + other.length) / 2
        place = 'alongside' if beside and side else 'ahead' if ahead > 0 else 'behind'
        key = (side, place)
        found[key] = min(found.get(key, (float('inf'), 0)), (abs(ahead), other.id))
    keys = [(0, 'ahead'), (0, 'behind')]
    keys += [(side, place) for side in (1, -1) for place in ('ahead', 'alongside', 'behind')]
    return [found.get(key, (0.0, 0))[1] for key in keys]


def write_highd(folder: Path, texts: dict[str, str] | None = None) -> Path:
    """Write a recording in the format of highD and return its file of tracks."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in (texts or highd_texts()).items():
        (folder / f'01_{name}.csv').write_text(text)
    return folder / '01_tracks.csv'


SCHEMA = """
CREATE TABLE Spec (key TEXT PRIMARY KEY, value TEXT);
CREATE TABLE Vehicle (id INTEGER PRIMARY KEY, type INTEGER, length, width, height REAL,
                      is_ego_vehicle INTEGER);
CREATE TABLE Trajectory (vehicle_id INTEGER, sim_time, position_x, position_y, heading_rad, speed,
                         lane_id);
"""
EAST = 4.71238898038469


def write_ngsim(path: Path, *commands: str) -> Path:
    """Write four vehicles on three lanes towards +x as SQLite; then run SQL commands on it."""
    with sqlite3.connect(path) as database:
        database.executescript(SCHEMA)
        spec = {
            'source_type': 'NGSIM', 'default_heading': EAST, 'map_lane_width': 4.0, 'name': 'made',
        }  # fmt: skip
        database.executemany('INSERT INTO Spec VALUES (?, ?)', spec.items())
        cars = ((1, 0.0, 10.0, 1), (2, 30.0, 10.0, 1), (3, 5.0, 6.0, 2), (4, -20.0, 2.0, 3))
        for number, x, y, lane in cars:
            database.execute(f'INSERT INTO Vehicle VALUES ({number}, 2, 4.0, 2.0, 1.5, 0)')
            for step in range(60):
                row = (number, step / 10, x + step, y, EAST, 10.0, lane)
                database.execute('INSERT INTO Trajectory VALUES (?, ?, ?, ?, ?, ?, ?)', row)
        for command in commands:
            database.execute(command)
    database.close()
    return path


def commonroad_text(version: str = '2020a') -> str:
    """Return a scenario: three lanes along +x, 4 m wide, and three vehicles over five steps.

    Lanelet 1 is on the left, 3 on the right; 2 is continued by 4.
    """
    text = [f'<?xml version="1.0"?>\n<commonRoad commonRoadVersion="{version}" timeStepSize="0.1">']
    for number, top, begin, end in (
        (1, 12, 0, 200),
        (2, 8, 0, 100),
        (3, 4, 0, 200),
        (4, 8, 100, 200),
    ):
        text.append(f'<lanelet id="{number}">')
        for bound, y in (('leftBound', top), ('rightBound', top - 4)):
            points = ''.join(
                f'<point><x>{x}</x><y>{y}</y></point>' for x in range(begin, end + 1, 50)
            )
            text.append(f'<{bound}>{points}</{bound}>')
        text += {
            1: ['<adjacentRight ref="2" drivingDir="same"/>'],
            2: ['<successor ref="4"/>', '<adjacentLeft ref="1" drivingDir="same"/>',
                '<adjacentRight ref="3" drivingDir="same"/>'],
            3: ['<adjacentLeft ref="2" drivingDir="same"/>'],
            4: ['<predecessor ref="2"/>', '<adjacentLeft ref="1" drivingDir="same"/>',
                '<adjacentRight ref="3" drivingDir="same"/>'],
        }[number]  # fmt: skip
        text.append('</lanelet>')
    role = '<role>dynamic</role>' if version == '2018b' else ''
    tag = 'obstacle' if version == '2018b' else 'dynamicObstacle'
    for number, x, y in ((11, 80.0, 6.0), (12, 110.0, 6.5), (13, 82.0, 10.0)):
        shape = '<rectangle><length>4.0</length><width>2.0</width></rectangle>'
        states = [
            f'<position><point><x>{x + step * 2.0}</x><y>{y}</y></point></position>'
            '<orientation><exact>0.0</exact></orientation>'
            f'<time><exact>{step}</exact></time><velocity><exact>20.0</exact></velocity>'
            for step in range(5)
        ]
        text.append(f'<{tag} id="{number}">{role}<type>car</type><shape>{shape}</shape>')
        text.append(f'<initialState>{states[0]}</initialState><trajectory>')
        text += [f'<state>{state}</state>' for state in states[1:]]
        text.append(f'</trajectory></{tag}>')
    return '\n'.join([*text, '</commonRoad>', ''])


def told(function: Callable[..., Any], *arguments: Any) -> tuple[str, Any]:
    """Call a function; return the sentence of its error and nothing, or no sentence and a value."""
    try:
        return '', function(*arguments)
    except OccError as error:
        return str(error), None
