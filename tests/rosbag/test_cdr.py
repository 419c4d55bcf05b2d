# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Fields read from many messages at once equal those of messages that rosbags builds."""

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from occ_constraints_pkg.rosbag.cdr import CdrFields, UnreadableError
from rosbags.interfaces import Nodetype
from rosbags.serde import SerdeError
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

STORE = get_typestore(Stores.ROS2_JAZZY)
KINDS = {'byte': 'int8', 'char': 'uint8'}
CUSTOM = """\
bool flag
uint8[] few
float64 value
string[2] names
lab_msgs/Odd[] odd
lab_msgs/Named[3] named
lab_msgs/Named[] more
float32[<=5] bounded
int64[3] fixed
string last
uint16 end
================================================================================
MSG: lab_msgs/Odd
uint8 a
float64 b
uint8 c
================================================================================
MSG: lab_msgs/Named
string name
int16 number
"""
STORE.register(get_types_from_msg(CUSTOM, 'lab_msgs/msg/All'))
TYPES = sorted(STORE.fielddefs)


def made(field, rng):
    """Return a random value for a field."""
    kind, argument = field
    if kind == Nodetype.NAME:
        parts = [made(part, rng) for _, part in STORE.fielddefs[argument][1]]
        return STORE.types[argument](*parts)
    if kind == Nodetype.BASE:
        name = KINDS.get(argument[0], argument[0])
        if name == 'string':
            return 'öabcdefghi'[: rng.integers(10)]
        if name == 'bool':
            return bool(rng.integers(2))
        if name.startswith('float'):
            special = [np.nan, np.inf, -np.inf, -0.0]
            number = special[rng.integers(4)] if rng.random() < 0.1 else rng.normal()
            return float(np.dtype(name).type(number))
        limits = np.iinfo(name)
        return int(rng.integers(limits.min, limits.max, dtype=name, endpoint=True))
    element, length = argument
    length = length if kind == Nodetype.ARRAY else int(rng.integers(5))
    values = [made(element, rng) for _ in range(length)]
    if element[0] == Nodetype.BASE and element[1][0] != 'string':
        return np.array(values, dtype=KINDS.get(element[1][0], element[1][0]))
    return values


def all_paths(msgtype):
    """Yield the paths of all numbers, arrays and vectors that are not within sequences."""
    fields = STORE.fielddefs[msgtype][1]
    if {'x', 'y'} <= {name for name, _ in fields}:
        yield ()
    for name, (kind, argument) in fields:
        if kind == Nodetype.NAME:
            yield from ((name, *path) for path in all_paths(argument))
        elif kind == Nodetype.BASE:
            if argument[0] != 'string':
                yield (name,)
        elif argument[0][0] == Nodetype.BASE and argument[0][1][0] != 'string':
            yield (name,)


def looked_up(message, path):
    for step in path:
        message = getattr(message, step) if isinstance(step, str) else message[step]
    if hasattr(message, 'x'):
        message = [getattr(message, axis) for axis in 'xyzw' if hasattr(message, axis)]
    return np.atleast_1d(np.asarray(message, dtype=np.float64))


def packed(messages, msgtype):
    """Return messages in one buffer, with a gap before the first: nothing there is aligned."""
    parts = [bytes(STORE.serialize_cdr(message, msgtype)) for message in messages]
    ends = 3 + np.cumsum([len(part) for part in parts])
    return b'gap' + b''.join(parts), np.append(3, ends[:-1]), ends


@settings(max_examples=80)
@given(st.sampled_from(TYPES), st.integers(0, 2**32), st.integers(1, 6))
def test_all_fields_of_all_types(msgtype, seed, count):
    rng = np.random.default_rng(seed)
    messages = [made((Nodetype.NAME, msgtype), rng) for _ in range(count)]
    paths = list(all_paths(msgtype))
    fields = CdrFields(STORE.fielddefs, msgtype, paths)
    for path, groups in zip(paths, fields.read(*packed(messages, msgtype)), strict=True):
        seen = np.concatenate([group.rows for group in groups])
        assert sorted(seen) == list(range(count))
        for group in groups:
            for row, values in zip(group.rows, group.values.astype(np.float64), strict=True):
                expected = looked_up(messages[row], path)
                assert np.array_equal(values, expected, equal_nan=True), path


def test_every_type_of_jazzy_compiles():
    assert len(TYPES) > 150
    for msgtype in TYPES:
        CdrFields(STORE.fielddefs, msgtype, list(all_paths(msgtype)))


