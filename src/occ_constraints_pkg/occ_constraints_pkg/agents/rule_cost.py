# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Costs from a rule set, computed in the process of the learner."""

from __future__ import annotations

import numpy as np

from occ_constraints_pkg.errors import ConfigurationError
from occ_constraints_pkg.features.feature_map import FeatureMap
from occ_constraints_pkg.rules.constraints_file import Constraints
from occ_constraints_pkg.rules.ruleset import RuleCounts
from occ_constraints_pkg.worlds.base import World
from occ_constraints_pkg.worlds.stream import StepBatch


class RuleCost:
    """Judges each state of a world by learned rules, as the monitor does over topics.

    Attributes:
        constraints: the rules, with their original counters.
        counts: how often each rule was evaluated and violated here.

    Args:
        constraints: the rules, with a feature map of columns of the world's observation.
        world: the world, or its class.

    Raises:
        ConfigurationError: a feature is not a column of the observation.
    """

    def __init__(self, constraints: Constraints, world: World | type[World]) -> None:
        if constraints.feature_map is None:
            raise ConfigurationError(
                'the constraints have no feature_map, so their features are unknown'
            )
        feature_map = FeatureMap.from_document(constraints.feature_map, 'the constraints')
        names = [column.name for column in world.columns]
        for source in feature_map.features:
            if source.column not in names or not source.is_plain_column:
                raise ConfigurationError(
                    f'feature {source.name!r} is no column of the observation of {world.name}; '
                    f'its columns are {", ".join(names)}'
                )
        self.constraints = constraints
        self._rule_set = constraints.rule_set
        self._places = [names.index(str(source.column)) for source in feature_map.features]
        self.counts = RuleCounts(self._rule_set)

    def __call__(self, batch: StepBatch) -> np.ndarray:
        """Return (N,) 1.0 where a robot's state is not SAFE, else 0.0."""
        judgement = self._rule_set.judge(self.features(batch.observation))
        self.counts.add(judgement)
        return judgement.cost

    def features(self, observation: np.ndarray) -> np.ndarray:
        """Return the (N, features) columns that the rules use, in their order.

        Args:
            observation: (N, k) with the world's columns.
        """
        return observation[:, self._places]

    def counted(self) -> Constraints:
        """Return the constraints with the counters of this cost source, for pruning."""
        return self.constraints.with_rule_set(self._rule_set.with_counts(self.counts))
