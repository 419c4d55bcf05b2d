# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""From files of demonstrations to constraints, and what to ask before they are learned from."""
