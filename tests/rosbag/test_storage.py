# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Files of each kind, whole, cut short, damaged and malicious."""

import io
import os
import shutil
import sqlite3
import subprocess
import sys
from contextlib import closing

import numpy as np
import pytest
import zstandard
from fuzz_bags import bombs
from mcap.writer import CompressionType, Writer
from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.rosbag.recording import Recording
from occ_constraints_pkg.rosbag.storage import Block, in_log_order, unpack_zstd
from rosbags.typesys import Stores, get_typestore

STORE = get_typestore(Stores.ROS2_JAZZY)
TYPE = 'std_msgs/msg/UInt64'


def number(value):
    return b'\0\1\0\0' + value.to_bytes(8, 'little')


def numbers(recording, topics=None):
    return [int.from_bytes(raw.data[4:12], 'little') for raw in recording.messages(topics)]


def write_mcap(path, times, *, topics=('/n',), schema=b'uint64 data\n', **options):
    with path.open('wb') as stream:
        writer = Writer(stream, **options)
        writer.start('ros2')
        schema = writer.register_schema(TYPE, 'ros2msg', schema)
        channels = [writer.register_channel(topic, 'cdr', schema) for topic in topics]
        for value, time in enumerate(times):
            writer.add_message(channels[value % len(channels)], time, number(value), time)
        writer.finish()


def write_sqlite(path, times, *, padding=0, msgtype=TYPE, messages=None):
    padded = [number(value) + bytes(padding) for value in range(len(times))]
    with closing(sqlite3.connect(path)) as database:
        database.executescript(
            'CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT NULL,'
            ' serialization_format TEXT NOT NULL);'
            'CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL,'
            ' timestamp INTEGER NOT NULL, data BLOB NOT NULL);'
        )
        database.execute('INSERT INTO topics VALUES (1, ?, ?, ?)', ('/n', msgtype, 'cdr'))
        database.executemany(
            'INSERT INTO messages(topic_id, timestamp, data) VALUES (1, ?, ?)',
            zip(times, messages or padded, strict=True),
        )
        database.commit()


def test_the_first_schema_of_sqlite_without_an_index_or_qos(tmp_path):
    times = [(i * 37) % 100 for i in range(300)]
    write_sqlite(tmp_path / 'a.db3', times)
    recording = Recording(tmp_path / 'a.db3')
    assert numbers(recording) == sorted(range(300), key=lambda i: times[i])
    assert recording.topics['/n'].offered_qos == ()
    assert sorted(tmp_path.iterdir()) == [tmp_path / 'a.db3']


def test_types_named_as_before_dashing(tmp_path):
    write_sqlite(tmp_path / 'a.db3', [1], msgtype='std_msgs/UInt64')
    recording = Recording(tmp_path / 'a.db3')
    assert recording.decode(next(recording.messages())).data == 0


def test_a_database_cut_short_gives_its_complete_messages(tmp_path):
    write_sqlite(tmp_path / 'whole.db3', range(200), padding=9000)
    whole = (tmp_path / 'whole.db3').read_bytes()
    counts = []
    path = tmp_path / 'cut.db3'
    for share in (0.99, 0.7, 0.3):
        path.write_bytes(whole[: int(len(whole) * share)])
        recording = Recording(path)
        assert numbers(recording) == list(range(recording.message_count))
        assert f'the {recording.message_count} complete messages' in recording.warnings[0]
        counts.append(recording.message_count)
    assert counts == sorted(counts, reverse=True)
    assert 120 < counts[1] < 150
    path.write_bytes(whole[:2000])
    with pytest.raises(OccError, match='cannot be read'):
        Recording(path)


def test_rows_that_are_no_messages(tmp_path):
    path = tmp_path / 'a.db3'
    for statement, reason in [
        ("UPDATE messages SET timestamp = 'noon' WHERE id = 5", 'row 5 lacks'),
        ('UPDATE messages SET topic_id = 9 WHERE id = 5', 'unknown topic 9'),
        ('UPDATE messages SET timestamp = -1 WHERE id = 5', 'the time -1'),
    ]:
        path.unlink(missing_ok=True)
        write_sqlite(path, range(8))
        with closing(sqlite3.connect(path)) as database:
            database.execute(statement)
            database.commit()
        recording = Recording(path)
        assert numbers(recording) == [0, 1, 2, 3]
        assert reason in recording.warnings[0]
    with closing(sqlite3.connect(path)) as database:
        database.execute("UPDATE topics SET name = x'00ff' WHERE id = 1")
        database.commit()
    with pytest.raises(OccError, match='its table of topics is damaged'):
        Recording(path)


