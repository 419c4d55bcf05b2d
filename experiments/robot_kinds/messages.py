# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Messages of many kinds of robots, from definitions written here, and files of them.

Message types are those of ROS 2 and of public packages, whose definitions are written here by their
fields.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from mcap.writer import Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

START_NS = 1_700_000_000_000_000_000

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


def write_messages(path: Path, messages: Iterable[tuple[float, str, Any]]) -> Path:
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
