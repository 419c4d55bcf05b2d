# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""What all pages share: one style, small helpers and charts in plain JavaScript, no build step."""
