# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from made_bags import STORE, table_message
from occ_constraints_pkg.bags.table import Table
from occ_constraints_pkg.bags.table_messages import TABLE_TYPE, RowSerializer

ROWS = st.lists(st.floats(), min_size=3, max_size=3)


@given(st.lists(ROWS, min_size=1, max_size=3), st.text(st.characters(codec='utf-8'), max_size=9))
def test_writes_the_bytes_that_a_serializer_writes(rows, frame):
    names = ('x', 'cost', 'élan')
    serializer = RowSerializer(names, frame)
    for stamp, row in enumerate(rows, start=1_700_000_000_999_999_999):
        message = table_message(Table(names, np.array([row])), stamp, frame)
        assert serializer.serialize(row, stamp) == STORE.serialize_cdr(message, TABLE_TYPE)
