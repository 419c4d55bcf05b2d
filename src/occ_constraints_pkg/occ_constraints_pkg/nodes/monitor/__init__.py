# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Node ``monitor``: judges live topics by a rule set."""