def test_a_write_ahead_log_is_read_and_left_alone(tmp_path):
    path = tmp_path / 'a.db3'
    write_sqlite(path, range(3))
    with closing(sqlite3.connect(path)) as database:
        database.execute('PRAGMA journal_mode = WAL')
        database.execute('INSERT INTO messages VALUES (9, 1, 7, ?)', (number(3),))
        database.commit()
        folder = tmp_path / 'copy'
        folder.mkdir()
        for file in tmp_path.glob('a.db3*'):
            shutil.copy(file, folder)
    before = {file.name: file.read_bytes() for file in folder.iterdir()}
    assert any(name.endswith('-wal') for name in before)
    assert numbers(Recording(folder / 'a.db3')) == [0, 1, 2, 3]
    assert {file.name: file.read_bytes() for file in folder.iterdir()} == before


def test_messages_outside_of_the_chunks_are_not_missed(tmp_path):
    """A summary indexes chunks only, and a file may have both."""
    chunked, loose = io.BytesIO(), io.BytesIO()
    for stream, options in ((chunked, {}), (loose, {'use_chunking': False})):
        writer = Writer(stream, **options)
        writer.start('ros2')
        schema = writer.register_schema(TYPE, 'ros2msg', b'uint64 data\n')
        channel = writer.register_channel('/n', 'cdr', schema)
        for value in range(4):
            writer.add_message(channel, value, number(value + 4 * (stream is loose)), value)
        writer.finish()
    content, other = chunked.getvalue(), loose.getvalue()
    message = b'\5' + (22 + 12).to_bytes(8, 'little')
    extra = other[other.index(message) : other.rindex(message) + 9 + 34]
    # Between the header and the first chunk, whose offset in the summary then is wrong.
    path = tmp_path / 'a.mcap'
    chunk = content.index(b'\6', 8 + 9)
    path.write_bytes(content[:chunk] + extra + content[chunk:])
    with pytest.raises(OccError, match='holds no messages'):
        Recording(path)
    end = content.index(b'\x0f' + (4).to_bytes(8, 'little'))
    path.write_bytes(content[:end] + extra + content[end:])
    assert sorted(numbers(Recording(path))) == list(range(8))


def test_statistics_that_promise_other_counts(tmp_path):
    path = tmp_path / 'a.mcap'
    write_mcap(path, range(6), topics=('/a', '/b'), enable_crcs=False)
    content = path.read_bytes()
    counts = b''.join(
        channel.to_bytes(2, 'little') + (3).to_bytes(8, 'little') for channel in (1, 2)
    )
    swapped = counts.replace(b'\3', b'\2', 1).replace(b'\3', b'\4', 1)
    assert content.count(counts) == 1
    path.write_bytes(content.replace(counts, swapped))
    with pytest.raises(OccError, match="it has 3 messages on '/a' instead of 2"):
        numbers(Recording(path))


def test_one_topic_with_two_types_or_definitions(tmp_path):
    write_mcap(tmp_path / 'bag_0.mcap', [1])
    write_mcap(tmp_path / 'bag_1.mcap', [2], schema=b'uint64 data # the same\n')
    assert numbers(Recording(tmp_path)) == [0, 0]
    write_mcap(tmp_path / 'bag_2.mcap', [3], schema=b'uint64 data\nuint64 more\n')
    with pytest.raises(OccError, match="topic '/n' with two definitions"):
        numbers(Recording(tmp_path))
    (tmp_path / 'bag_2.mcap').unlink()
    write_sqlite(tmp_path / 'bag_3.db3', [3], msgtype='std_msgs/msg/String')
    write_mcap(tmp_path / 'bag_4.mcap', [7], topics=('/other',))
    recording = Recording(tmp_path)
    for read in (numbers, lambda item: item.fields('/n')):
        with pytest.raises(OccError, match="two types, 'std_msgs/msg/UInt64' and 'std_msgs/"):
            read(recording)
    assert 'two types' in recording.problem('/n')
    # Whoever does not need the topic is not stopped by it.
    assert [raw.topic for raw in recording.messages(['other'])] == ['/other']
    assert recording.problem('/other') == ''


