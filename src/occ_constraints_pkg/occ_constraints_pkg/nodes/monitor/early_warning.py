# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The time to a violation of live features, computed only while somebody wants to know."""

from __future__ import annotations

from occ_constraints_pkg.features.extractor import FeatureRows
from occ_constraints_pkg.rules import Judgement, RuleSet, Verdict
from occ_constraints_pkg.rules.forecast import HORIZON_SECONDS, WINDOW_SECONDS, Forecast, Forecaster


class EarlyWarning:
    """Makes forecasts for robot 0, which begin anew with other rules and with each episode.

    Attributes:
        horizon: seconds within which an estimated violation is warned of.
        window: seconds over which rates of change are looked for.
    """

    def __init__(self) -> None:
        self.horizon, self.window = HORIZON_SECONDS, WINDOW_SECONDS
        self._rules: RuleSet | None = None
        self._forecaster: Forecaster | None = None
        self._episode: float | None = None

    def look(self, rule_set: RuleSet, rows: FeatureRows, judgement: Judgement) -> Forecast:
        """Take one more row and estimate what comes after it."""
        if rule_set is not self._rules:
            self._rules, self._forecaster = rule_set, Forecaster(rule_set, self.window)
        table, episode = rows.table, None
        if table is not None and 'episode' in table.names:
            episode = float(table.column('episode')[0])
        if episode != self._episode:
            self._episode = episode
            self._forecaster.reset()
        self._forecaster.add(rows.stamp_ns, rows.values[0])
        return self._forecaster.forecast(Verdict(judgement.verdict[0]), int(judgement.rule[0]))
