# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.features.table import FLOAT32, FLOAT64, Table
from rosbags.typesys import Stores, get_typestore

STORE = get_typestore(Stores.ROS2_JAZZY)
CLOUD, FIELD = (STORE.types[f'sensor_msgs/msg/{name}'] for name in ('PointCloud2', 'PointField'))
TEXT = st.text(st.characters(codec='utf-8', exclude_characters='\0'), min_size=1, max_size=8)


@st.composite
def tables(draw):
    names = tuple(draw(st.lists(TEXT, min_size=1, max_size=12, unique=True)))
    dtype = draw(st.sampled_from([np.float32, np.float64]))
    return Table(names, draw(hnp.arrays(dtype, (draw(st.integers(0, 7)), len(names)))))


def cloud(table):
    time = STORE.types['builtin_interfaces/msg/Time'](1, 2)
    header = STORE.types['std_msgs/msg/Header'](time, 'world')
    rows, columns = table.values.shape
    step = table.values.dtype.itemsize * columns
    fields = [FIELD(*item) for item in table.layout]
    data = np.frombuffer(table.packed(), dtype=np.uint8)
    return CLOUD(header, 1, rows, fields, False, step, step * rows, data, True)


def replaced_fields(message, **changes):
    return [dataclasses.replace(field, **changes) for field in message.fields]


@given(tables())
def test_comes_back_bit_for_bit_through_cdr(table):
    message = cloud(table)
    data = STORE.serialize_cdr(message, message.__msgtype__)
    back = Table.from_message(STORE.deserialize_cdr(data, message.__msgtype__))
    assert back.names == table.names
    assert back.values.dtype == table.values.dtype
    assert back.values.tobytes() == table.values.tobytes()


def test_mixed_kinds_and_holes_are_read_as_float64():
    record = np.zeros(2, dtype=[('a', '<f4'), ('hole', '<u4'), ('b', '<f8')])
    record['a'], record['b'] = [1.5, 2.5], [0.1, 1e300]
    message = cloud(Table(('x',), np.zeros((2, 1))))
    message.fields = [FIELD('a', 0, FLOAT32, 1), FIELD('b', 8, FLOAT64, 1)]
    message.point_step, message.data = 16, record.view(np.uint8)
    table = Table.from_message(message)
    assert table.values.tolist() == [[1.5, 0.1], [2.5, 1e300]]
    assert table.values.dtype == np.float64


def test_columns_by_name():
    table = Table(('a', 'b'), np.array([[1.0, 2.0], [3.0, 4.0]]))
    assert table.column('b').tolist() == [2.0, 4.0]
    with pytest.raises(OccError, match=r"no column 'c'; its columns are a, b"):
        table.column('c')


@pytest.mark.parametrize(
    ('names', 'values', 'reason'),
    [
        (('a',), np.zeros((2, 2)), 'shape'),
        (('a', 'a'), np.zeros((2, 2)), 'twice'),
        (('a',), np.zeros((2, 1), dtype=np.int32), 'int32'),
    ],
)
def test_refuses_values_that_are_no_table(names, values, reason):
    with pytest.raises(OccError, match=reason):
        Table(names, values)


@pytest.mark.parametrize(
    ('change', 'reason'),
    [
        (lambda m: setattr(m, 'fields', replaced_fields(m, datatype=5)), 'is not a table'),
        (lambda m: setattr(m, 'fields', replaced_fields(m, count=3)), 'holds 3 numbers'),
        (lambda m: setattr(m, 'fields', replaced_fields(m, offset=9)), 'reaches past'),
        (lambda m: setattr(m, 'fields', replaced_fields(m, name='a')), 'twice'),
        (lambda m: setattr(m, 'point_step', 2**31), 'points of 2147483648 bytes'),
        (lambda m: setattr(m, 'fields', []), 'is not a table'),
        (lambda m: setattr(m, 'is_bigendian', True), 'is not a table'),
        (lambda m: setattr(m, 'data', m.data[:-1]), 'holds only'),
        (lambda m: (setattr(m, 'height', 3), setattr(m, 'width', 1)), 'row_step'),
    ],
)
def test_refuses_messages_that_are_no_table(change, reason):
    message = cloud(Table(('a', 'b'), np.zeros((3, 2), dtype=np.float32)))
    change(message)
    with pytest.raises(OccError, match=reason):
        Table.from_message(message)
