# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Serialized tables give, row for row and error for error, what decoded ones give."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.features.extractor import FeatureExtractor
from occ_constraints_pkg.features.feature_map import FeatureMap
from occ_constraints_pkg.features.fields import header_stamp_ns
from occ_constraints_pkg.features.serialized_tables import TableMessage, TableReader
from occ_constraints_pkg.features.table import Table
from occ_constraints_pkg.features.table_messages import STAMP, STAMP_AT, TABLE_TYPE, TableHead
from synthetic_bags import STORE, table_message

MAP = FeatureMap.from_document(
    {
        'schema_version': 1,
        'pace': 'table',
        'max_age': 0.5,
        'features': [
            {'name': name, 'topic': 'table', 'column': name, 'unit': 'm'} for name in ('a', 'b')
        ],
    },
    'map',
)
NO_CHANGE = [lambda message: None] * 8
CHANGES = [
    lambda m: setattr(m, 'is_bigendian', True),
    lambda m: setattr(m, 'is_dense', False),
    lambda m: setattr(m, 'row_step', m.row_step + 1),
    lambda m: setattr(m, 'data', m.data[:-1]),
    lambda m: setattr(m, 'data', np.append(m.data, [np.uint8(1)] * 5)),
    lambda m: setattr(m, 'fields', []),
    lambda m: setattr(m, 'fields', [replace(field, count=0) for field in m.fields]),
    lambda m: setattr(m, 'fields', [replace(field, datatype=6) for field in m.fields]),
    lambda m: setattr(m, 'fields', m.fields[::-1]),
    lambda m: setattr(m, 'fields', m.fields[1:]),
    lambda m: (setattr(m, 'height', m.width), setattr(m, 'width', 1)),
]
STAMPS = st.tuples(st.integers(-(2**31), 2**31 - 1), st.integers(0, 2**32 - 1))


def decode(data):
    return STORE.deserialize_cdr(data, TABLE_TYPE)


def head_of(message):
    fields = [(field.name, field.offset, field.datatype, field.count) for field in message.fields]
    steps = message.point_step, message.row_step, len(message.data)
    return TableHead(message.header.frame_id, message.height, message.width, fields, *steps)


@st.composite
def kinds(draw):
    """A message, in the other byte order or cut short now and then, and where padding stands."""
    names = draw(st.sampled_from([('a', 'b'), ('b', 'x', 'a'), ('a', 'b', 'episode'), ('a', 'x')]))
    rows, dtype = draw(st.integers(0, 3)), draw(st.sampled_from([np.float32, np.float64]))
    frame = draw(st.sampled_from(['', 'map', 'über']))
    message = table_message(Table(names, np.ones((rows, len(names)), dtype)), 0, frame)
    draw(st.sampled_from(NO_CHANGE + CHANGES))(message)
    is_little = draw(st.sampled_from([True, True, True, False]))
    data = bytes(STORE.serialize_cdr(message, TABLE_TYPE, little_endian=is_little))
    padding = [place for place, byte in enumerate(head_of(message).mask) if not byte]
    # Two free bytes of the encoding, and eight of the stamp.
    return data[: draw(st.sampled_from([None, None, None, -1, -9]))], padding[10:]


@st.composite
def sequences(draw):
    some = draw(st.lists(kinds(), min_size=1, max_size=3))
    noise = np.random.default_rng(draw(st.integers(0, 99)))
    sent = []
    for data, padding in draw(st.lists(st.sampled_from(some), min_size=3, max_size=9)):
        message = bytearray(data)
        STAMP.pack_into(message, STAMP_AT, *draw(STAMPS))
        for place in padding:
            if place < len(message):
                message[place] = noise.integers(256)
        numbers = noise.choice([0.0, 1.5, np.nan, -np.inf], 3).astype(np.float32).tobytes()
        message[-len(numbers) - 1 : -1] = numbers
        sent.append(bytes(message))
    return sent


def outcome(extractor, read, data):
    try:
        message = read(data)
    # Of whatever kind: the decoder cannot read it.
    except Exception as error:
        return type(error)
    if isinstance(message, TableMessage):
        frame, stamp = message.frame_id, message.stamp_ns or None
    else:
        frame, stamp = message.header.frame_id, header_stamp_ns(message)
    try:
        rows = extractor.push('/table', message, 7)
    except OccError as error:
        return frame, stamp, str(error)
    arrays = [(item.shape, item.dtype, item.tobytes()) for item in (rows.values, rows.table.values)]
    return frame, stamp, rows.stamp_ns, rows.repeat, rows.note, rows.table.names, arrays


@given(sequences())
def test_gives_what_decoding_gives(sent):
    plain, fast = FeatureExtractor(MAP), FeatureExtractor(MAP)
    reader = TableReader(decode)
    for data in sent:
        assert outcome(fast, reader.read, data) == outcome(plain, decode, data)


@pytest.mark.parametrize('rows', [1, 5])
def test_the_third_of_three_that_are_alike_is_not_decoded(rows):
    decoded = []
    reader = TableReader(lambda data: decoded.append(data) or decode(data))
    for number in range(1, 5):
        table = Table(('a', 'b'), np.full((rows, 2), number, dtype=np.float32))
        message = table_message(table, number, 'map')
        read = reader.read(bytes(STORE.serialize_cdr(message, TABLE_TYPE)))
    assert len(decoded) == 2
    assert (read.stamp_ns, read.frame_id, read.table.names) == (4, 'map', ('a', 'b'))
    assert read.table.values.tolist() == [[4.0, 4.0]] * rows
