# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Synthetic drives of many kinds of robots, for tests: what their topics say, with planted faults.

Values are made up; message types are those of ROS 2 and of public packages, whose definitions are
written here by their fields. A drive is smooth, and no two seeds give the same; a fault lasts from
half of the drive to three quarters.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from mcap.writer import Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

START_NS = 1_700_000_000_000_000_000
SECONDS = 40.0

DEFINITIONS = {
    'px4_msgs/msg/VehicleOdometry': """
uint32 MESSAGE_VERSION = 0
uint64 timestamp
uint64 timestamp_sample
uint8 pose_frame
uint8 POSE_FRAME_NED = 1
float32[3] position
float32[4] q
uint8 velocity_frame
float32[3] velocity
float32[3] angular_velocity
float32[3] position_variance
float32[3] velocity_variance
uint8 reset_counter
int8 quality
""",
    'px4_msgs/msg/BatteryStatus': """
uint64 timestamp
bool connected
float32 voltage_v
float32 current_a
float32 discharged_mah
float32 remaining
float32 temperature
uint8 cell_count
uint16 cycle_count
uint8 id
""",
    'px4_msgs/msg/VehicleStatus': """
uint64 timestamp
uint64 armed_time
uint8 arming_state
uint8 nav_state
bool failsafe
""",
    'unitree_go/msg/IMUState': """
float32[4] quaternion
float32[3] gyroscope
float32[3] accelerometer
float32[3] rpy
int8 temperature
""",
    'unitree_go/msg/MotorState': """
uint8 mode
float32 q
float32 dq
float32 tau_est
int8 temperature
uint32 lost
""",
    'unitree_go/msg/LowState': """
uint8[2] head
uint32[2] sn
uint16 bandwidth
unitree_go/IMUState imu_state
unitree_go/MotorState[12] motor_state
int16[4] foot_force
uint32 tick
float32 power_v
float32 power_a
uint32 crc
""",
    'control_msgs/msg/JointTrajectoryControllerState': """
std_msgs/Header header
string[] joint_names
trajectory_msgs/JointTrajectoryPoint desired
trajectory_msgs/JointTrajectoryPoint actual
trajectory_msgs/JointTrajectoryPoint error
""",
    'ackermann_msgs/msg/AckermannDrive': """
float32 steering_angle
float32 steering_angle_velocity
float32 speed
float32 acceleration
float32 jerk
""",
    'ackermann_msgs/msg/AckermannDriveStamped': """
std_msgs/Header header
ackermann_msgs/AckermannDrive drive
""",
    'vesc_msgs/msg/VescState': """
int32 FAULT_CODE_NONE=0
float64 temperature_fet
float64 current_motor
float64 current_input
float64 duty_cycle
float64 speed
float64 voltage_input
float64 charge_drawn
float64 energy_drawn
int32 displacement
int32 distance_traveled
int32 fault_code
""",
    'vesc_msgs/msg/VescStateStamped': """
std_msgs/Header header
vesc_msgs/VescState state
""",
    'autoware_vehicle_msgs/msg/VelocityReport': """
std_msgs/Header header
float32 longitudinal_velocity
float32 lateral_velocity
float32 heading_rate
""",
    'autoware_vehicle_msgs/msg/SteeringReport': """
builtin_interfaces/Time stamp
float32 steering_tire_angle
""",
    'autoware_control_msgs/msg/Lateral': """
builtin_interfaces/Time stamp
float32 steering_tire_angle
float32 steering_tire_rotation_rate
""",
    'autoware_control_msgs/msg/Longitudinal': """
builtin_interfaces/Time stamp
float32 velocity
float32 acceleration
float32 jerk
""",
    'autoware_control_msgs/msg/Control': """
builtin_interfaces/Time stamp
autoware_control_msgs/Lateral lateral
autoware_control_msgs/Longitudinal longitudinal
""",
    'irobot_create_msgs/msg/HazardDetection': """
uint8 BACKUP_LIMIT=0
uint8 BUMP=1
uint8 CLIFF=2
uint8 STALL=3
uint8 WHEEL_DROP=4
uint8 OBJECT_PROXIMITY=5
std_msgs/Header header
uint8 type
""",
    'irobot_create_msgs/msg/HazardDetectionVector': """
std_msgs/Header header
irobot_create_msgs/HazardDetection[] detections
""",
    'irobot_create_msgs/msg/WheelStatus': """
std_msgs/Header header
int16 current_ma_left
int16 current_ma_right
int16 pwm_left
int16 pwm_right
bool wheels_enabled
""",
    'demo_msgs/msg/ThrusterState': """
std_msgs/Header header
uint32 uptime
uint32 sequence
float32[4] rpm
float32[4] current
float32 setpoint
uint8 mode
""",
}


