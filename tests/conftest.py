# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""What all tests share: the versions in pytest's header."""

import platform
from importlib import metadata


def pytest_report_header() -> str:
    """Name the versions that decide what a test result is worth."""
    names = {'NumPy': 'numpy', 'torch': 'torch', 'mujoco': 'mujoco', 'rclpy': 'rclpy'}
    versions = [f'Python {platform.python_version()}']
    for name, distribution in names.items():
        try:
            versions.append(f'{name} {metadata.version(distribution)}')
        except metadata.PackageNotFoundError:
            versions.append(f'{name} absent')
    return 'versions: ' + ', '.join(versions)
