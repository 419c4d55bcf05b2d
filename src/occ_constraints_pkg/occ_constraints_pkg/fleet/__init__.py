# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""All robots in the ROS domain: ``model`` knows no ROS, ``network`` fills it, views draw it.

``occ watch`` and the node ``dashboard`` draw the same model.
"""
