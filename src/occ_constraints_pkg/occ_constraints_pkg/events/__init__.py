# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""What happened to a robot: events from verdicts and gate states, kept in a store, in words."""
