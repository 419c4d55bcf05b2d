# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""What can be seen without ROS: Python, extras, variables, clock, disk."""

from __future__ import annotations

import os
import shutil
import sys
import time
from datetime import UTC, datetime
from importlib.util import find_spec
from pathlib import Path

import numpy as np

import occ_constraints_pkg
from occ_constraints_pkg.doctor.findings import NOTE, OK, PROBLEM, Finding
from occ_constraints_pkg.errors import EXTRAS
from occ_constraints_pkg.ros.environment import check_clock, check_domain, check_memory

_TESTED = ((3, 11), (3, 13))
# What the nodes import of ROS beside rclpy.
_INTERFACES = (
    'builtin_interfaces',
    'diagnostic_msgs',
    'geometry_msgs',
    'lifecycle_msgs',
    'nav_msgs',
    'rcl_interfaces',
    'rosgraph_msgs',
    'sensor_msgs',
    'std_msgs',
    'std_srvs',
    'visualization_msgs',
)
_USES = {
    'train': 'worlds and training',
    'report': 'pictures and the live view',
    'dashboard': 'the page of all robots',
}
# Domains above use ports that Linux also hands out by itself.
_LAST_GOOD_DOMAIN = 101
_RANGES = ('SUBNET', 'LOCALHOST', 'OFF', 'SYSTEM_DEFAULT')
# Files that configure the middleware.
_PROFILES = ('FASTDDS_DEFAULT_PROFILES_FILE', 'FASTRTPS_DEFAULT_PROFILES_FILE', 'CYCLONEDDS_URI')
# No clock that is right shows a time before this program was written.
_EARLIEST = datetime(2025, 1, 1, tzinfo=UTC)
_GIB = 2**30
_LEAST_DISK, _LITTLE_DISK = 1 * _GIB, 10 * _GIB
_LEAST_SHARED = 16 * 2**20
_SHARED_MEMORY = Path('/dev/shm')
_JAZZY = Path('/opt/ros/jazzy/setup.bash')


def python() -> Finding:
    """Look at the interpreter."""
    version = sys.version_info[:2]
    text = f'{".".join(map(str, sys.version_info[:3]))} at {sys.executable}'
    first, last = (f'{one}.{two}' for one, two in _TESTED)
    if version < _TESTED[0]:
        return Finding('python', PROBLEM, text, f'use Python {first} to {last}')
    if version > _TESTED[1]:
        return Finding('python', NOTE, text, f'this release was tested with {first} to {last}')
    return Finding('python', OK, text)


def package() -> Finding:
    """Look at this package."""
    where = Path(occ_constraints_pkg.__file__).parent
    version = occ_constraints_pkg.__version__
    return Finding(
        'package', OK, f'occ_constraints_pkg {version} at {where}, NumPy {np.__version__}'
    )


def extra(name: str) -> Finding:
    """Look at the packages of an extra, without importing them."""
    needed = [module for module, of in EXTRAS.items() if of == name]
    missing = [module for module in needed if find_spec(module) is None]
    if not missing:
        return Finding(f'extra {name}', OK, f'{", ".join(needed)} are there')
    return Finding(
        f'extra {name}',
        NOTE,
        f'{", ".join(missing)} not installed; needed for {_USES[name]}',
        f"pip install 'occ_constraints_pkg[{name}]'",
    )


def ros_packages() -> Finding:
    """Look for rclpy and the interfaces, without importing them."""
    missing = [name for name in ('rclpy', *_INTERFACES) if find_spec(name) is None]
    if not missing:
        return Finding('ROS packages', OK, f'rclpy and {len(_INTERFACES)} packages of interfaces')
    pip = "pip install 'occ_constraints_pkg[ros]'"
    advice = f'source {_JAZZY} with its Python 3.12, or {pip}' if _JAZZY.exists() else pip
    return Finding(
        'ROS packages', PROBLEM, f'{", ".join(missing)} not installed; nodes need them', advice
    )


