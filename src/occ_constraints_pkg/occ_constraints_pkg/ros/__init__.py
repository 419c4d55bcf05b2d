# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Thin adapters to rclpy: messages, quality of service, parameters, process life."""
