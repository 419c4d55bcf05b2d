# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Node ``tree_learner``: learns constraints from recordings or live topics and publishes them."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

import numpy as np
from std_msgs.msg import String
from std_srvs.srv import Trigger

from occ_constraints_pkg.demonstrations.learning import learn_from_files
from occ_constraints_pkg.errors import ConfigurationError, OccError
from occ_constraints_pkg.features.extractor import FeatureExtractor
from occ_constraints_pkg.features.feature_map import load_feature_map
from occ_constraints_pkg.learning.conditional.settings import (
    chosen_conditions,
    resolved_conditions,
)
from occ_constraints_pkg.learning.guarantee import guarantee_words, loss_words
from occ_constraints_pkg.learning.learn import learn
from occ_constraints_pkg.learning.settings import OCTreeSettings
from occ_constraints_pkg.ros.clocks import ArrivalClock
from occ_constraints_pkg.ros.mapped_topics import MappedTopics
from occ_constraints_pkg.ros.node import OccNode
from occ_constraints_pkg.ros.process import run_node
from occ_constraints_pkg.ros.qos import LATCHED, overridable
from occ_constraints_pkg.rules.constraints_file import Constraints, save_learned
from occ_constraints_pkg.stopping import stop_request
from occ_constraints_pkg.wording import count_of

# How long /clock may stand still while samples come in.
_CLOCK_SECONDS = 1.0


class TreeLearner(OccNode):
    """Learns at the start when recordings are given, else collects until ``~/learn`` is called."""

    subscribes_later = True

    def __init__(self) -> None:
        super().__init__('tree_learner')
        bags = self.parameter('bags', [], 'recordings; none: collect from live topics')
        name = self.parameter('feature_map', '', 'feature map: a YAML file or a built-in name')
        self._output = self.parameter('output', '', 'constraints file to write; none: no file')
        self._overwrite = self.parameter(
            'overwrite', False, 'replace a file that a person has edited (a copy .bak is kept)'
        )
        exit_when_done = self.parameter('exit_when_done', False, 'end after learning from bags')
        seed = self.parameter('seed', 0, 'seed of the choice of held-out episodes', low=0)
        defaults = OCTreeSettings()
        depth = self.parameter('max_depth', defaults.max_depth, 'most levels of splits', low=0)
        chosen = {
            field.name: self.parameter(
                field.name, getattr(defaults, field.name), 'see docs/method.md'
            )
            for field in fields(defaults)
            if field.name not in ('max_depth', 'nu', 'contamination')
        }
        share = self.parameter(
            'contamination', -1.0, 'share of samples that may lie outside; below 0: estimated'
        )
        nu = self.parameter('nu', 1.0, 'share of samples that may lie outside; 1: any', high=1.0)
        self._settings = OCTreeSettings(
            max_depth=depth,
            nu=None if nu >= 1.0 else nu,
            contamination=None if share < 0.0 else share,
            **chosen,
        )
        conditions = self.parameter(
            'conditions',
            '',
            'rules about how many features: none (a box), pairs or triples; empty: triples, '
            'or none where other parameters let the tree branch',
        )
        apart = self.parameter(
            'apart', [], 'pairs A,B of features or families that no rule may combine'
        )
        self._conditional = chosen_conditions(
            conditions or None, [tuple(pair.split(',')) for pair in apart]
        )
        # What does not go together ends the node now, not after hours of collecting.
        resolved_conditions(self._conditional, self._settings)
        alarm = self.parameter(
            'false_alarm',
            0.0,
            'probability of an alarm in a fresh safe episode to keep to; 0: no guarantee',
            low=0.0,
            high=1.0,
        )
        self._false_alarm = alarm if alarm > 0.0 else None
        calibrate_on = self.parameter(
            'calibrate_on', [], 'recordings of safe episodes for that; none: held-out episodes'
        )
        self.declared()
        if calibrate_on and not bags:
            raise ConfigurationError(
                "parameter 'calibrate_on' of node 'tree_learner' goes with 'bags' only; allowed "
                'with live topics is none'
            )
        if not name:
            raise ConfigurationError(
                "parameter 'feature_map' of node 'tree_learner' is missing; "
                'give a YAML file or a built-in name'
            )
        self._map = load_feature_map(name)
        self._rng = np.random.default_rng(seed)
        self._extractor = FeatureExtractor(self._map)
        self._arrival = ArrivalClock(self, _CLOCK_SECONDS)
        self._rows: list[np.ndarray] = []
        self._episodes: list[np.ndarray] = []
        self._publisher = self.create_publisher(
            String, 'constraints', LATCHED, qos_overriding_options=overridable()
        )
        self.create_service(Trigger, '~/learn', self._on_learn)
        if bags:
            self.get_logger().info(f'learning from {", ".join(bags)}')
            with stop_request.interrupting():
                constraints = learn_from_files(
                    bags,
                    self._map,
                    self._settings,
                    rng=self._rng,
                    conditional=self._conditional,
                    false_alarm=self._false_alarm,
                    calibrate_on=calibrate_on,
                    namespace=self.get_namespace(),
                    warn=self.get_logger().warning,
                )
            self._hand_out(constraints)
            if exit_when_done:
                self.finish()
        else:
            self._topics = MappedTopics(self, self._map, self._on_input)
            self.get_logger().info(
                f'collecting samples from {", ".join(map(self.full_name, self._map.topics))} until '
                f'{self.get_fully_qualified_name()}/learn is called'
            )

    def _on_input(self, topic: str, message: Any, _published_ns: int) -> None:
        now = self._arrival.now_ns()
        try:
            rows = self._extractor.push(topic, message, now)
            if self._arrival.problem():
                raise ConfigurationError(self._arrival.problem())
        except OccError as error:
            self.get_logger().error(f'input refused: {error}', throttle_duration_sec=1.0)
            return
        if rows is None or rows.repeat:
            return
        self._rows.append(rows.values)
        robots = np.arange(len(rows.values))
        if rows.table is not None and 'episode' in rows.table.names:
            # One number per robot and episode.
            self._episodes.append(robots + len(robots) * rows.table.column('episode'))
        else:
            self._episodes.append(np.zeros(len(robots)))

    def _on_learn(self, _request: Any, response: Any) -> Any:
        try:
            if not self._rows:
                raise ConfigurationError('no sample has been received yet')
            with stop_request.interrupting():
                constraints = learn(
                    np.concatenate(self._rows),
                    np.concatenate(self._episodes),
                    self._map.space,
                    self._settings,
                    rng=self._rng,
                    conditional=self._conditional,
                    false_alarm=self._false_alarm,
                    feature_map=self._map.to_document(),
                )
            response.success, response.message = True, self._hand_out(constraints)
        except OccError as error:
            response.success, response.message = False, str(error)
        except KeyboardInterrupt:
            response.success, response.message = False, 'the node was asked to end'
        return response

    def close(self) -> None:
        """Let the rules leave."""
        self.flush(self._publisher)

    def _hand_out(self, constraints: Constraints) -> str:
        text = f'{count_of(len(constraints.rule_set.rules), "rule")} learned'
        if self._output:
            save_learned(constraints, self._output, overwrite=self._overwrite)
            text += f', written to {self._output}'
        self._publisher.publish(String(data=constraints.dumps()))
        calibration = constraints.learner.get('calibration')
        if calibration:
            text += f'. {guarantee_words(calibration)}'
            if calibration['vanished']:
                self.get_logger().warning(loss_words(calibration))
        self.get_logger().info(text)
        return text


def main(argv: list[str] | None = None) -> int:
    """Run the node."""
    return run_node(TreeLearner, argv)
