# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""What any node needs of rclpy: process, parameters, lifecycle, QoS, clocks, tables."""
