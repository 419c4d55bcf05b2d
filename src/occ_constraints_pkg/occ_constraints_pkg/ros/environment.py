# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""What a node needs of its surroundings, checked before rclpy, which would end without a word."""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import time
from datetime import UTC, datetime
from importlib.util import find_spec

from occ_constraints_pkg.errors import ConfigurationError

# DDS derives the ports of a domain from its number; higher ones would lie above 65535.
_LAST_DOMAIN = 232
# What comes with every rclpy, from PyPI and from apt.
_DEFAULT_RMW = 'rmw_fastrtps_cpp'
_PROBE = 'import rclpy.impl.implementation_singleton'
# Many times what loading takes.
_LOAD_SECONDS = 4.0
# Seconds of a stamp are 32 bits with a sign, in messages and in DDS.
_END_OF_TIME = 2**31
# With less address space the middleware's threads cannot start, which crashes the process.
_LEAST_BYTES = 640 * 2**20


def check_environment() -> None:
    """Check the variables of ROS, the clock and the memory; rclpy is not imported here.

    Raises:
        OccError: with these no node can run.
    """
    for check in (check_domain, check_clock, check_memory, check_middleware):
        check()


def check_clock() -> None:
    """Do nothing if the system's clock shows a time that a message can carry.

    Raises:
        OccError: it does not, so that DDS refuses to publish anything.
    """
    try:
        now = datetime.fromtimestamp(time.time(), UTC)
    except (OverflowError, ValueError, OSError):
        shown = 'a year beyond all reason'
    else:
        if 0 <= now.timestamp() < _END_OF_TIME:
            return
        shown = f'{now:%Y-%m-%d}'
    raise ConfigurationError(
        f"the system's clock shows {shown}, and ROS can publish nothing then; allowed are dates "
        'from 1970-01-01 to 2038-01-18'
    )


def check_memory() -> None:
    """Do nothing if this process may use enough address space.

    Raises:
        OccError: with so little the middleware crashes.
    """
    limit = resource.getrlimit(resource.RLIMIT_AS)[0]
    if limit != resource.RLIM_INFINITY and limit < _LEAST_BYTES:
        raise ConfigurationError(
            f'the address space of this process is limited to {limit // 2**20} MiB; a node needs '
            f'at least {_LEAST_BYTES // 2**20} MiB, see `ulimit -v`'
        )


def check_domain() -> None:
    """Do nothing if ``ROS_DOMAIN_ID`` is a domain.

    Raises:
        OccError: it is none.
    """
    text = os.environ.get('ROS_DOMAIN_ID', '')
    number = text.strip()
    if number and not (number.isdecimal() and int(number) <= _LAST_DOMAIN):
        raise ConfigurationError(
            f'ROS_DOMAIN_ID is {text!r}; allowed is a whole number from 0 to {_LAST_DOMAIN}, or '
            'no value, for 0'
        )


def check_middleware() -> None:
    """Do nothing if rclpy can load the middleware that ``RMW_IMPLEMENTATION`` names.

    Only another process can find out; the default one is not checked, as that takes 0.1 s.

    Raises:
        OccError: it cannot, and would end the process with code 102.
    """
    name = os.environ.get('RMW_IMPLEMENTATION', '')
    if name in ('', _DEFAULT_RMW) or find_spec('rclpy') is None:
        return
    without = {key: value for key, value in os.environ.items() if key != 'RMW_IMPLEMENTATION'}
    # If rclpy cannot be loaded without it either, that is another problem, reported elsewhere.
    if _can_load(dict(os.environ)) or not _can_load(without):
        return
    package = f'ros-jazzy-{name}'.replace('_', '-')
    raise ConfigurationError(
        f'RMW_IMPLEMENTATION is {name!r}, which this rclpy cannot load; allowed are a middleware '
        f'that is installed ({package} from apt; rclpy from PyPI has {_DEFAULT_RMW} only), or no '
        'value, for the default'
    )


def _can_load(environment: dict[str, str]) -> bool:
    try:
        done = subprocess.run(
            [sys.executable, '-c', _PROBE],
            env=environment,
            capture_output=True,
            check=False,
            timeout=_LOAD_SECONDS,
        )
    except subprocess.TimeoutExpired:
        return False
    return done.returncode == 0