def _store() -> Any:
    store = get_typestore(Stores.ROS2_JAZZY)
    types: dict[str, Any] = {}
    for name, text in DEFINITIONS.items():
        types |= get_types_from_msg(text, name)
    store.register({name: item for name, item in types.items() if name not in store.fielddefs})
    return store


STORE = _store()


def make(msgtype: str, **fields: Any) -> Any:
    """Return a message; fields that are not given are zeros, as of a fresh message."""
    package, name = msgtype.split('/')
    full = f'{package}/msg/{name}'
    values = {}
    for field, node in STORE.fielddefs[full][1]:
        values[field] = fields[field] if field in fields else _zero(node)
    return STORE.types[full](**values)


def _zero(node: Any) -> Any:
    kind, what = node
    if kind.name == 'BASE':
        return {'string': '', 'bool': False}.get(what[0], 0.0 if 'float' in what[0] else 0)
    if kind.name == 'NAME':
        return make(what.replace('/msg/', '/'))
    (inner, name), length = what
    if inner.name == 'BASE' and name[0] != 'string':
        dtype = {'bool': bool, 'byte': np.uint8, 'char': np.uint8}.get(name[0], name[0])
        return np.zeros(length if kind.name == 'ARRAY' else 0, dtype=dtype)
    return [_zero((inner, name)) for _ in range(length)] if kind.name == 'ARRAY' else []


def write_messages(path: Path, messages: Iterator[tuple[float, str, Any]]) -> Path:
    """Write ``(seconds, topic, message)`` to an MCAP file with definitions; return it."""
    with path.open('wb') as stream:
        writer = Writer(stream)
        writer.start(profile='ros2', library='tests')
        channels: dict[str, int] = {}
        for seconds, topic, message in sorted(messages, key=lambda item: item[0]):
            msgtype = message.__msgtype__
            if topic not in channels:
                schema = writer.register_schema(msgtype, 'ros2msg', definition_of(msgtype).encode())
                channels[topic] = writer.register_channel(topic, 'cdr', schema)
            now = START_NS + round(seconds * 1e9)
            data = bytes(STORE.serialize_cdr(message, msgtype))
            writer.add_message(channels[topic], now, data, now)
        writer.finish()
    return path


def definition_of(msgtype: str) -> str:
    """Return the text of a type and of all that it is made of, as a recorder stores it."""
    texts, wanted, done = [], [msgtype], {msgtype}
    while wanted:
        name = wanted.pop(0)
        text = (
            DEFINITIONS.get(name)
            or STORE.generate_msgdef(name, ros_version=2)[0].split('=' * 80)[0]
        )
        short = name.replace('/msg/', '/')
        texts.append(text if not texts else f'{"=" * 80}\nMSG: {short}\n{text}')
        for _, node in STORE.fielddefs[name][1]:
            while node[0].name in ('ARRAY', 'SEQUENCE'):
                node = node[1][0]
            if node[0].name == 'NAME' and node[1] not in done:
                done.add(node[1])
                wanted.append(node[1])
    return '\n'.join(texts)


@dataclass
class Drive:
    """One drive: its random signals, and the fault planted in it.

    Attributes:
        seed: tells drives of one kind apart.
        fault: name of the fault; empty for none.
    """

    seed: int
    fault: str = ''

    def wave(self, name: str, low: float, high: float, period: float = 7.0) -> Any:
        """Return a smooth function of time that goes to and fro from ``low`` to ``high``.

        Its pace changes and the ends are nearly the same in each drive, as of a task that is done
        again and again.
        """
        rng = np.random.default_rng([self.seed, *name.encode()])
        first, second = rng.uniform(0, math.tau, 2)
        pace, half = rng.uniform(0.95, 1.05), (high - low) / 2 * rng.uniform(0.95, 1.0)
        middle, period = (low + high) / 2, min(period, SECONDS / 4)

        def signal(time: float) -> float:
            turn = math.tau * pace * time / period
            return middle + half * math.sin(turn + first + 0.6 * math.sin(0.37 * turn + second))

        return signal

    def noise(self, name: str, size: float) -> Any:
        """Return a function that gives noise of a standard deviation."""
        rng = np.random.default_rng([self.seed, 99, *name.encode()])
        return lambda: float(np.clip(rng.normal(0.0, size), -3 * size, 3 * size))

    def has(self, fault: str, time: float) -> bool:
        """Tell whether a fault is present."""
        return self.fault == fault and SECONDS / 2 <= time < SECONDS * 0.75


def ticks(rate: float, offset: float = 0.0) -> Iterator[float]:
    """Yield times of messages."""
    return (offset + step / rate for step in range(int(SECONDS * rate)))


def header(time: float, frame: str = 'base_link') -> Any:
    """Return a header with a stamp."""
    return make('std_msgs/Header', stamp=_stamp(time), frame_id=frame)


def _stamp(time: float) -> Any:
    seconds, rest = divmod(START_NS + round(time * 1e9), 10**9)
    return make('builtin_interfaces/Time', sec=seconds, nanosec=rest)