def domain() -> Finding:
    """Look at the variables that decide who hears whom."""
    check_domain()
    number = int(os.environ.get('ROS_DOMAIN_ID', '').strip() or 0)
    reach = os.environ.get('ROS_AUTOMATIC_DISCOVERY_RANGE', '')
    text = f'ROS_DOMAIN_ID {number}, discovery range {reach or "SUBNET (default)"}'
    if os.environ.get('ROS_LOCALHOST_ONLY', '0') not in ('', '0'):
        text += ', ROS_LOCALHOST_ONLY'
    for name in ('ROS_STATIC_PEERS', 'ROS_DISCOVERY_SERVER'):
        if os.environ.get(name):
            text += f', {name} {os.environ[name]}'
    if reach not in ('', *_RANGES):
        advice = f'ROS_AUTOMATIC_DISCOVERY_RANGE: allowed are {", ".join(_RANGES)}, or no value'
        return Finding('domain', PROBLEM, text, advice)
    if reach == 'OFF':
        advice = 'unset ROS_AUTOMATIC_DISCOVERY_RANGE; with OFF no node hears another one'
        return Finding('domain', PROBLEM, text, advice)
    for name in _PROFILES:
        path = os.environ.get(name, '').removeprefix('file://')
        if path and not path.startswith('<') and not Path(path).is_file():
            return Finding('domain', PROBLEM, f'{name} names {path}', 'there is no such file')
    if number > _LAST_GOOD_DOMAIN:
        advice = f'ports of domains above {_LAST_GOOD_DOMAIN} may be taken; choose a smaller one'
        return Finding('domain', NOTE, text, advice)
    return Finding('domain', OK, text)


def memory() -> Finding:
    """Look at what the middleware needs of memory."""
    check_memory()
    if not _SHARED_MEMORY.is_dir() or not os.access(_SHARED_MEMORY, os.W_OK):
        text = f'{_SHARED_MEMORY} cannot be written to; messages go over the network stack'
        return Finding('memory', NOTE, text, 'mount it; for Docker: --ipc=host or --shm-size=256m')
    free = shutil.disk_usage(_SHARED_MEMORY).free
    text = f'{free / 2**20:.0f} MiB of shared memory are free'
    if free < _LEAST_SHARED:
        advice = f'remove what is left in {_SHARED_MEMORY}; for Docker: --shm-size=256m'
        return Finding('memory', PROBLEM, text, advice)
    return Finding('memory', OK, text)


def clock() -> Finding:
    """Look at the system's clock."""
    check_clock()
    now = datetime.fromtimestamp(time.time(), UTC)
    text = f'the system shows {now:%Y-%m-%d %H:%M:%S} UTC'
    if now < _EARLIEST:
        return Finding('clock', PROBLEM, text, 'set it: timedatectl set-ntp true')
    return Finding('clock', OK, text)


def disk(folder: Path) -> Finding:
    """Look at the disk that recordings are written to.

    Args:
        folder: where they go; it need not be there yet.
    """
    there = _existing(folder)
    text = f'{folder.absolute()}: {shutil.disk_usage(there).free / _GIB:.1f} GiB are free'
    if not os.access(there, os.W_OK | os.X_OK):
        text = f'{there.absolute()} cannot be written to'
        return Finding(
            'disk', PROBLEM, text, 'record elsewhere: occ record -o DIR, --bags DIR here'
        )
    free = shutil.disk_usage(there).free
    if free < _LEAST_DISK:
        return Finding('disk', PROBLEM, text, 'make room, or record elsewhere: occ record -o DIR')
    if free < _LITTLE_DISK:
        return Finding('disk', NOTE, text, 'with cameras or point clouds that is minutes')
    return Finding('disk', OK, text)


def logs() -> Finding:
    """Look at the folder in which each node writes its log: without it none starts."""
    folder = (
        os.environ.get('ROS_LOG_DIR')
        or (os.environ.get('ROS_HOME') or f'{Path.home()}/.ros') + '/log'
    )
    there = _existing(Path(folder))
    if not there.is_dir() or not os.access(there, os.W_OK | os.X_OK):
        advice = 'make it writable, or set ROS_LOG_DIR to another folder'
        return Finding('logs', PROBLEM, f'{folder} cannot be written to', advice)
    return Finding('logs', OK, f'{folder} can be written to')


def _existing(folder: Path) -> Path:
    """Return the folder, or the nearest one above that is there."""
    folder = folder.absolute()
    return next(one for one in (folder, *folder.parents) if one.exists())
