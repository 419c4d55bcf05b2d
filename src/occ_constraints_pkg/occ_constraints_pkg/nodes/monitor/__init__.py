# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Node ``monitor``, in the order of its data.

``inputs`` (messages to rows), ``pipeline`` (rows to verdicts, the policy in one function),
``rules_in_force`` and ``rules_reader`` (what is judged by), ``outputs`` with ``diagnostics``,
``markers`` and ``state_log`` (what is published), ``node`` (parameters, lifecycle, services).
"""
