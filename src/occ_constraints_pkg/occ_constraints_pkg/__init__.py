# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Learn a robot's safety constraints from demonstrations, monitor them, and train within them.

Example:
    >>> import occ_constraints_pkg as occ
    >>> constraints = occ.learn('bags/simple_nav_expert', 'simple_nav')
    >>> report = occ.check('bags/simple_nav_straight', constraints)
    >>> report.is_safe
    False

A name is imported when it is first used, so that a node on a robot loads only what it needs.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

__version__ = '0.1.0'

if TYPE_CHECKING:
    from occ_constraints_pkg.api import Report, Violation, check, learn, suggest_feature_map
    from occ_constraints_pkg.errors import (
        ConfigurationError,
        DataError,
        InputError,
        MissingDependencyError,
        OccError,
    )
    from occ_constraints_pkg.features.feature_map import FeatureMap, load_feature_map
    from occ_constraints_pkg.rules.constraints_file import Constraints, load_constraints
    from occ_constraints_pkg.rules.rule import Literal, Rule
    from occ_constraints_pkg.rules.ruleset import RuleSet
    from occ_constraints_pkg.rules.space import Feature, FeatureSpace
    from occ_constraints_pkg.rules.verdict import Judgement, Verdict

__all__ = [
    'ConfigurationError',
    'Constraints',
    'DataError',
    'Feature',
    'FeatureMap',
    'FeatureSpace',
    'InputError',
    'Judgement',
    'Literal',
    'MissingDependencyError',
    'OccError',
    'Report',
    'Rule',
    'RuleSet',
    'Verdict',
    'Violation',
    'check',
    'learn',
    'load_constraints',
    'load_feature_map',
    'suggest_feature_map',
]

# Where each public name is defined, below this package.
_MODULES = {
    'ConfigurationError': 'errors',
    'Constraints': 'rules.constraints_file',
    'DataError': 'errors',
    'Feature': 'rules.space',
    'FeatureMap': 'features.feature_map',
    'FeatureSpace': 'rules.space',
    'InputError': 'errors',
    'Judgement': 'rules.verdict',
    'Literal': 'rules.rule',
    'MissingDependencyError': 'errors',
    'OccError': 'errors',
    'Report': 'api',
    'Rule': 'rules.rule',
    'RuleSet': 'rules.ruleset',
    'Verdict': 'rules.verdict',
    'Violation': 'api',
    'check': 'api',
    'learn': 'api',
    'load_constraints': 'rules.constraints_file',
    'load_feature_map': 'features.feature_map',
    'suggest_feature_map': 'api',
}


def __getattr__(name: str) -> Any:
    if name not in _MODULES:
        raise AttributeError(f'module {__name__!r} has no attribute {name!r}')
    value = getattr(import_module(f'{__name__}.{_MODULES[name]}'), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
