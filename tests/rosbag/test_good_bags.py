# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Recordings that other tools read, or that a killed recorder left: they are read here, too."""

import shutil
import struct
from itertools import product

import numpy as np
import pytest
from mcap.writer import Writer
from occ_constraints_pkg.datasets.extraction import extract
from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.features.feature_map import FeatureMap
from occ_constraints_pkg.features.sources import FeatureSource
from occ_constraints_pkg.rosbag import definitions
from occ_constraints_pkg.rosbag.definition_bounds import parse_definition
from occ_constraints_pkg.rosbag.recording import Recording
from rosbags.typesys import Stores, get_typestore

SEPARATOR = '=' * 80
CDR = b'\0\1\0\0'


def write(
    path, messages, *, msgtype='lab_msgs/msg/A', kind='ros2msg', text='', encoding='cdr', head=CDR
):
    """Write messages on /a, one per second."""
    with path.open('wb') as stream:
        writer = Writer(stream)
        writer.start('ros2')
        schema = writer.register_schema(msgtype, kind, text.encode())
        channel = writer.register_channel('/a', encoding, schema)
        for time, data in enumerate(messages, 1):
            writer.add_message(channel, time * 10**9, head + data, time * 10**9)
        writer.finish()
    return path


def values_of(path, *fields):
    features = (FeatureSource(f'f{number}', 'a', **item) for number, item in enumerate(fields))
    return extract([path], FeatureMap('a', 1.0, tuple(features))).values


RELEASES = [item for item in Stores if item.name.startswith('ROS2')]


@pytest.mark.parametrize('release', RELEASES)
def test_ranges_of_every_release_without_definitions(tmp_path, release):
    store = get_typestore(release)
    types = store.types
    time = types['builtin_interfaces/msg/Time'](1, 0)
    head = types['std_msgs/msg/Header'](time, 'sonar')
    has_variance = 'variance' in dict(store.fielddefs['sensor_msgs/msg/Range'][1])
    message = types['sensor_msgs/msg/Range'](
        head, 0, 0.5, 0.02, 4.0, 1.25, *([0.25] if has_variance else [])
    )
    data = bytes(store.serialize_cdr(message, message.__msgtype__))[4:]
    path = write(tmp_path / 'a.mcap', [data] * 3, msgtype=message.__msgtype__)
    # All have the same stamp.
    assert values_of(path, {'field': 'range'}).tolist() == [[1.25]]


@pytest.mark.parametrize('release', [Stores.ROS2_FOXY, Stores.ROS2_GALACTIC, Stores.ROS2_HUMBLE])
def test_other_types_that_have_changed(tmp_path, release):
    store = get_typestore(release)
    polygon = store.types['geometry_msgs/msg/Polygon']([])
    has_polygon = 'polygon' in dict(store.fielddefs['shape_msgs/msg/SolidPrimitive'][1])
    message = store.types['shape_msgs/msg/SolidPrimitive'](
        1, np.array([0.5, 1.5, 2.5]), *([polygon] if has_polygon else [])
    )
    data = bytes(store.serialize_cdr(message, message.__msgtype__))[4:]
    path = write(tmp_path / 'a.mcap', [data], msgtype=message.__msgtype__)
    assert values_of(path, {'field': 'dimensions[2]'}).tolist() == [[2.5]]


def test_a_type_of_no_release_is_told(tmp_path):
    path = write(tmp_path / 'a.mcap', [bytes(8)], msgtype='lab_msgs/msg/Unknown')
    with pytest.raises(OccError, match=r'--definitions DIR and AMENT_PREFIX_PATH say where'):
        values_of(path, {'field': 'x'})


@pytest.mark.parametrize('suffix', ['msg', 'idl'])
@pytest.mark.parametrize('where', ['folder', 'ament'])
def test_definitions_from_outside(tmp_path, monkeypatch, suffix, where):
    monkeypatch.setattr(definitions, '_folders', [])
    texts = {
        'msg': {'Drive': 'lab_msgs/Part part\nfloat64 x\n', 'Part': 'uint32 n\r\n'},
        'idl': {
            name: '#include "lab_msgs/msg/Part.idl"\n'
            f'module lab_msgs {{ module msg {{ {body} }}; }};'
            for name, body in {
                'Drive': 'struct Drive { lab_msgs::msg::Part part; double x; };',
                'Part': 'struct Part { uint32 n; };',
            }.items()
        },
    }[suffix]
    package = tmp_path / 'install' / 'share' / 'lab_msgs'
    (package / 'msg').mkdir(parents=True)
    for name, text in texts.items():
        (package / 'msg' / f'{name}.{suffix}').write_text(text)
    data = struct.pack('<Ixxxxd', 7, 2.5)
    path = write(tmp_path / 'a.mcap', [data] * 2, msgtype='lab_msgs/msg/Drive')
    if where == 'folder':
        definitions.search_folder(tmp_path)
    else:
        monkeypatch.setenv('AMENT_PREFIX_PATH', f'/nowhere:{tmp_path / "install"}')
    from occ_constraints_pkg.rosbag import typestores

    typestores.find_typestore.cache_clear()
    found = values_of(path, {'field': 'x'}, {'field': 'part.n'})
    assert found.tolist() == [[2.5, 7.0]] * 2
    typestores.find_typestore.cache_clear()


