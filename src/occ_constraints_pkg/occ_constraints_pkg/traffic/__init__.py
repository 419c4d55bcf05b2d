# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Recorded road traffic: importers, the ten features, rules in the terms of traffic."""