def vector(x: float, y: float, z: float) -> Any:
    """Return a Vector3."""
    return make('geometry_msgs/Vector3', x=x, y=y, z=z)


def quaternion(roll: float, pitch: float, yaw: float) -> tuple[float, float, float, float]:
    """Return w, x, y, z of a rotation by roll, pitch and yaw."""
    cr, cp, cy = (math.cos(angle / 2) for angle in (roll, pitch, yaw))
    sr, sp, sy = (math.sin(angle / 2) for angle in (roll, pitch, yaw))
    return (
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    )


def orientation(roll: float, pitch: float, yaw: float) -> Any:
    """Return the same as a message."""
    w, x, y, z = quaternion(roll, pitch, yaw)
    return make('geometry_msgs/Quaternion', x=x, y=y, z=z, w=w)


def pose(x: float, y: float, z: float, angles: tuple[float, float, float]) -> Any:
    """Return a Pose."""
    point = make('geometry_msgs/Point', x=x, y=y, z=z)
    return make('geometry_msgs/Pose', position=point, orientation=orientation(*angles))


def odometry(time: float, where: Any, linear: Any, turn: float) -> Any:
    """Return an Odometry."""
    twist = make('geometry_msgs/Twist', linear=linear, angular=vector(0.0, 0.0, turn))
    return make(
        'nav_msgs/Odometry',
        header=header(time, 'odom'),
        child_frame_id='base_link',
        pose=make('geometry_msgs/PoseWithCovariance', pose=where),
        twist=make('geometry_msgs/TwistWithCovariance', twist=twist),
    )


def imus(drive: Drive, topic: str, *, sway: float = 0.05, rate: float = 50.0) -> Iterator[Any]:
    """Yield an Imu that sways; the faults ``tilt`` and ``collision`` show in it."""
    roll, pitch = drive.wave('roll', -sway, sway, 5.0), drive.wave('pitch', -sway, sway, 6.0)
    yaw, jolt = drive.wave('yaw', -3.0, 3.0, 40.0), drive.noise('jolt', 0.08)
    for time in ticks(rate):
        lean = 0.6 if drive.has('tilt', time) else 0.0
        hit = 25.0 if drive.has('collision', time) and (time * 2) % 1 < 0.2 else 0.0
        yield (
            time,
            topic,
            make(
                'sensor_msgs/Imu',
                header=header(time, 'imu'),
                orientation=orientation(roll(time) + lean, pitch(time), yaw(time)),
                angular_velocity=vector(roll(time) * 2, pitch(time) * 2, yaw(time) / 5),
                linear_acceleration=vector(
                    9.81 * pitch(time) + jolt() + hit, 9.81 * roll(time) + jolt(), 9.7 + jolt()
                ),
            ),
        )


def batteries(drive: Drive, topic: str, full: float, *, rate: float = 1.0) -> Iterator[Any]:
    """Yield a BatteryState that drains; the fault ``low battery`` shows in it."""
    start = 0.9 - 0.02 * (drive.seed % 3)
    load, ripple = drive.wave('load', -4.0, -1.5), drive.noise('volt', 0.002 * full)
    for time in ticks(rate):
        charge = start - 0.0005 * time
        charge -= 0.6 if drive.has('low battery', time) else 0.0
        yield (
            time,
            topic,
            make(
                'sensor_msgs/BatteryState',
                header=header(time),
                voltage=full * (0.8 + 0.2 * charge) + ripple(),
                percentage=charge,
                current=load(time),
                charge=math.nan,
                capacity=math.nan,
                temperature=math.nan,
                power_supply_status=2,
                present=True,
            ),
        )


def scans(drive: Drive, topic: str, rate: float = 10.0) -> Iterator[Any]:
    """Yield a LaserScan between walls; the fault ``collision`` shows in it."""
    walls = [drive.wave(f'wall{place}', 0.6, 4.0, 11.0 + place) for place in range(8)]
    rng = np.random.default_rng(drive.seed)
    for time in ticks(rate):
        corners = np.array([wall(time) for wall in walls])
        ranges = np.interp(np.arange(180) / 22.5 % 8, np.arange(9), [*corners, corners[0]])
        ranges += rng.normal(0.0, 0.01, 180).clip(-0.03, 0.03)
        if drive.has('collision', time):
            ranges[80:100] = 0.15
        ranges[rng.random(180) < 0.05] = math.inf
        yield (
            time,
            topic,
            make(
                'sensor_msgs/LaserScan',
                header=header(time, 'laser'),
                angle_min=-math.pi,
                angle_max=math.pi - math.tau / 180,
                angle_increment=math.tau / 180,
                range_min=0.1,
                range_max=10.0,
                ranges=ranges.astype(np.float32),
            ),
        )


