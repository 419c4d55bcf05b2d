#!/usr/bin/env python3
# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Simulate an arm that moves parts from one side of a table to the other.

It publishes what a real arm does: ``/joint_states`` and ``/joint_commands`` (JointState) and
``/wrist/wrench`` (WrenchStamped), each at 50 Hz, live with rclpy in real time. With ``--bag`` the
same messages go to recordings instead, without ROS and faster than real time. docs/your_arm.md
tells what for.
"""

from __future__ import annotations

import argparse
import itertools
import math
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import mujoco
import numpy as np
from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.rosbag.writer import BagWriter
from occ_constraints_pkg.stopping import stop_request
from rosbags.typesys import Stores, get_typestore

JOINTS = ('base', 'shoulder', 'elbow', 'wrist')
# Height of the shoulder, and lengths of upper arm, forearm and hand, in m.
SHOULDER, UPPER_ARM, FOREARM, HAND = 0.30, 0.35, 0.30, 0.14
BOX_HEIGHT = 0.10
# With all joints at 0 the arm points up. Gravity of the links is compensated, as arms do; that of
# a part in the hand is not.
MJCF = f"""
<mujoco model="arm">
  <compiler angle="radian"/>
  <option timestep="0.002" integrator="implicitfast"/>
  <default>
    <geom contype="0" conaffinity="0" type="capsule"/>
    <joint axis="0 1 0" damping="2" armature="0.1" actuatorgravcomp="true"/>
    <position kp="900" kv="60" forcerange="-80 80"/>
    <default class="solid"><geom contype="1" conaffinity="1"/></default>
  </default>
  <worldbody>
    <geom class="solid" type="plane" size="2 2 0.1"/>
    <body name="box" mocap="true" pos="5 0 0">
      <geom class="solid" type="box" size="0.25 0.25 {BOX_HEIGHT / 2}"/>
    </body>
    <body gravcomp="1">
      <joint name="base" axis="0 0 1"/>
      <geom type="cylinder" fromto="0 0 0 0 0 {SHOULDER}" size="0.06" mass="4"/>
      <body pos="0 0 {SHOULDER}" gravcomp="1">
        <joint name="shoulder"/>
        <geom fromto="0 0 0 0 0 {UPPER_ARM}" size="0.04" mass="2"/>
        <body pos="0 0 {UPPER_ARM}" gravcomp="1">
          <joint name="elbow"/>
          <geom fromto="0 0 0 0 0 {FOREARM}" size="0.03" mass="1.2"/>
          <body pos="0 0 {FOREARM}" gravcomp="1">
            <joint name="wrist"/>
            <site name="wrist"/>
            <geom class="solid" fromto="0 0 0 0 0 {HAND - 0.02}" size="0.02" mass="0.4"/>
            <body name="part" pos="0 0 {HAND}">
              <geom type="box" size="0.02 0.02 0.02" mass="0.001"/>
            </body>
          </body>
        </body>
      </body>
    </body>
  </worldbody>
  <actuator>
    {''.join(f'<position name="{joint}" joint="{joint}"/>' for joint in JOINTS)}
  </actuator>
  <sensor><force site="wrist"/><torque site="wrist"/></sensor>
