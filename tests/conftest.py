# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""What all tests share: the versions in pytest's header, and no deadline for one example."""

import platform
from importlib import metadata

from hypothesis import settings

# How long one example takes depends on what else the machine does.
settings.register_profile('any machine', deadline=None)
settings.load_profile('any machine')


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
