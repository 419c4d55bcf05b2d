# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Clips: pieces of recordings as recordings of their own; and which recordings a folder holds."""

import pytest
from occ_constraints_pkg.errors import DataError
from occ_constraints_pkg.rosbag.clips import write_clip
from occ_constraints_pkg.rosbag.file_names import recordings_in
from occ_constraints_pkg.rosbag.recording import Recording
from occ_constraints_pkg.rosbag.writer import BagWriter
from synthetic_bags import START_NS, STORE, write_rover

from experiments.robot_kinds import write_robot

LATCHED = {'history': 'keep_last', 'depth': 1, 'durability': 'transient_local'}


def text(content):
    message = STORE.types['std_msgs/msg/String'](content)
    return bytes(STORE.serialize_cdr(message, message.__msgtype__))


def write_texts(path, entries, **options):
    """Write ``(seconds, topic, text, qos)``."""
    with BagWriter(path, **options) as bag:
        for seconds, topic, content, qos in entries:
            when = START_NS + round(seconds * 1e9)
            bag.write(topic, 'std_msgs/msg/String', text(content), when, qos=qos)
    return Recording(path)


def contents(path):
    recording = Recording(path)
    return [
        (round((raw.log_time_ns - START_NS) * 1e-9, 3), raw.topic, recording.decode(raw).data)
        for raw in recording.messages()
    ]


def test_a_clip_holds_its_time_and_what_was_latched_before(tmp_path):
    recording = write_texts(
        tmp_path / 'bag',
        [
            (0.0, '/map', 'old', [LATCHED]),
            (0.5, '/said', 'before', [{**LATCHED, 'durability': 'volatile'}]),
            (1.0, '/map', 'new', [LATCHED]),
            (2.0, '/said', 'first', None),
            (3.0, '/map', 'later', None),
            (4.0, '/said', 'last', None),
            (4.1, '/said', 'after', None),
        ],
    )
    path, skipped = write_clip(
        recording, tmp_path / 'clip', START_NS + 2 * 10**9, START_NS + 4 * 10**9
    )
    assert skipped == ()
    assert path.is_file()
    assert contents(tmp_path / 'clip') == [
        (2.0, '/map', 'old'),
        (2.0, '/map', 'new'),
        (2.0, '/said', 'first'),
        (3.0, '/map', 'later'),
        (4.0, '/said', 'last'),
    ]
    assert Recording(tmp_path / 'clip').topics['/map'].offered_qos[0]['durability'] == (
        'transient_local'
    )


def test_types_that_only_the_recording_defines_are_kept(tmp_path):
    source = Recording(write_robot(tmp_path, 'px4', 0))
    middle = source.start_ns + 20 * 10**9
    path, _ = write_clip(source, tmp_path / 'clip', middle - 10**9, middle + 10**9)
    clip = Recording(path)
    for topic, info in source.topics.items():
        assert clip.topics[topic].definition == info.definition
        clip.decode(next(clip.messages([topic])))


def test_a_time_outside_is_refused(tmp_path):
    recording = Recording(write_rover(tmp_path / 'bag'))
    with pytest.raises(DataError, match='a time within the recording'):
        write_clip(recording, tmp_path / 'clip', START_NS + 10**12, START_NS + 2 * 10**12)
    with pytest.raises(DataError, match='exists already'):
        write_clip(recording, tmp_path / 'bag', START_NS, START_NS + 10**9)


def test_the_file_of_a_moment_in_a_split_recording(tmp_path):
    recording = write_texts(
        tmp_path / 'bag',
        [(float(second), '/said', str(second), None) for second in range(6)],
        max_file_seconds=2.0,
    )
    assert len(recording.files) == 3
    for second in range(6):
        found = recording.file_at(START_NS + second * 10**9)
        assert found == recording.files[second // 2]
    assert recording.file_at(0) == recording.files[0]


def test_folders_of_recordings(tmp_path):
    for name in ('drive_10', 'drive_2', 'deep/drive_1'):
        write_texts(tmp_path / name, [(0.0, '/said', 'a', None)])
    # As a killed recorder leaves them, without metadata, and single files.
    (tmp_path / 'drive_2' / 'metadata.yaml').unlink()
    for name in ('loose_0.mcap', 'loose_1.mcap'):
        (tmp_path / 'drive_10' / 'drive_10_0.mcap').rename(tmp_path / name)
        write_texts(tmp_path / 'spare' / name, [(0.0, '/said', 'a', None)])
        (tmp_path / 'drive_10' / 'drive_10_0.mcap').write_bytes(
            (tmp_path / 'spare' / name / f'{name}_0.mcap').read_bytes()
        )
    (tmp_path / '.hidden').mkdir()
    (tmp_path / 'nothing').mkdir()
    found = [path.relative_to(tmp_path).as_posix() for path in recordings_in(tmp_path)]
    assert found == [
        'deep/drive_1', 'drive_2', 'drive_10', 'loose_0.mcap', 'loose_1.mcap',
        'spare/loose_0.mcap', 'spare/loose_1.mcap',
    ]  # fmt: skip
    assert list(recordings_in(tmp_path / 'drive_2')) == [tmp_path / 'drive_2']
