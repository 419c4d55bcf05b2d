# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Policies that act in a world, and the learners that make them."""
