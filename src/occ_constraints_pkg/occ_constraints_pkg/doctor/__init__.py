# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""``occ doctor``: what on this machine keeps nodes from running, and what to do about it.

``local`` looks at what can be seen without ROS, ``network`` at what two processes of ``probe``
report, which may crash or hang without harm.
"""
