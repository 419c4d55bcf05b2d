# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Lets the tests of this folder import ``line_world``: importlib mode leaves the path alone."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))
