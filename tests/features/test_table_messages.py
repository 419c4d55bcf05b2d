# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from occ_constraints_pkg.features.table import Table
from occ_constraints_pkg.features.table_messages import TABLE_TYPE, TableSerializer
from synthetic_bags import STORE, table_message

ROWS = st.lists(st.floats(width=32), min_size=3, max_size=3)
FRAMES = st.text(st.characters(codec='utf-8'), max_size=9)
NAMES = ('x', 'cost', 'élan')


@given(st.lists(ROWS, min_size=1, max_size=3), FRAMES)
def test_writes_the_bytes_that_a_serializer_writes(rows, frame):
    serializer = TableSerializer(NAMES, frame)
    for stamp, row in enumerate(rows, start=1_700_000_000_999_999_999):
        message = table_message(Table(NAMES, np.array([row])), stamp, frame)
        assert serializer.serialize(row, stamp) == STORE.serialize_cdr(message, TABLE_TYPE)


@given(st.lists(ROWS, max_size=4), FRAMES, st.sampled_from([np.float32, np.float64]))
def test_writes_tables_of_any_size(rows, frame, dtype):
    values = np.array(rows, dtype).reshape(-1, 3)
    serializer = TableSerializer(NAMES, frame, len(values), dtype)
    for stamp in (0, 1_700_000_000_999_999_999):
        message = table_message(Table(NAMES, values), stamp, frame)
        assert serializer.serialize(values, stamp) == STORE.serialize_cdr(message, TABLE_TYPE)
