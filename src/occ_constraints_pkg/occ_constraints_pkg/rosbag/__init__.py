# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Recordings in and out: MCAP and SQLite storage, metadata, message types, playback."""