@pytest.mark.parametrize(
    'path',
    [
        ('fixed', 1),
        ('fixed', -3),
        ('fixed', slice(1, 3)),
        ('named', 2, 'number'),
        ('named', -1, 'number'),
        ('bounded', slice(0, 2)),
        ('bounded', slice(-2, None)),
        ('bounded', -1),
    ],
)
def test_elements_and_slices(path):
    rng = np.random.default_rng(0)
    messages = []
    while len(messages) < 5:
        message = made((Nodetype.NAME, 'lab_msgs/msg/All'), rng)
        messages += [message] if len(message.bounded) > 1 else []
    fields = CdrFields(STORE.fielddefs, 'lab_msgs/msg/All', [path])
    (groups,) = fields.read(*packed(messages, 'lab_msgs/msg/All'))
    for group in groups:
        for row, values in zip(group.rows, group.values, strict=True):
            assert np.array_equal(values, looked_up(messages[row], path), equal_nan=True)


@pytest.mark.parametrize(
    'path',
    [
        ('nothing',),
        ('last',),
        ('names', 0),
        ('odd', 0, 'b'),
        ('value', 'x'),
        ('fixed', 3),
        ('fixed', 'x'),
        ('fixed', slice(0, 4)),
        ('named',),
        (),
    ],
)
def test_what_is_left_to_a_decoder_of_single_messages(path):
    with pytest.raises(UnreadableError):
        CdrFields(STORE.fielddefs, 'lab_msgs/msg/All', [path])


def test_a_type_that_contains_itself_or_is_not_there():
    with pytest.raises(UnreadableError):
        CdrFields({}, 'a/msg/A', [])
    loop = {'a/msg/A': ([], [('a', (Nodetype.NAME, 'a/msg/A'))])}
    with pytest.raises(UnreadableError):
        CdrFields(loop, 'a/msg/A', [])
    loop = {'a/msg/A': ([], [('a', (Nodetype.SEQUENCE, ((Nodetype.NAME, 'a/msg/A'), 0)))])}
    with pytest.raises(UnreadableError):
        CdrFields(loop, 'a/msg/A', [])


def test_a_type_without_fields_or_part():
    for field in ((Nodetype.NAME, 'a/msg/B'), (Nodetype.SEQUENCE, ((Nodetype.NAME, 'a/msg/B'), 0))):
        for others in ({}, {'a/msg/B': ([], [])}):
            with pytest.raises(UnreadableError):
                CdrFields({'a/msg/A': ([], [('b', field)]), **others}, 'a/msg/A', [])


def test_a_message_that_lacks_an_element():
    rng = np.random.default_rng(0)
    message = made((Nodetype.NAME, 'sensor_msgs/msg/LaserScan'), rng)
    message.ranges = np.zeros(3, dtype=np.float32)
    data = packed([message], 'sensor_msgs/msg/LaserScan')
    for step in (3, -4, slice(0, 4), slice(2, 2)):
        fields = CdrFields(STORE.fielddefs, 'sensor_msgs/msg/LaserScan', [('ranges', step)])
        with pytest.raises(UnreadableError, match='lacks'):
            fields.read(*data)


@settings(max_examples=80)
@given(st.integers(0, 2**32))
def test_no_damage_leads_out_of_the_message(seed):
    """Damaged messages are refused, or read as rosbags reads them."""
    rng = np.random.default_rng(seed)
    msgtype = TYPES[rng.integers(len(TYPES))]
    message = made((Nodetype.NAME, msgtype), rng)
    data = bytearray(STORE.serialize_cdr(message, msgtype))
    for _ in range(rng.integers(1, 4)):
        data[rng.integers(len(data))] = rng.choice([0, 1, 255, rng.integers(256)])
    data = bytes(data[: rng.integers(len(data) + 1)]) if rng.random() < 0.3 else bytes(data)
    paths = list(all_paths(msgtype))
    try:
        found = CdrFields(STORE.fielddefs, msgtype, paths).read(
            data, np.array([0]), np.array([len(data)])
        )
    except UnreadableError:
        return
    try:
        expected = STORE.deserialize_cdr(data, msgtype)
    except SerdeError as error:
        # Text is not looked at here.
        assume('utf-8' not in str(error))
        raise
    for path, (group,) in zip(paths, found, strict=True):
        assert np.array_equal(group.values[0], looked_up(expected, path), equal_nan=True)
