# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The demo: record, learn, monitor and train with real nodes."""
