# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Where the packaging tests find what they check."""

from pathlib import Path

import pytest
from occ_constraints_pkg.nodes import NODES


@pytest.fixture(scope='session')
def root() -> Path:
    """The repository."""
    return Path(__file__).resolve().parents[2]


@pytest.fixture(scope='session')
def package(root: Path) -> Path:
    """The folder that holds setup.py and package.xml."""
    return root / 'src' / 'occ_constraints_pkg'


@pytest.fixture(scope='session')
def nodes() -> list[str]:
    """The executables of the package, in the order of a run."""
    return list(NODES)
