# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The conditions of a measurement: machine and versions."""

from __future__ import annotations

import os
import platform
from collections.abc import Iterable
from importlib.metadata import PackageNotFoundError, version
from typing import Any

_PACKAGES = (
    *('numpy', 'scipy', 'scikit-learn', 'torch', 'mujoco', 'highway-env'),
    *('rosbags', 'mcap', 'zstandard', 'ros-jazzy-rclpy'),
)


def machine() -> dict[str, Any]:
    """Describe the machine as far as it matters for speed."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, 'sched_getaffinity') else os.cpu_count()
    return {'cores': cores, 'processor': platform.machine(), 'system': platform.system()}


def versions(packages: Iterable[str] = _PACKAGES) -> dict[str, str]:
    """Return the versions of Python and of those packages that are installed."""
    found = {'python': platform.python_version()}
    for package in packages:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            continue
    return found
