# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The live view ``occ watch``: ``model`` knows no ROS, ``network`` no screen, ``app`` neither."""
