# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Definitions in bags: what is hostile is refused in no time, what is usual is read as ever."""

import time

import pytest
from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.rosbag.definition_bounds import BoundsError, parse_definition
from occ_constraints_pkg.rosbag.idl_text import IdlError
from occ_constraints_pkg.rosbag.recording import Recording
from occ_constraints_pkg.rosbag.typestores import UndefinedTypeError, find_typestore
from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_types_from_idl, get_typestore

JAZZY = get_typestore(Stores.ROS2_JAZZY)


def idl(fields='long y;', before='', inside=''):
    return f'{before}\nmodule p {{ module msg {{ {inside} struct X {{ {fields} }}; }}; }};'


def part(name, text):
    return f'\n{"=" * 80}\nMSG: p/{name}\n{text}'


BOMBS = {
    'shift': ('ros2idl', idl(before='const unsigned long long X = 1<<100000000000;')),
    'shift of a constant': (
        'ros2idl',
        idl(before='const long A = 63; const long B = 1 << A << A;'),
    ),
    'squares': (
        'ros2idl',
        idl(
            before='const long A0 = 9;'
            + ''.join(f'const long A{i + 1} = A{i} * A{i};' for i in range(50))
        ),
    ),
    'length': ('ros2idl', idl('long y[1<<63];')),
    'length of a sequence': ('ros2idl', idl('sequence<long, 1<<1000000> y;')),
    'negative length': ('ros2idl', idl('long y[-1];')),
    'unknown length': ('ros2idl', idl('long y[Q];')),
    'division by zero': ('ros2idl', idl(before='const long A = 1 / 0;')),
    'infinite': ('ros2idl', idl(before='const double A = 1e999;')),
    'many brackets': ('ros2idl', idl(before=f'const long A = {"(" * 3000}1;')),
    'many signs': ('ros2idl', idl(before=f'const long A = {"-" * 3000}1;')),
    'sequences in sequences': ('ros2idl', idl('sequence<' * 50 + 'long' + '>' * 50 + ' y;')),
    'modules in modules': ('ros2idl', 'module a { ' * 2000 + 'struct X { long y; };' + '};' * 2000),
    'comment without end': ('ros2idl', '/*' * 100_000 + idl()),
    'no end': ('ros2idl', 'const long A = 1'),
    'infinite number': ('ros2msg', 'float64 X=1e999\nint8 a'),
    'too large a number': ('ros2msg', f'uint64 X={2**64}\nint8 a'),
    'thousands of digits': ('ros2msg', f'uint64 X={"9" * 60_000}\nint8 a'),
    'large array': ('ros2msg', 'int8[4294967295] a'),
    'array of texts': ('ros2msg', 'string[268435455] a'),
    'arrays in arrays': (
        'ros2msg',
        'B[500] b' + part('B', 'C[500] c') + part('C', 'D[500] d') + part('D', 'int8 x'),
    ),
    'contains itself': ('ros2msg', 'X a'),
    'contains itself in a sequence': ('ros2msg', 'X[] a'),
    'thousands of fields': ('ros2msg', ''.join(f'int8 a{i}\n' for i in range(30_000))),
    'thousands of types': (
        'ros2msg',
        'int8 a' + ''.join(part(f'B{i}', 'int8 a') for i in range(3000)),
    ),
    'megabytes': ('ros2msg', 'int8 a\n' + '# comment\n' * 200_000),
}


@pytest.mark.parametrize('name', list(BOMBS))
def test_a_bomb_is_refused_at_once(name):
    kind, text = BOMBS[name]
    begin = time.process_time()
    with pytest.raises(UndefinedTypeError) as caught:
        find_typestore(text, kind, 'p/msg/X')
    assert time.process_time() - begin < 3.0
    assert len(caught.value.reason) < 300


@pytest.mark.parametrize(
    'name', ['os.system/msg/X', 'p/msg/X\nint8 b', '', '../msg/X', 'p/msg/X/y/z']
)
def test_a_type_has_the_name_of_one(name):
    with pytest.raises(UndefinedTypeError, match='is no name of a type'):
        find_typestore('int8 a', 'ros2msg', name)