def rolling(drive: Drive, space: str = '', top: float = 0.6, rate: float = 20.0) -> Iterator[Any]:
    """Yield commands and odometry of a base on wheels; ``too fast``, ``stall``."""
    speed, turn = drive.wave('speed', 0.05, top), drive.wave('turn', -0.8, 0.8, 9.0)
    slip, x = drive.noise('slip', 0.01), 0.0
    for time in ticks(rate):
        wanted, spin = speed(time), turn(time)
        got = speed(max(time - 0.1, 0.0)) + slip()
        if drive.has('stall', time):
            got = 0.0
        if drive.has('too fast', time):
            got = wanted = 2.0 * top
        x += got / rate
        twist = make(
            'geometry_msgs/Twist', linear=vector(wanted, 0.0, 0.0), angular=vector(0.0, 0.0, spin)
        )
        yield time, f'{space}/cmd_vel', twist
        where = pose(x, 0.0, 0.0, (0.0, 0.0, time % 3.0))
        yield (
            time,
            f'{space}/odom',
            odometry(time, where, vector(got, 0.0, 0.0), turn(max(time - 0.1, 0.0)) + slip()),
        )


def joint_state(time: float, values: dict[str, tuple[float, float, float]]) -> Any:
    """Return a JointState of name to position, velocity and effort."""
    table = np.array(list(values.values()), dtype=float)
    return make(
        'sensor_msgs/JointState',
        header=header(time, ''),
        name=list(values),
        position=table[:, 0].copy(),
        velocity=table[:, 1].copy(),
        effort=table[:, 2].copy(),
    )


