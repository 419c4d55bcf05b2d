# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The feature map: which topic and field gives each feature, and rows of features from messages."""
