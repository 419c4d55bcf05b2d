# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Conditional rules: corners of the demonstrations' box that are surprisingly empty.

The learner needs SciPy, which a robot that only monitors need not have; so it is imported from
:mod:`~occ_constraints_pkg.learning.conditional.learner`.
"""

from occ_constraints_pkg.learning.conditional.rules import (
    ConditionalRule,
    Feature,
    LearnedRules,
    Literal,
)
from occ_constraints_pkg.learning.conditional.settings import ConditionalSettings

__all__ = ['ConditionalRule', 'ConditionalSettings', 'Feature', 'LearnedRules', 'Literal']
