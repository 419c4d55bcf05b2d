# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

pytest.importorskip('rclpy', reason="needs the extra 'ros'")

from occ_constraints_pkg.features.extractor import FeatureRows
from occ_constraints_pkg.features.table import Table
from occ_constraints_pkg.nodes.monitor.outputs import (
    Answer,
    costs_message,
    costs_table,
    features_message,
)
from occ_constraints_pkg.ros.tables import table_message
from occ_constraints_pkg.rules import Feature, FeatureSpace, Judgement, RuleSet
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import PointCloud2

ANSWERS = st.tuples(st.integers(0, 2), st.integers(-1, 99), st.floats())


@given(
    st.lists(ANSWERS, min_size=1, max_size=2),
    st.integers(-(2**31) * 10**9, 2**31 * 10**9 - 1),
    st.sampled_from(['', '58f1fa588204']),
)
def test_the_bytes_are_those_of_the_message(answers, stamp, frame):
    verdict, rule, margin = zip(*answers, strict=True)
    judgement = Judgement(np.array(verdict, np.int8), np.array(rule), np.array(margin))
    message = costs_message(judgement, stamp, frame)
    assert deserialize_message(message, PointCloud2) == table_message(
        costs_table(judgement), stamp, frame
    )


def test_features_are_those_that_were_judged():
    rule_set = RuleSet(FeatureSpace((Feature('x'), Feature('y'))), (), [[0.0, 1.0], [0.0, 1.0]])
    values = np.array([[0.1, np.nan], [3.0, -0.2]])
    rows = FeatureRows(5, values, None, repeat=False)
    message = deserialize_message(
        features_message(Answer(rule_set, rows, Judgement.unknown(2))), PointCloud2
    )
    table = Table.from_message(message)
    assert table.names == ('x', 'y')
    np.testing.assert_array_equal(table.values, values)
    assert (message.header.frame_id, message.header.stamp.nanosec) == (rule_set.fingerprint, 5)