WIDE = {
    'a character in two bytes': lambda text: struct.pack('<I', len(text)) + text.encode('utf-16le'),
    'in four bytes': lambda text: struct.pack('<I', len(text)) + text.encode('utf-32le'),
    'length in bytes': lambda text: struct.pack('<I', 2 * len(text)) + text.encode('utf-16le'),
}
WIDE_TYPES = {
    'ros2msg': 'wstring<=9 label\nfloat64 x\n',
    'ros2idl': f'{SEPARATOR}\nIDL: lab_msgs/msg/A\n'
    'module lab_msgs { module msg { struct A { wstring<9> label; double x; }; }; };',
}


@pytest.mark.parametrize(('form', 'kind'), list(product(WIDE, WIDE_TYPES)))
def test_what_stands_beside_a_wstring(tmp_path, form, kind):
    def message(text, x):
        data = WIDE[form](text)
        return data + bytes(-len(data) % 8) + struct.pack('<d', x)

    path = write(
        tmp_path / 'a.mcap',
        [message('', 1.0), message('abc', 2.0), message('äöü€!', 3.0)],
        kind=kind,
        text=WIDE_TYPES[kind],
    )
    assert values_of(path, {'field': 'x'}).ravel().tolist() == [1.0, 2.0, 3.0]


@pytest.mark.parametrize(
    ('kind', 'text'),
    [
        ('ros2msg', 'int8 A=1\r\nfloat64 x\r\n'),
        ('ros2msg', 'string EMPTY=\nstring E2=""  # none\nstring E3=a # b\nfloat64 x\n'),
        ('ros2msg', 'wstring W="a"\nfloat64 x\nstring E=\n'),
        ('ros2msg', f'float64 x\r\n{SEPARATOR}\r\nMSG: std_msgs/Header\r\nstring frame_id\r\n'),
        ('ros2msg', '# a comment\r\rfloat64 x\r'),
        (
            'ros2idl',
            f'{SEPARATOR}\r\nIDL: lab_msgs/msg/A\r\n#include "a/b.idl"\r\nmodule lab_msgs {{\r\n'
            'module msg {\r\nmodule A_Constants {\r\n'
            'const string E = ""; const wstring W = L""; };\r\n'
            'struct A {\r\n@verbatim (language="comment", text="a" "\\n" "b")\r\n'
            'double x; }; }; };',
        ),
        (
            'ros2idl',
            '#ifndef A\n#define A\n#include <a.idl>\n/* of "two"\nlines */ module lab_msgs {\n'
            'module msg { struct A { double x; }; }; };\n#endif\n',
        ),
    ],
)
def test_definitions_as_tools_write_them(tmp_path, kind, text):
    path = write(tmp_path / 'a.mcap', [struct.pack('<d', 2.5)], kind=kind, text=text)
    assert values_of(path, {'field': 'x'}).tolist() == [[2.5]]


def test_idl_whose_included_types_are_not_in_the_bag(tmp_path):
    text = (
        '#include "builtin_interfaces/msg/Time.idl"\nmodule lab_msgs { module msg { struct A {'
        ' builtin_interfaces::msg::Time stamp; std_msgs::msg::ColorRGBA color; }; }; };'
    )
    data = struct.pack('<iIffff', 1, 2, 0.25, 0.5, 0.75, 1.0)
    path = write(tmp_path / 'a.mcap', [data], kind='ros2idl', text=text)
    assert values_of(path, {'field': 'color.b'}).tolist() == [[0.75]]


def test_fields_keep_their_place_without_text_constants():
    text = 'string<=5 name\nstring CONSTANT = "a=b"\nstring label "x"\nuint8 A=\nuint8 y 3\n'
    (_, fields) = parse_definition(text, 'ros2msg', 'lab_msgs/msg/A')['lab_msgs/msg/A']
    assert [name for name, _ in fields] == ['name', 'label', 'y']


def test_messages_without_bytes_are_left_out(tmp_path):
    with (tmp_path / 'a.mcap').open('wb') as stream:
        writer = Writer(stream)
        writer.start('ros2')
        schema = writer.register_schema('std_msgs/msg/Float64', 'ros2msg', b'float64 data\n')
        channel = writer.register_channel('/a', 'cdr', schema)
        for time in range(1, 7):
            data = b'' if time in (1, 4) else b'\0\1\0\0' + struct.pack('<d', time)
            writer.add_message(channel, time * 10**9, data, time * 10**9)
        writer.finish()
    wanted = FeatureMap('a', 1.0, (FeatureSource('x', 'a', 'data'),))
    found = extract([tmp_path / 'a.mcap'], wanted)
    assert found.values.ravel().tolist() == [2.0, 3.0, 5.0, 6.0]
    (warning,) = found.warnings
    assert "2 messages without any bytes on '/a', which are left out" in warning


