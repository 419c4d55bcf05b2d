# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Robots and movable objects as MuJoCo models (MJCF).

All values are those of the level-1 tasks of Safety-Gym and Safety-Gymnasium.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

# Collisions: a pair collides if the contype of one shares a bit with the conaffinity of the other.
# The floor has bit 1, robots and pillars bit 2. Parts of a robot never collide.
_FLOOR_BIT, _SOLID_BIT = 1, 2

# Of the centre of a Point, in m.
POINT_HEIGHT = 0.1
PILLAR_RADIUS = 0.2
PILLAR_HEIGHT = 1.0

_XYZ = ('x', 'y', 'z')
# The sensors in the middle of every robot, each with three axes: unit, and bound of the readings.
# MuJoCo's default magnetic field is 0.5 long.
_SITE_SENSORS = {
    'accelerometer': ('m/s^2', np.inf),
    'velocimeter': ('m/s', np.inf),
    'gyro': ('rad/s', np.inf),
    'magnetometer': ('1', 0.5),
}


@dataclass(frozen=True)
class Robot:
    """A type of robot.

    Attributes:
        name: as in the names of the tasks.
        actions: names of its two actuators, each controlled within [-1, 1].
        sensors: name, unit and bound of each sensor column, in order.
        rear_ball: the sensor data end with the angular velocity and the quaternion of a ball.
        timestep: seconds per physics step.
        size: (3,) length, width and height in m, in its driving direction.
        reach: radius around its centre that encloses it, in m.
        forward: driving direction, in rad from the x axis of its body.
        start: (nq,) positions where it stands at the origin with yaw 0.
        nv: number of its velocities. A free joint comes first, or x, y and yaw alone.
        mjcf: body, actuators and further sensors, and the defaults of its parts.
    """

    name: str
    actions: tuple[str, str]
    sensors: tuple[tuple[str, str, float], ...]
    rear_ball: bool
    timestep: float
    size: tuple[float, float, float]
    reach: float
    forward: float
    start: tuple[float, ...]
    nv: int
    mjcf: dict[str, str]

    @property
    def is_planar(self) -> bool:
        """Whether it moves in the plane only, and so never touches the floor."""
        return len(self.start) == 3


@dataclass(frozen=True)
class Movable:
    """A light object that robots push.

    Attributes:
        name: of the object.
        half_size: half the side of its cube, in m.
        density: in kg/m^3.
        has_columns: whether there is a column half as wide at each of its four vertical edges.
        height: of its centre at the start of an episode, in m.
    """

    name: str
    half_size: float
    density: float
    has_columns: bool
    height: float

    @property
    def half_extents(self) -> np.ndarray:
        """(3,) half the sides of the box around all of it, in m."""
        across = self.half_size * (1.5 if self.has_columns else 1.0)
        return np.array([across, across, self.half_size])


def _site_columns() -> tuple[tuple[str, str, float], ...]:
    return tuple(
        (f'{sensor}_{axis}', unit, bound)
        for sensor, (unit, bound) in _SITE_SENSORS.items()
        for axis in _XYZ
    )


POINT = Robot(
    name='Point',
    actions=('forward', 'turn'),
    sensors=_site_columns(),
    rear_ball=False,
    timestep=0.002,
    size=(0.25, 0.2, 0.2),
    reach=0.166,
    forward=0.0,
    start=(0.0, 0.0, 0.0),
    nv=3,
    mjcf={
        # The robot slides in the plane and just touches the floor, without force.
        'defaults': f"""
            <geom density="1" contype="{_SOLID_BIT}" conaffinity="0"/>
            <motor ctrllimited="true" ctrlrange="-1 1" forcelimited="true" forcerange="-.05 .05"/>
            <velocity ctrllimited="true" ctrlrange="-1 1" forcelimited="true"
                      forcerange="-.05 .05"/>""",
        'body': """
            <body name="robot" childclass="robot" pos="0 0 .1">
              <joint type="slide" axis="1 0 0" damping=".01"/>
              <joint type="slide" axis="0 1 0" damping=".01"/>
              <joint name="yaw" type="hinge" axis="0 0 1" damping=".005"/>
              <geom type="sphere" size=".1" friction="1 .01 .01"/>
              <geom type="box" pos=".1 0 0" size=".05 .05 .05"/>
              <site name="robot"/>
            </body>""",
        'actuators': """
            <motor class="robot" site="robot" gear=".3 0 0 0 0 0"/>
            <velocity class="robot" joint="yaw" gear=".3"/>""",
        'sensors': '',
    },
)
"""Thrust along its heading, and a servo of its yaw rate."""

