# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Simulated tasks that step many robots at once."""
