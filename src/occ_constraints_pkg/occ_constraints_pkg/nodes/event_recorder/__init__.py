# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The node ``event_recorder``: what happened is kept and told."""
