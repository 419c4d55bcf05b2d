# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

pytest.importorskip('rclpy', reason="needs the extra 'ros'")

from occ_constraints_pkg.nodes.monitor.outputs import costs_message, costs_table
from occ_constraints_pkg.ros.tables import table_message
from occ_constraints_pkg.rules import Judgement
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