</mujoco>
"""
CONTROL_SECONDS, PUBLISH_SECONDS = 0.01, 0.02
# Standard deviations of what is measured: rad, rad/s, N m, N, N m.
NOISE = {'position': 2e-4, 'velocity': 5e-3, 'effort': 0.2, 'force': 0.1, 'torque': 0.01}
JOINT_STATE, WRENCH = 'sensor_msgs/msg/JointState', 'geometry_msgs/msg/WrenchStamped'
TOPICS = {
    '/joint_commands': JOINT_STATE,
    '/wrist/wrench': WRENCH,
    '/joint_states': JOINT_STATE,
}
# When the first recording begins; the others follow an hour apart.
BAG_START_NS = 1_700_000_000_000_000_000
STORE = get_typestore(Stores.ROS2_JAZZY)

Message = tuple[float, str, bytes]


def joint_angles(place: np.ndarray) -> np.ndarray:
    """Return the (4,) angles in rad at which the hand points down onto a place.

    Args:
        place: (3,) angle around the base in rad, distance from it and height of the tip in m.
    """
    turn, reach, height = place
    rise = height + HAND - SHOULDER
    cosine = (reach**2 + rise**2 - UPPER_ARM**2 - FOREARM**2) / (2 * UPPER_ARM * FOREARM)
    elbow = math.acos(cosine)
    shoulder = math.atan2(reach, rise) - math.atan2(
        FOREARM * math.sin(elbow), UPPER_ARM + FOREARM * math.cos(elbow)
    )
    return np.array([turn, shoulder, elbow, math.pi - shoulder - elbow])


class Task:
    """Where the tip of the arm should be: over a part, down, up, over a free place, down, up.

    Args:
        rng: draws the places, the weights and how fast this drive is.

    Attributes:
        load: mass in kg of the part in the hand; 0: none.
        is_taking: whether the arm takes a part, on the other side of the table than it puts them.
    """

    def __init__(self, rng: np.random.Generator) -> None:
        self._rng = rng
        self._pace = rng.uniform(0.85, 1.15)
        self._from = self._to = np.array([-0.7, 0.4, 0.2])
        self._begin = self._end = 0.0
        self._moves = self._endless_moves()
        self.load, self.is_taking = 0.0, True

    def place(self, now: float) -> np.ndarray:
        """Return the (3,) place of the tip at a time in s, which never goes back."""
        while now >= self._end:
            self._from, (self._to, seconds) = self._to, next(self._moves)
            self._begin, self._end = self._end, self._end + seconds * self._pace
        part = (now - self._begin) / (self._end - self._begin)
        # Of all moves from rest to rest the one with the least jerk.
        return self._from + (self._to - self._from) * part**3 * (10 - 15 * part + 6 * part**2)

    def _endless_moves(self) -> Iterator[tuple[np.ndarray, float]]:
        """Yield where to move next, and how many seconds that takes at a pace of 1."""
        while True:
            for side in (-1, 1):
                self.is_taking = side < 0
                place = np.array([side * self._rng.uniform(0.45, 0.95), 0.0, 0.0])
                place[1] = self._rng.uniform(0.34, 0.48)
                over, down = (place + [0, 0, height] for height in (0.2, 0.03))
                yield over, 1.6
                yield down, 0.8
                yield down, 0.2
                self.load = self._rng.uniform(0.2, 0.6) if side < 0 else 0.0
                yield down, 0.2
                yield over, 0.8


class Arm:
    """The simulated arm.

    Args:
        seed: of the task and of the noise.
        box_at: seconds after which a box is left where the arm puts its parts; None: never.
    """

    def __init__(self, seed: int, box_at: float | None = None) -> None:
        self._model = mujoco.MjModel.from_xml_string(MJCF)
        self._data = mujoco.MjData(self._model)
        self._rng = np.random.default_rng(seed)
        self._task = Task(self._rng)
        self._box_at = math.inf if box_at is None else box_at
        self._part = self._model.body('part').id
        self._data.qpos[:] = self._data.ctrl[:] = joint_angles(self._task.place(0.0))

    def messages(self, seconds: float, start_ns: int) -> Iterator[Message]:
        """Yield time in s from the start, topic and serialized message, in order of time.

        Args:
            seconds: how long.
            start_ns: the stamp that stands for 0 s, in ns.
        """
        ticks = round(PUBLISH_SECONDS / CONTROL_SECONDS)
        for tick in range(round(seconds / CONTROL_SECONDS)):
            now = tick * CONTROL_SECONDS
            self._step(now)
            if tick % ticks == 0:
                stamp = start_ns + round(now * 1e9)
                for topic, data in self._readings(stamp).items():
                    yield now, topic, data

    def _step(self, now: float) -> None:
        self._data.ctrl[:] = joint_angles(self._task.place(now))
        self._model.body_mass[self._part] = 0.001 + self._task.load
        # It is put down while the arm is away.
        if now >= self._box_at and self._task.is_taking:
            self._data.mocap_pos[0] = [0.31, 0.26, BOX_HEIGHT / 2]
            self._box_at = math.inf
        steps = round(CONTROL_SECONDS / self._model.opt.timestep)
        mujoco.mj_step(self._model, self._data, steps)

    def _readings(self, stamp: int) -> dict[str, bytes]:
        data, types = self._data, STORE.types
        zeros = np.zeros(0)
        header = types['std_msgs/msg/Header'](
            types['builtin_interfaces/msg/Time'](*divmod(stamp, 10**9)), ''
        )
        force, torque = self._noisy('force', data.sensordata[:3]), data.sensordata[3:]
        vector = types['geometry_msgs/msg/Vector3']
        wrench = types['geometry_msgs/msg/Wrench'](
            vector(*force), vector(*self._noisy('torque', torque))
        )
        joint_state = types[JOINT_STATE]
        measured = joint_state(
            header,
            list(JOINTS),
            self._noisy('position', data.qpos),
            self._noisy('velocity', data.qvel),
            self._noisy('effort', data.qfrc_actuator),
        )
        # The measured last: so each row of features has the command and the force of its time.
        messages = {
            '/joint_commands': joint_state(header, list(JOINTS), data.ctrl.copy(), zeros, zeros),
            '/wrist/wrench': types[WRENCH](header, wrench),
            '/joint_states': measured,
        }
        return {
            topic: bytes(STORE.serialize_cdr(message, message.__msgtype__))
            for topic, message in messages.items()
        }

    def _noisy(self, what: str, values: np.ndarray) -> np.ndarray:
        return values + self._rng.normal(0.0, NOISE[what], len(values))


def record(path: Path, arm: Arm, seconds: float, start_ns: int) -> None:
    """Write a drive to a new recording."""
    with BagWriter(path) as bag:
        for now, topic, data in arm.messages(seconds, start_ns):
            bag.write(topic, TOPICS[topic], data, start_ns + round(now * 1e9))


def publish(arm: Arm, seconds: float) -> None:
    """Publish a drive in real time, until it is over or interrupted."""
    import rclpy
    from geometry_msgs.msg import WrenchStamped
    from rclpy.duration import Duration
    from rclpy.signals import SignalHandlerOptions
    from sensor_msgs.msg import JointState

    # A signal is to end the drive between two messages, not the context in the middle of one.
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    node = rclpy.create_node('arm')
    types = {JOINT_STATE: JointState, WRENCH: WrenchStamped}
    publishers = {
        topic: node.create_publisher(types[kind], topic, 100) for topic, kind in TOPICS.items()
    }
    begin, start_ns = time.monotonic(), node.get_clock().now().nanoseconds
    for now, topic, data in arm.messages(seconds, start_ns):
        time.sleep(max(0.0, begin + now - time.monotonic()))
        if stop_request.made:
            break
        publishers[topic].publish(data)
    for publisher in publishers.values():
        publisher.wait_for_all_acked(Duration(seconds=1))
    node.destroy_node()
    rclpy.try_shutdown()


def main() -> int:
    """Publish a drive, or record some."""
    parser = argparse.ArgumentParser(description=__doc__.partition('\n')[0])
    parser.add_argument('--seed', type=int, default=1, help='another seed, another drive')
    parser.add_argument('--seconds', type=float, default=30.0, help='how long a drive is')
    parser.add_argument(
        '--box-at', type=float, metavar='SECONDS', help='leave a box in the way after so long'
    )
    parser.add_argument('--bag', type=Path, help='record to this new bag instead of publishing')
    parser.add_argument(
        '--count', type=int, help='record so many, to BAG_01, BAG_02 ... with seeds from SEED on'
    )
    options = parser.parse_args()
    if options.bag is None:
        if options.count is not None:
            parser.error('--count needs --bag')
        with stop_request.listening():
            publish(Arm(options.seed, options.box_at), options.seconds)
        return 0
    if options.count is None:
        bags = {options.seed: options.bag}
    else:
        names = (f'{options.bag.name}_{number:02}' for number in range(1, options.count + 1))
        bags = dict(zip(itertools.count(options.seed), map(options.bag.with_name, names)))
    try:
        for seed, path in bags.items():
            arm = Arm(seed, options.box_at)
            record(path, arm, options.seconds, BAG_START_NS + seed * 3600 * 10**9)
    except OccError as error:
        print(f'error: {error}', file=sys.stderr)
        return 2
    return 0


if __name__ == '__main__':
    try:
        sys.exit(main())
    except KeyboardInterrupt:
        sys.exit(130)
