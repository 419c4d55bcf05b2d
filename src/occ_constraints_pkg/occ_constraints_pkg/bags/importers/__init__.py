# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Importers: recordings of road traffic in the formats of others, as bags of drives."""
