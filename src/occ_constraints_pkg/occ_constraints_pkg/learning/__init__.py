# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Learning the safe set and its rules from demonstrations."""