def test_an_empty_metadata_is_as_none(tmp_path, messages, write_bag):
    bag = write_bag([('/t', messages.twist(x=1.0), 1)])
    for text in ('', '\n', '\0' * 512):
        (bag / 'metadata.yaml').write_text(text)
        recording = Recording(bag)
        assert recording.message_count == 1
        assert 'metadata.yaml is empty' in recording.warnings[0]


def test_splits_that_metadata_does_not_list(tmp_path, messages, write_bag):
    bags = [write_bag([('/t', messages.twist(x=float(x)), x)], name=f'bag{x}') for x in (1, 2, 3)]
    (first,) = bags[0].glob('*.mcap')
    stem = first.name.removesuffix('_0.mcap')
    for number, bag in enumerate(bags[1:], 1):
        (file,) = bag.glob('*.mcap')
        shutil.copy(file, bags[0] / f'{stem}_{number}.mcap')
    # These are none: another recording, and a part of this one for somebody's use.
    shutil.copy(first, bags[0] / 'other_0.mcap')
    shutil.copy(first, bags[0] / 'filtered.mcap')
    recording = Recording(bags[0])
    assert [raw.log_time_ns for raw in recording.messages()] == [1, 2, 3]
    assert f'holds {stem}_1.mcap, {stem}_2.mcap, which its metadata' in recording.warnings[0]


@pytest.mark.parametrize(
    ('head', 'name'),
    [(b'\0\7', 'XCDR2 (plain)'), (b'\0\x09', 'XCDR2 (delimited)'), (b'\0\3', 'XCDR1 with param')],
)
def test_encodings_are_refused_by_name(tmp_path, head, name):
    path = write(tmp_path / 'a.mcap', [bytes(8)], text='float64 x\n', head=head + b'\0\0')
    problem = Recording(path).problem('/a')
    assert f'encoded in {name}' in problem


@pytest.mark.parametrize('encoding', ['json', 'protobuf', 'ros1', 'cdr_le'])
def test_other_serializations_are_refused_by_name(tmp_path, encoding):
    path = write(tmp_path / 'a.mcap', [bytes(8)], kind='other', text='?', encoding=encoding)
    recording = Recording(path)
    assert f"serialized as '{encoding}'; allowed is 'cdr'" in recording.problem('/a')
    with pytest.raises(OccError, match=f"serialized as '{encoding}'"):
        values_of(path, {'field': 'x'})


def test_texts_without_their_zero_are_named(tmp_path):
    store = get_typestore(Stores.ROS2_JAZZY)
    types = store.types
    header = types['std_msgs/msg/Header'](types['builtin_interfaces/msg/Time'](1, 0), 'imulink')
    data = bytearray(store.serialize_cdr(header, header.__msgtype__))[4:]
    data[8] = 7
    path = write(tmp_path / 'a.mcap', [bytes(data)], msgtype=header.__msgtype__)
    assert "the text 'imulink' in it does not end in a zero byte" in Recording(path).problem('/a')


def test_times_by_stamps_where_log_times_say_nothing(messages, write_bag):
    entries = [
        ('/a', messages.odometry(stamp_ns=(100 + tick) * 10**9, x=float(tick)), 0)
        for tick in range(4)
    ]
    wanted = FeatureMap('a', 1.0, (FeatureSource('x', 'a', 'twist.twist.linear.x'),))
    found = extract([write_bag(entries)], wanted)
    assert (found.times_ns / 1e9).tolist() == [0.0, 1.0, 2.0, 3.0]
    assert 'have the same log time' in found.warnings[0]
    assert np.array_equal(found.values.ravel(), range(4))


@pytest.mark.parametrize('little_endian', [True, False])
@pytest.mark.parametrize('first', ['plain', 'stamped'])
def test_both_a_type_and_its_stamped_form_on_one_topic(tmp_path, messages, first, little_endian):
    store = get_typestore(Stores.ROS2_JAZZY)
    path = tmp_path / 'a.mcap'
    with path.open('wb') as stream:
        writer, channels = Writer(stream), {}
        writer.start('ros2')
        for time in range(1, 7):
            message = messages.twist(x=float(time), wz=0.5)
            if (time % 2 == 0) == (first == 'plain'):
                header = messages.header(time * 10**9, 'base')
                message = store.types['geometry_msgs/msg/TwistStamped'](header, message)
            name = message.__msgtype__
            if name not in channels:
                text, _ = store.generate_msgdef(name, ros_version=2)
                schema = writer.register_schema(name, 'ros2msg', text.encode())
                channels[name] = writer.register_channel('/a', 'cdr', schema)
            data = bytes(store.serialize_cdr(message, name, little_endian=little_endian))
            writer.add_message(channels[name], time * 10**9, data, time * 10**9)
        writer.finish()
    found = values_of(path, {'field': 'linear.x'}, {'field': 'twist.angular.z'})
    assert found.tolist() == [[float(time), 0.5] for time in range(1, 7)]
    recording = Recording(path)
    stamps = [recording.decode(raw).header.stamp.sec for raw in recording.messages()]
    assert stamps == ([0, 2, 0, 4, 0, 6] if first == 'plain' else [1, 0, 3, 0, 5, 0])
    assert 'geometry_msgs/msg/Twist are read as geometry_msgs/msg/TwistS' in recording.warnings[0]
