# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The page of all robots: ``documents`` says what, ``application`` answers, ``server`` runs it.

None of them knows ROS: the node ``dashboard`` brings the model up to date and hands on what is
asked for.
"""
