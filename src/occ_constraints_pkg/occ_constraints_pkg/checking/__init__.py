# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Verdicts in time: intervals, early warnings, as values, text and pictures."""
