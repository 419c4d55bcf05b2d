# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""A short piece of a recording as a recording of its own."""

from __future__ import annotations

from collections import deque
from pathlib import Path

from occ_constraints_pkg.errors import DataError
from occ_constraints_pkg.rosbag.recording import RawMessage, Recording
from occ_constraints_pkg.rosbag.writer import BagWriter

# Whoever joins late needs them, and a clip begins late: of a topic, the last messages before.
_MOST_LATCHED = 100
# Where a recording does not tell the quality of service of its topics.
_LATCHED = ('/tf_static', '/robot_description', '/map')


def write_clip(
    recording: Recording, directory: str | Path, start_ns: int, end_ns: int
) -> tuple[Path, tuple[str, ...]]:
    """Write what was logged from one time to another, all topics, to a new rosbag2 directory.

    Of latched topics (transient local), what was logged before comes first, at ``start_ns``.

    Args:
        recording: where it is taken from.
        directory: it must not exist.
        start_ns: log time.
        end_ns: log time, inclusive.

    Returns:
        The MCAP file, and the topics that could not be copied: not in CDR, or with contradicting
        parts.

    Raises:
        OccError: the recording is damaged, or the directory exists or cannot be written.
    """
    topics = [
        name
        for name, info in recording.topics.items()
        if info.serialization == 'cdr' and not info.conflict
    ]
    before = {
        name: deque[RawMessage](maxlen=_MOST_LATCHED)
        for name in topics
        if _is_latched(recording, name)
    }
    with BagWriter(directory) as bag:

        def write(raw: RawMessage, time_ns: int) -> None:
            info = recording.topics[raw.topic]
            text = info.definition if info.definition_format == 'ros2msg' else ''
            bag.write(
                raw.topic, raw.msgtype, raw.data, time_ns, qos=info.offered_qos, definition=text
            )

        is_begun = False
        # Those that come too late are not even loaded.
        for raw in recording.messages(topics):
            if raw.log_time_ns > end_ns:
                break
            if raw.log_time_ns < start_ns:
                if raw.topic in before:
                    before[raw.topic].append(raw)
                continue
            if not is_begun:
                is_begun = True
                for own in before.values():
                    for latched in own:
                        write(latched, start_ns)
            write(raw, raw.log_time_ns)
        if not is_begun:
            raise DataError(
                f'{recording.path} has no message between {start_ns} and {end_ns} ns; allowed is '
                'a time within the recording'
            )
        path = bag.paths[0]
    return path, tuple(name for name in recording.topics if name not in topics)


def _is_latched(recording: Recording, topic: str) -> bool:
    profiles = recording.topics[topic].offered_qos
    if not profiles:
        return topic in _LATCHED
    return any(profile.get('durability') == 'transient_local' for profile in profiles)