def joints(drive: Drive, ranges: dict[str, tuple[float, float, float]]) -> Callable[[float], Any]:
    """Return a function of time to the values of joints, with ``stall`` and ``too fast``.

    Args:
        drive: the drive.
        ranges: name to smallest and largest position, and largest effort.
    """
    moves = {
        name: (drive.wave(name, low, high, 8.0), drive.wave(f'{name} load', 0.2 * load, load))
        for name, (low, high, load) in ranges.items()
    }
    # The joint in the middle of the list has the faults.
    bad, rough = list(ranges)[len(ranges) // 2], drive.noise('effort', 0.02)

    def values(time: float) -> dict[str, tuple[float, float, float]]:
        found = {}
        for name, (position, load) in moves.items():
            speed = (position(time + 0.01) - position(time - 0.01)) / 0.02
            effort = load(time) * (1.0 + rough())
            if name == bad and drive.has('stall', time):
                speed, effort = 0.0, 3.0 * ranges[name][2]
            if name == bad and drive.has('too fast', time):
                speed = 12.0
            found[name] = (position(time), speed, effort)
        return found

    return values


ARM = {
    'shoulder_pan_joint': (-1.5, 1.5, 40.0),
    'shoulder_lift_joint': (-2.0, -0.6, 60.0),
    'elbow_joint': (0.6, 2.0, 30.0),
    'wrist_1_joint': (-1.6, 0.2, 8.0),
    'wrist_2_joint': (-1.7, -1.2, 8.0),
    'wrist_3_joint': (-0.5, 0.5, 6.0),
}


def ground(drive: Drive) -> Iterator[Any]:
    """Yield the messages of a robot on wheels with lidar, Imu and battery."""
    yield from rolling(drive)
    yield from scans(drive, '/scan')
    yield from imus(drive, '/imu/data', sway=0.03)
    yield from batteries(drive, '/battery_state', 25.0)


def legged(drive: Drive) -> Iterator[Any]:
    """Yield the messages of a robot on four legs, in one message of its own type."""
    legs = {
        f'{leg}_{joint}': limits
        for leg in ('FR', 'FL', 'RR', 'RL')
        for joint, limits in (
            ('hip', (-0.3, 0.3, 8.0)),
            ('thigh', (0.4, 1.3, 15.0)),
            ('calf', (-2.2, -1.2, 22.0)),
        )
    }
    values = joints(drive, legs)
    roll, pitch = drive.wave('roll', -0.06, 0.06, 2.0), drive.wave('pitch', -0.05, 0.05, 3.0)
    feet = [drive.wave(f'foot{place}', 5.0, 90.0, 1.3) for place in range(4)]
    shake, start = drive.noise('shake', 0.3), 29.0 - 0.1 * (drive.seed % 3)
    for time in ticks(50.0):
        lean = 0.7 if drive.has('tilt', time) else 0.0
        angles = roll(time) + lean, pitch(time), 0.3 * math.sin(time / 9)
        imu = make(
            'unitree_go/IMUState',
            quaternion=np.array(quaternion(*angles), dtype=np.float32),
            gyroscope=np.array([roll(time), pitch(time), 0.03 * math.cos(time / 9)], np.float32),
            accelerometer=np.array([shake(), shake(), 9.81 + shake()], np.float32),
            rpy=np.array(angles, np.float32),
            temperature=60,
        )
        motors = [
            make('unitree_go/MotorState', mode=1, q=q, dq=dq, tau_est=load, temperature=40)
            for q, dq, load in values(time).values()
        ]
        low = 5.0 if drive.has('low battery', time) else 0.0
        yield (
            time,
            '/lowstate',
            make(
                'unitree_go/LowState',
                head=np.array([254, 239], np.uint8),
                sn=np.array([1, 2], np.uint32),
                imu_state=imu,
                motor_state=motors,
                foot_force=np.array([foot(time) for foot in feet], np.int16),
                tick=int(time * 1000) + 1000 * drive.seed,
                power_v=start - 0.002 * time - low,
                power_a=2.0 + abs(roll(time)) * 20,
                crc=int(drive.seed * 1_000_003 + time * 7_919_317) % 2**32,
            ),
        )


def arm(drive: Drive) -> Iterator[Any]:
    """Yield the messages of an arm with a force sensor and a trajectory controller."""
    values, force = joints(drive, ARM), drive.wave('force', 15.0, 30.0)
    lag = {name: drive.wave(f'{name} lag', -0.01, 0.01, 3.0) for name in ARM}
    for time in ticks(50.0):
        yield time, '/joint_states', joint_state(time, values(time))
        hit = 80.0 if drive.has('collision', time) else 0.0
        wrench = make(
            'geometry_msgs/Wrench',
            force=vector(hit, 1.0, -force(time)),
            torque=vector(0.1, 0.2, force(time) / 30),
        )
        yield (
            time,
            '/ft_sensor/wrench',
            make('geometry_msgs/WrenchStamped', header=header(time), wrench=wrench),
        )
        errors = np.array([part(time) for part in lag.values()])
        errors[2] += 0.3 if drive.has('tracking error', time) else 0.0
        point = make('trajectory_msgs/JointTrajectoryPoint', positions=errors)
        yield (
            time,
            '/arm_controller/state',
            make(
                'control_msgs/JointTrajectoryControllerState',
                header=header(time),
                joint_names=list(ARM),
                error=point,
            ),
        )


def arm_with_gripper(drive: Drive) -> Iterator[Any]:
    """Yield the messages of an arm and a gripper, each with a publisher of its own on one topic."""
    values = joints(drive, ARM)
    grip = joints(Drive(drive.seed, ''), {'finger_joint': (0.0, 0.8, 5.0)})
    for time in ticks(50.0):
        yield time, '/joint_states', joint_state(time, values(time))
        position, speed, load = grip(time)['finger_joint']
        load = 20.0 if drive.has('gripper stall', time) else load
        yield (
            time + 0.004,
            '/joint_states',
            joint_state(time + 0.004, {'finger_joint': (position, speed, load)}),
        )


def _flight(drive: Drive) -> Callable[[float], dict[str, Any]]:
    roll, pitch = drive.wave('roll', -0.2, 0.2, 4.0), drive.wave('pitch', -0.2, 0.2, 5.0)
    height, speed = drive.wave('height', 2.0, 12.0, 15.0), drive.wave('speed', 0.5, 5.0)
    course = drive.wave('course', -3.0, 3.0, 30.0)

    def state(time: float) -> dict[str, Any]:
        lean = 0.9 if drive.has('tilt', time) else 0.0
        fast = 8.0 if drive.has('too fast', time) else 0.0
        climb = (height(time + 0.01) - height(time - 0.01)) / 0.02
        ahead, way = speed(time) + fast, course(time)
        return {
            'angles': (roll(time) + lean, pitch(time), way),
            'velocity': (ahead * math.cos(way), ahead * math.sin(way), climb),
            'height': height(time),
            'rates': (roll(time), pitch(time), 0.2 * math.sin(time)),
        }

    return state


def px4(drive: Drive) -> Iterator[Any]:
    """Yield the messages of a quadrotor on PX4: no headers, times since boot, down is positive."""
    state, boot = _flight(drive), 10.0 + 60.0 * drive.seed
    for time in ticks(50.0):
        now, clock = state(time), int((boot + time) * 1e6)
        x, y, z = now['velocity']
        yield (
            time,
            '/fmu/out/vehicle_odometry',
            make(
                'px4_msgs/VehicleOdometry',
                timestamp=clock,
                timestamp_sample=clock - 2000,
                pose_frame=1,
                position=np.array([time, math.sin(time), -now['height']], np.float32),
                q=np.array(quaternion(*now['angles']), np.float32),
                velocity=np.array([x, y, -z], np.float32),
                angular_velocity=np.array(now['rates'], np.float32),
                position_variance=np.array([0.1, 0.1, 0.2], np.float32),
            ),
        )
    start, draw = 16.3 - 0.1 * (drive.seed % 3), drive.wave('draw', 9.0, 15.0)
    for time in ticks(2.0):
        low = 2.5 if drive.has('low battery', time) else 0.0
        yield (
            time,
            '/fmu/out/battery_status',
            make(
                'px4_msgs/BatteryStatus',
                timestamp=int((boot + time) * 1e6),
                connected=True,
                voltage_v=start - 0.01 * time - low,
                current_a=draw(time),
                discharged_mah=3.0 * time,
                remaining=0.9 - 0.001 * time - low / 4,
                cell_count=4,
                cycle_count=12 + drive.seed,
                id=1,
            ),
        )
        yield (
            time,
            '/fmu/out/vehicle_status',
            make(
                'px4_msgs/VehicleStatus',
                timestamp=int((boot + time) * 1e6),
                armed_time=int(boot * 1e6),
                arming_state=2,
                nav_state=14,
            ),
        )


def mavros(drive: Drive) -> Iterator[Any]:
    """Yield the messages of a quadrotor by way of mavros."""
    state, jolt = _flight(drive), drive.noise('jolt', 0.2)
    for time in ticks(30.0):
        now = state(time)
        yield (
            time,
            '/mavros/imu/data',
            make(
                'sensor_msgs/Imu',
                header=header(time),
                orientation=orientation(*now['angles']),
                angular_velocity=vector(*now['rates']),
                linear_acceleration=vector(jolt(), jolt(), 9.81 + jolt()),
            ),
        )
        yield (
            time,
            '/mavros/local_position/pose',
            make(
                'geometry_msgs/PoseStamped',
                header=header(time, 'map'),
                pose=pose(time, math.sin(time), now['height'], now['angles']),
            ),
        )
        twist = make('geometry_msgs/Twist', linear=vector(*now['velocity']))
        yield (
            time,
            '/mavros/local_position/velocity_local',
            make('geometry_msgs/TwistStamped', header=header(time, 'map'), twist=twist),
        )
    for time in ticks(5.0):
        yield (
            time,
            '/mavros/global_position/global',
            make(
                'sensor_msgs/NavSatFix',
                header=header(time),
                latitude=47.0 + 0.001 * drive.seed + 1e-6 * time,
                longitude=8.0,
                altitude=450.0 + state(time)['height'],
            ),
        )
    yield from batteries(drive, '/mavros/battery', 16.8, rate=2.0)


def auv(drive: Drive) -> Iterator[Any]:
    """Yield the messages of an underwater vehicle."""
    depth, speed = drive.wave('depth', 3.0, 20.0, 20.0), drive.wave('speed', 0.2, 1.2)
    ground_at, sway = drive.wave('ground', 26.0, 32.0, 17.0), drive.noise('sway', 0.01)
    for time in ticks(20.0):
        deep = depth(time) + (15.0 if drive.has('too deep', time) else 0.0)
        climb = -(depth(time + 0.01) - depth(time - 0.01)) / 0.02
        twist = make(
            'geometry_msgs/Twist',
            linear=vector(speed(time), sway(), climb),
            angular=vector(0.0, 0.0, 0.2 * math.sin(time / 3)),
        )
        yield (
            time,
            '/dvl/twist',
            make(
                'geometry_msgs/TwistWithCovarianceStamped',
                header=header(time),
                twist=make('geometry_msgs/TwistWithCovariance', twist=twist),
            ),
        )
        yield time, '/depth', make('std_msgs/Float64', data=deep)
        above = 0.4 if drive.has('collision', time) else ground_at(time) - depth(time)
        yield (
            time,
            '/altimeter',
            make(
                'sensor_msgs/Range',
                header=header(time),
                field_of_view=0.1,
                min_range=0.1,
                max_range=50.0,
                range=above,
            ),
        )
        rpm = np.array([800 + 400 * math.sin(time / 2 + place) for place in range(4)], np.float32)
        load = np.array(2.0 + np.abs(rpm) / 400, np.float32)
        load[1] = 30.0 if drive.has('stall', time) else load[1]
        yield (
            time,
            '/thrusters/state',
            make(
                'demo_msgs/ThrusterState',
                header=header(time),
                uptime=int(1000 * drive.seed + time),
                sequence=int(drive.seed * 5000 + time * 20),
                rpm=rpm,
                current=load,
                setpoint=speed(time),
                mode=3,
            ),
        )
    yield from imus(drive, '/imu', sway=0.08)
    yield from batteries(drive, '/battery', 28.0)


def boat(drive: Drive) -> Iterator[Any]:
    """Yield the messages of a boat."""
    speed, course = drive.wave('speed', 0.5, 3.0, 12.0), drive.wave('course', -3.0, 3.0, 30.0)
    rudder, slack = drive.wave('rudder', -0.5, 0.5), drive.noise('slack', 0.01)
    for time in ticks(10.0):
        ahead = speed(time) + (5.0 if drive.has('too fast', time) else 0.0)
        way = course(time)
        twist = make(
            'geometry_msgs/Twist', linear=vector(ahead * math.cos(way), ahead * math.sin(way), 0.0)
        )
        yield time, '/gps/vel', make('geometry_msgs/TwistStamped', header=header(time), twist=twist)
        yield (
            time,
            '/gps/fix',
            make(
                'sensor_msgs/NavSatFix',
                header=header(time),
                latitude=60.0 + 1e-5 * time,
                longitude=20.0 + 0.1 * drive.seed,
                altitude=1.0 + 0.05 * math.sin(time),
            ),
        )
        yield time, '/rudder/command', make('std_msgs/Float32', data=rudder(time))
        yield time, '/rudder/angle', make('std_msgs/Float32', data=rudder(time) + slack())
    yield from imus(drive, '/imu/data', sway=0.12)
    yield from batteries(drive, '/power/battery', 12.8)


def car(drive: Drive) -> Iterator[Any]:
    """Yield the messages of a car with Autoware."""
    speed, steer = drive.wave('speed', 2.0, 14.0, 20.0), drive.wave('steer', -0.2, 0.2, 9.0)
    loose = drive.noise('loose', 0.02)
    for time in ticks(30.0):
        got, fast = speed(time) + loose(), drive.has('too fast', time)
        got = 25.0 if fast else got
        wheel = steer(time) + loose() / 10
        wheel += 0.15 if drive.has('tracking error', time) else 0.0
        yield (
            time,
            '/vehicle/status/velocity_status',
            make(
                'autoware_vehicle_msgs/VelocityReport',
                header=header(time),
                longitudinal_velocity=got,
                heading_rate=got * math.tan(steer(time)) / 2.8,
            ),
        )
        yield (
            time,
            '/vehicle/status/steering_status',
            make(
                'autoware_vehicle_msgs/SteeringReport',
                stamp=_stamp(time),
                steering_tire_angle=wheel,
            ),
        )
        yield (
            time,
            '/control/command/control_cmd',
            make(
                'autoware_control_msgs/Control',
                stamp=_stamp(time),
                lateral=make('autoware_control_msgs/Lateral', steering_tire_angle=steer(time)),
                longitudinal=make(
                    'autoware_control_msgs/Longitudinal', velocity=25.0 if fast else speed(time)
                ),
            ),
        )
    yield from imus(drive, '/sensing/imu/imu_data', sway=0.03)


def racecar(drive: Drive) -> Iterator[Any]:
    """Yield the messages of a small racing car."""
    speed, steer = drive.wave('speed', 0.5, 4.0), drive.wave('steer', -0.35, 0.35, 5.0)
    slip, far = drive.noise('slip', 0.03), 1000.0 * drive.seed
    for time in ticks(40.0):
        got = speed(time) + slip() + (4.0 if drive.has('too fast', time) else 0.0)
        stalled = drive.has('stall', time)
        got, far = 0.0 if stalled else got, far + got / 40
        yield (
            time,
            '/drive',
            make(
                'ackermann_msgs/AckermannDriveStamped',
                header=header(time),
                drive=make(
                    'ackermann_msgs/AckermannDrive', speed=speed(time), steering_angle=steer(time)
                ),
            ),
        )
        yield (
            time,
            '/odom',
            odometry(
                time,
                pose(time, 0.0, 0.0, (0.0, 0.0, steer(time))),
                vector(got, 0.0, 0.0),
                got * math.tan(steer(time)) / 0.33,
            ),
        )
        low = 4.0 if drive.has('low battery', time) else 0.0
        yield (
            time,
            '/sensors/core',
            make(
                'vesc_msgs/VescStateStamped',
                header=header(time),
                state=make(
                    'vesc_msgs/VescState',
                    temperature_fet=35.0 + 3 * math.sin(time / 10),
                    current_motor=60.0 if stalled else 2.0 + 3.0 * got + slip(),
                    current_input=1.0 + got,
                    duty_cycle=got / 20,
                    speed=4000.0 * got,
                    voltage_input=15.8 - 0.1 * (drive.seed % 3) - 0.003 * time - low,
                    charge_drawn=0.01 * time,
                    energy_drawn=0.2 * time,
                    displacement=int(far * 100),
                    distance_traveled=int(far * 100),
                ),
            ),
        )
    yield from scans(drive, '/scan')


def vacuum(drive: Drive) -> Iterator[Any]:
    """Yield the messages of a vacuum cleaner with bumper and cliff sensors."""
    yield from rolling(drive, top=0.3)
    left = drive.wave('left', 60.0, 150.0)
    for time in ticks(25.0):
        kinds = [1] if drive.has('bump', time) else [2] if drive.has('cliff', time) else []
        yield (
            time,
            '/hazard_detection',
            make(
                'irobot_create_msgs/HazardDetectionVector',
                header=header(time),
                detections=[
                    make('irobot_create_msgs/HazardDetection', header=header(time), type=kind)
                    for kind in kinds
                ],
            ),
        )
        load = 900.0 if drive.has('stall', time) else left(time)
        yield (
            time,
            '/wheel_status',
            make(
                'irobot_create_msgs/WheelStatus',
                header=header(time),
                current_ma_left=int(load),
                current_ma_right=int(left(time + 1)),
                pwm_left=60,
                pwm_right=60,
                wheels_enabled=True,
            ),
        )
    yield from imus(drive, '/imu', sway=0.02)
    yield from batteries(drive, '/battery_state', 16.0)


def two_robots(drive: Drive) -> Iterator[Any]:
    """Yield the messages of two robots in one recording, the fault with the second."""
    for number in (1, 2):
        own = Drive(10 * drive.seed + number, drive.fault if number == 2 else '')
        yield from rolling(own, f'/robot{number}')
        yield from scans(own, f'/robot{number}/scan')


def humanoid(drive: Drive) -> Iterator[Any]:
    """Yield the messages of a humanoid: many joints, two feet with force sensors."""
    limits = {
        f'{side}_{name}': item
        for side in ('left', 'right')
        for name, item in {
            'hip_pitch': (-0.8, 0.4, 60.0),
            'hip_roll': (-0.2, 0.2, 50.0),
            'knee': (0.1, 1.4, 90.0),
            'ankle_pitch': (-0.6, 0.3, 40.0),
            'shoulder_pitch': (-0.5, 0.5, 10.0),
            'elbow': (0.2, 1.0, 8.0),
        }.items()
    } | {'waist_yaw': (-0.3, 0.3, 20.0)}
    values = joints(drive, limits)
    feet = [drive.wave(f'foot{place}', 50.0, 600.0, 1.4) for place in range(2)]
    for time in ticks(50.0):
        yield time, '/joint_states', joint_state(time, values(time))
        for side, load in zip(('left', 'right'), feet, strict=True):
            wrench = make('geometry_msgs/Wrench', force=vector(5.0, 3.0, load(time)))
            yield (
                time,
                f'/{side}_foot/wrench',
                make('geometry_msgs/WrenchStamped', header=header(time), wrench=wrench),
            )
    yield from imus(drive, '/imu', sway=0.06)


@dataclass(frozen=True)
class Robot:
    """A kind of robot.

    Attributes:
        messages: of a drive.
        faults: fault to a word that is in the name of a feature that must tell it.
    """

    messages: Callable[[Drive], Iterator[Any]]
    faults: dict[str, str]


ROBOTS = {
    'ground': Robot(
        ground,
        {
            'collision': 'clearance|acceleration',
            'too fast': 'speed',
            'stall': 'speed_error',
            'tilt': 'tilt',
            'low battery': 'battery',
        },
    ),
    'legged': Robot(
        legged, {'tilt': 'tilt', 'stall': 'tau_est', 'low battery': 'power_v', 'too fast': '_dq'}
    ),
    'arm': Robot(
        arm,
        {
            'stall': 'effort',
            'too fast': 'velocity',
            'collision': 'force',
            'tracking error': 'error',
        },
    ),
    'arm_with_gripper': Robot(
        arm_with_gripper, {'stall': 'effort', 'too fast': 'velocity', 'gripper stall': 'finger'}
    ),
    'px4': Robot(px4, {'tilt': 'tilt', 'low battery': 'battery', 'too fast': 'speed'}),
    'mavros': Robot(mavros, {'tilt': 'tilt|roll', 'low battery': 'battery', 'too fast': 'speed'}),
    'auv': Robot(
        auv,
        {
            'collision': 'range',
            'too deep': 'depth',
            'tilt': 'tilt',
            'low battery': 'battery',
            'stall': 'current',
        },
    ),
    'boat': Robot(boat, {'tilt': 'tilt', 'too fast': 'speed', 'low battery': 'battery'}),
    'car': Robot(car, {'too fast': 'velocity', 'tracking error': 'error', 'tilt': 'tilt'}),
    'racecar': Robot(
        racecar,
        {
            'collision': 'clearance',
            'too fast': 'speed',
            'stall': 'current',
            'low battery': 'voltage',
        },
    ),
    'vacuum': Robot(
        vacuum,
        {
            'bump': 'bump',
            'cliff': 'cliff',
            'stall': 'current|error',
            'low battery': 'battery',
            'tilt': 'tilt',
        },
    ),
    'two_robots': Robot(two_robots, {'collision': 'clearance', 'too fast': 'speed'}),
    'humanoid': Robot(humanoid, {'tilt': 'tilt', 'stall': 'effort', 'too fast': 'velocity'}),
}


def write_robot(folder: Path, kind: str, seed: int, fault: str = '') -> Path:
    """Write a drive of a kind of robot; return its file."""
    name = f'{kind}_{seed}{"_" + fault.replace(" ", "_") if fault else ""}.mcap'
    return write_messages(folder / name, ROBOTS[kind].messages(Drive(seed, fault)))
