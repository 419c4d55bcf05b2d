# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The live view ``occ watch``: draws a ``fleet`` on a terminal, or as plain lines."""