def test_two_topics_with_one_type_of_two_definitions(tmp_path):
    path = tmp_path / 'a.mcap'
    with path.open('wb') as stream:
        writer = Writer(stream)
        writer.start('ros2')
        for topic, text in (('/a', b'uint32 x\n'), ('/b', b'uint32 y\nuint32 x\n')):
            schema = writer.register_schema('lab_msgs/msg/A', 'ros2msg', text)
            channel = writer.register_channel(topic, 'cdr', schema)
            data = b'\0\1\0\0' + b'\1\0\0\0\2\0\0\0'[: 4 * text.count(b'\n')]
            writer.add_message(channel, 1, data, 1)
        writer.finish()
    recording = Recording(path)
    decoded = {raw.topic: recording.decode(raw).x for raw in recording.messages()}
    assert decoded == {'/a': 1, '/b': 2}


@pytest.mark.parametrize('kind', ['mcap', 'db3'])
def test_a_bare_file_compressed_as_a_whole_and_cut_short(tmp_path, kind):
    whole, path = tmp_path / f'a.{kind}', tmp_path / f'b.{kind}.zstd'
    if kind == 'mcap':
        write_mcap(whole, range(20_000), chunk_size=2000, compression=CompressionType.NONE)
    else:
        write_sqlite(whole, range(20_000), padding=70)
    compressed = zstandard.ZstdCompressor(level=1).compress(whole.read_bytes())
    path.write_bytes(compressed)
    assert numbers(Recording(path)) == list(range(20_000))
    assert Recording(path).name == 'b'
    path.write_bytes(compressed[: len(compressed) * 2 // 3])
    recording = Recording(path)
    assert 0 < recording.message_count < 20_000
    assert numbers(recording) == list(range(recording.message_count))
    assert str(path) in recording.warnings[0]
    path.write_bytes(compressed[:9])
    with pytest.raises(OccError, match='nothing of it can be unpacked'):
        Recording(path)


def test_an_unpacked_file_goes_with_its_recording(tmp_path, monkeypatch):
    monkeypatch.setattr('tempfile.tempdir', str(tmp_path / 'temporary'))
    (tmp_path / 'temporary').mkdir()
    write_mcap(tmp_path / 'a.mcap', range(5))
    packed = zstandard.ZstdCompressor().compress((tmp_path / 'a.mcap').read_bytes())
    (tmp_path / 'a.mcap.zstd').write_bytes(packed)
    recording = Recording(tmp_path / 'a.mcap.zstd')
    assert len(list((tmp_path / 'temporary').iterdir())) == 1
    assert numbers(recording) == list(range(5))
    del recording
    assert list((tmp_path / 'temporary').iterdir()) == []


def test_a_file_that_unpacks_to_far_too_much(tmp_path):
    path = tmp_path / 'a.mcap.zstd'
    path.write_bytes(zstandard.ZstdCompressor().compress(bytes(1 << 27)))
    with pytest.raises(OccError, match='unpacks to more than 2000 times its size'):
        Recording(path)


BOMB = """
import sys
from pathlib import Path
from fuzzing import peak_bytes
from occ_constraints_pkg.rosbag.recording import Recording
from occ_constraints_pkg.errors import OccError
try:
    print(list(Recording(Path(sys.argv[1])).messages()))
except OccError as error:
    print(error)
print(peak_bytes())
"""


@pytest.mark.parametrize('name', ['zstd_1048576', 'lz4_1048576', 'zstd_2147483648', f'lz4_{2**63}'])
def test_decompression_bombs_do_not_fill_the_memory(tmp_path, bomb_files, name):
    path = tmp_path / 'bomb.mcap'
    path.write_bytes(bomb_files[name])
    done = subprocess.run(
        [sys.executable, '-c', BOMB, str(path)],
        capture_output=True,
        text=True,
        check=True,
        env={**os.environ, 'PYTHONPATH': os.pathsep.join(sys.path)},
    )
    sentence, peak = done.stdout.splitlines()
    assert 'holds no messages' in sentence
    assert int(peak) < 400e6


@pytest.fixture(scope='module')
def bomb_files():
    return bombs()


def test_unpacking_is_bounded():
    packed = zstandard.ZstdCompressor().compress(b'a' * 1000)
    assert unpack_zstd(packed, 1000) == b'a' * 1000
    assert unpack_zstd(packed + packed, 2000) == b'a' * 2000
    with pytest.raises(ValueError, match='more bytes than they should'):
        unpack_zstd(packed, 999)
    with pytest.raises(ValueError, match='invalid'):
        unpack_zstd(b'hello' * 9, 999)


def block(times, topic):
    data = b''.join(int(time).to_bytes(2, 'little') + bytes([topic]) for time in times)
    starts = np.arange(len(times)) * 3
    return Block(data, np.full(len(times), topic), np.array(times), starts, starts + 3)


def test_pieces_that_overlap_are_joined_in_log_order():
    rng = np.random.default_rng(0)
    for _ in range(50):
        blocks = [block(sorted(rng.integers(0, 300, rng.integers(0, 9))), i) for i in range(8)]
        pieces = [(int(b.times[0]) if len(b) else 0, i, b) for i, b in enumerate(blocks)]
        pieces.sort(key=lambda piece: piece[:2])
        merged = list(in_log_order((start, lambda b=b: b) for start, _, b in pieces))
        found = [(b.times[row], b.topics[row]) for b in merged for row in range(len(b))]
        order = {number: place for place, (_, number, _) in enumerate(pieces)}
        every = [(t, n) for n, b in enumerate(blocks) for t in b.times]
        assert found == sorted(every, key=lambda item: (item[0], order[item[1]]))
        for b in merged:
            for row in range(len(b)):
                data = int(b.times[row]).to_bytes(2, 'little') + bytes([b.topics[row]])
                assert b.message(row) == data


MEMORY = """
import sys
from pathlib import Path
from fuzzing import peak_bytes
from occ_constraints_pkg.datasets.extraction import extract
from occ_constraints_pkg.features.feature_map import FeatureMap, FeatureSource
from occ_constraints_pkg.rosbag.recording import Recording

def read(path):
    extract([path], FeatureMap('n', 1.0, (FeatureSource('n', 'n', 'header.stamp.sec'),)))
    assert sum(1 for _ in Recording(path).messages()) == int(sys.argv[2])
    return peak_bytes()

print(read(Path(sys.argv[1])))
"""


@pytest.mark.parametrize('kind', ['mcap', 'db3'])
def test_memory_does_not_grow_with_the_length(tmp_path, kind):
    types = STORE.types
    peaks = []
    for count in (300, 1500):
        path = tmp_path / f'{count}.{kind}'
        messages = []
        for value in range(count):
            header = types['std_msgs/msg/Header'](
                types['builtin_interfaces/msg/Time'](value, 0), ''
            )
            image = types['sensor_msgs/msg/CompressedImage'](
                header, 'png', np.zeros(40_000, dtype=np.uint8)
            )
            messages.append(bytes(STORE.serialize_cdr(image, image.__msgtype__)))
        if kind == 'db3':
            write_sqlite(path, range(count), msgtype=image.__msgtype__, messages=messages)
        else:
            with path.open('wb') as stream:
                writer = Writer(stream, compression=CompressionType.NONE)
                writer.start('ros2')
                schema = writer.register_schema(image.__msgtype__, 'ros2msg', b'')
                channel = writer.register_channel('/n', 'cdr', schema)
                for value, data in enumerate(messages):
                    writer.add_message(channel, value, data, value)
                writer.finish()
        done = subprocess.run(
            [sys.executable, '-c', MEMORY, str(path), str(count)],
            capture_output=True,
            text=True,
            check=True,
            env={**os.environ, 'PYTHONPATH': os.pathsep.join(sys.path)},
        )
        peaks.append(int(done.stdout))
    # The long recording has 48 MB more.
    assert peaks[1] - peaks[0] < 10e6
