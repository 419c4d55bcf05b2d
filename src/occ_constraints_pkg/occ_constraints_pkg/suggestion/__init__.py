# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""A first feature map for a recording, from what its messages hold."""
