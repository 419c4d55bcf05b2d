# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Self-contained HTML pages: rules, judged recordings, trainings, tables."""
