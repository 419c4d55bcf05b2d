# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Learn a robot's safety constraints from demonstrations, monitor them, and train within them."""

__version__ = '0.1.0'
