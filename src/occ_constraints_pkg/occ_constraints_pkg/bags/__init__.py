# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Recordings in and out, and the feature map that turns topics into numbers."""
