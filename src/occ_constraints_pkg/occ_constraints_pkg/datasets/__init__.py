# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Rows of features with their episodes, from recordings, tables and manifests."""
