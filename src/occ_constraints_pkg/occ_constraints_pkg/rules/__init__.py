# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""What a rule means: feature space, literals, rules, verdicts, margins, the constraints file."""

from occ_constraints_pkg.rules.rule import Literal, Rule
from occ_constraints_pkg.rules.ruleset import RuleCounts, RuleSet
from occ_constraints_pkg.rules.space import Feature, FeatureSpace
from occ_constraints_pkg.rules.verdict import Judgement, Verdict

__all__ = [
    'Feature',
    'FeatureSpace',
    'Judgement',
    'Literal',
    'Rule',
    'RuleCounts',
    'RuleSet',
    'Verdict',
]
