# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The paper's and the article's experiments: ``python -m experiments NAME``."""