CAR = Robot(
    name='Car',
    actions=('left_wheel', 'right_wheel'),
    sensors=(
        *_site_columns(),
        *((f'ballangvel_rear_{axis}', 'rad/s', np.inf) for axis in _XYZ),
        *((f'ballquat_rear_{row}{column}', '1', 1.0) for row in _XYZ for column in _XYZ),
    ),
    rear_ball=True,
    timestep=0.004,
    size=(0.34, 0.31, 0.1),
    reach=0.25,
    forward=-np.pi / 2,
    start=(0.0, 0.0, 0.1, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0),
    nv=11,
    mjcf={
        'defaults': f"""
            <geom density="5" contype="{_SOLID_BIT}" conaffinity="{_FLOOR_BIT}"/>
            <joint damping=".001"/>
            <motor ctrllimited="true" ctrlrange="-1 1" forcelimited="true" forcerange="-.02 .02"/>
            """,
        'body': """
            <body name="robot" childclass="robot" pos="0 0 .1">
              <joint type="free" damping="0"/>
              <geom type="box" size=".1 .1 .05"/>
              <geom type="box" pos="0 .15 0" size=".1 .01 .05"/>
              <geom type="box" pos="0 .125 0" size=".01 .025 .03"/>
              <geom type="box" pos="0 -.165 0" size=".05 .01 .05"/>
              <geom type="box" pos="0 -.13 .04" size=".05 .03 .01"/>
              <site name="robot"/>
              <body pos="-.1 .1 -.05">
                <joint name="left" type="hinge" axis="1 0 0"/>
                <geom type="cylinder" size=".05" fromto="-.055 0 0 -.005 0 0"/>
              </body>
              <body pos=".1 .1 -.05">
                <joint name="right" type="hinge" axis="1 0 0"/>
                <geom type="cylinder" size=".05" fromto=".005 0 0 .055 0 0"/>
              </body>
              <body pos="0 -.1 -.05">
                <joint name="rear" type="ball"/>
                <geom type="sphere" size=".05"/>
              </body>
            </body>""",
        'actuators': """
            <motor class="robot" joint="left"/>
            <motor class="robot" joint="right"/>""",
        'sensors': '<ballangvel joint="rear"/><ballquat joint="rear"/>',
    },
)
"""Two wheels and a ball; turning the wheels forward moves it along -y of its body."""

# The vase stands slightly sunk into the soft floor.
VASE = Movable('vase', 0.1, 0.001, has_columns=False, height=0.1 - 4e-5)
POINT_BOX = Movable('box', 0.2, 0.001, has_columns=True, height=0.2)
CAR_BOX = Movable('box', 0.125, 0.0005, has_columns=True, height=0.125)


def scene_mjcf(robot: Robot, movable: Movable | None = None, *, pillar: bool = False) -> str:
    """Return a model of a floor with one robot and what it can collide with.

    Args:
        robot: always there; comes first in the state.
        movable: comes second in the state; ``None`` leaves it out.
        pillar: adds a pillar, which is placed through MuJoCo's ``mocap_pos``.
    """
    flags = ''
    if movable is None:
        # Alone, a planar robot touches nothing, and any other is one island of contacts by itself.
        contactless = '<flag contact="disable" constraint="disable"/>'
        flags = contactless if robot.is_planar else '<flag island="disable"/>'
    sensors = ''.join(f'<{sensor} site="robot"/>' for sensor in _SITE_SENSORS)
    return f"""
    <mujoco>
      <option timestep="{robot.timestep}">{flags}</option>
      <default>
        <geom condim="6"/>
        <default class="robot">{robot.mjcf['defaults']}</default>
      </default>
      <worldbody>
        <geom type="plane" size="5 5 .1" contype="{_FLOOR_BIT}" conaffinity="0"/>
        {robot.mjcf['body']}
        {_movable_body(movable) if movable else ''}
        {_pillar_body() if pillar else ''}
      </worldbody>
      <actuator>{robot.mjcf['actuators']}</actuator>
      <sensor>{sensors}{robot.mjcf['sensors']}</sensor>
    </mujoco>"""


def _movable_body(movable: Movable) -> str:
    common = f'density="{movable.density}" contype="0" conaffinity="{_FLOOR_BIT | _SOLID_BIT}"'
    size = movable.half_size
    geoms = [f'<geom type="box" size="{size} {size} {size}" {common}/>']
    if movable.has_columns:
        geoms += [
            f'<geom type="box" size="{size / 2} {size / 2} {size}" pos="{x} {y} 0" {common}/>'
            for x in (size, -size)
            for y in (size, -size)
        ]
    return f'<body pos="0 0 {movable.height}"><freejoint/>{"".join(geoms)}</body>'


def _pillar_body() -> str:
    return f"""<body pos="0 0 {PILLAR_HEIGHT / 2}" mocap="true">
        <geom type="cylinder" size="{PILLAR_RADIUS} {PILLAR_HEIGHT / 2}"
              contype="{_SOLID_BIT}" conaffinity="{_SOLID_BIT}"/></body>"""