def test_brackets_that_stop_the_parser_of_rosbags_cost_nothing():
    text = idl('long y[((((((((2 + 3))))))))];', '@note(a=(((((((1))))))))')
    assert parse_definition(text, 'ros2idl', 'p/msg/X')['p/msg/X'][1] == [
        ('y', (Nodetype.ARRAY, ((Nodetype.BASE, ('int32', 0)), 5)))
    ]


@pytest.mark.parametrize(
    ('expression', 'length'),
    [
        ('3', 3),
        ('0x10', 16),
        ('010', 8),
        ('2 + 3 * 4', 14),
        ('(2 + 3) * 4', 20),
        ('1 << 4 | 3', 19),
        ('256 >> 2 >> 1', 32),
        ('7 / 2', 3),
        ('7 % 4 ^ 1', 2),
        ('-1 + 4', 3),
        ('~0 & 15', 15),
        ('10 - 3 - 2', 5),
        ('A', 6),
        ('p::A + 1', 7),
        ('::G', 2),
    ],
)
def test_lengths_are_computed_as_idl_says(expression, length):
    text = idl(f'long y[{expression}];', 'const long G = 2; const long A = 1;')
    text = text.replace('module p {', 'module p { const long A = G * 3;')
    (_, (_, (_, got))) = parse_definition(text, 'ros2idl', 'p/msg/X')['p/msg/X'][1][0]
    assert got == length


def test_idl_as_ros_generates_it_is_read_as_before():
    constants = (
        'module X_Constants { const float F = 1.5; const string S = "a;" "b\\""; '
        "const char C = 'x'; };"
    )
    fields = (
        '@verbatim (language="comment", text="not (a bracket") '
        '@default (value=0.1) double a; sequence<sequence_t, 4> b; string<10> c; '
        'sequence<double> d; ours__double__9 f; p::msg::Part g;'
    )
    inside = (
        f'{constants} typedef double ours__double__9[9]; typedef long sequence_t; '
        'struct Part { float x; /* a comment */ }; // another'
    )
    text = '#include "p/msg/Part.idl"\n' + idl(fields, inside=inside.replace('// another', ''))
    plain = '\n'.join(line for line in text.splitlines() if not line.startswith('#'))
    expected = {name: fields for name, (_, fields) in get_types_from_idl(plain).items()}
    got = parse_definition(text, 'ros2idl', 'p/msg/X')
    assert {name: fields for name, (_, fields) in got.items()} == expected
    assert set(got) == {'p/msg/X', 'p/msg/Part'}


def test_every_type_of_jazzy_is_within_the_bounds():
    for name in JAZZY.fielddefs:
        text, _ = JAZZY.generate_msgdef(name, ros_version=2)
        types = parse_definition(text, 'ros2msg', name)
        # The store gives a byte to messages without fields.
        expected = [
            item for item in JAZZY.fielddefs[name][1] if not item[0].startswith('structure')
        ]
        assert types[name][1] == expected


def test_errors_say_what_is_wrong():
    with pytest.raises(IdlError, match='a shift by 100 bits; allowed are 0 to 63'):
        parse_definition(idl('long y[1 << 100];'), 'ros2idl', 'p/msg/X')
    with pytest.raises(BoundsError, match='the constant X does not fit into 64 bits'):
        parse_definition('float64 X=1e999', 'ros2msg', 'p/msg/X')


def test_a_recording_says_it_in_one_sentence(bag_with_definition):
    recording = Recording(bag_with_definition('float64 X=1e999\nfloat64 y'))
    with pytest.raises(
        OccError, match="'/t' .*cannot be used: the constant X does not fit"
    ) as caught:
        recording.decode(next(recording.messages()))
    assert '\n' not in str(caught.value)


@pytest.fixture
def bag_with_definition(tmp_path):
    """Return a function that writes a bag of one message whose type has that definition."""
    from mcap.writer import Writer

    def write(text, kind='ros2msg'):
        path = tmp_path / 'bag.mcap'
        with path.open('wb') as stream:
            writer = Writer(stream)
            writer.start('ros2')
            schema = writer.register_schema('p/msg/X', kind, text.encode())
            channel = writer.register_channel('/t', 'cdr', schema)
            writer.add_message(channel, 1, b'\0\1\0\0' + bytes(8), 1)
            writer.finish()
        return path

    return write
