# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Writing of rosbag2 recordings that survive a killed recorder and a full disk."""

from __future__ import annotations

import os
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import reduce
from pathlib import Path
from typing import Any

from occ_constraints_pkg.errors import DataError
from occ_constraints_pkg.rosbag.definitions import find_definition
from occ_constraints_pkg.rosbag.mcap_writer import CHUNK_BYTES, COMPRESSIONS, McapOutput, Span
from occ_constraints_pkg.rosbag.metadata import dump_plain

FLUSH_SECONDS = 0.25
"""Seconds between flushes: half of what a killed recorder may lose, the rest is for delays."""
_METADATA_SECONDS = 5.0
# With thousands of topics metadata.yaml takes long to write: then at most a tenth of the time.
_METADATA_SHARE = 10.0


@dataclass(frozen=True)
class _Topic:
    """A topic as its first message showed it."""

    msgtype: str
    qos: list[dict[str, Any]]
    definition: str
    type_hash: str


class BagWriter:
    """Writes serialized messages into a new rosbag2 directory (MCAP, metadata version 9).

    The directory holds ``<directory name>_0.mcap``, further files numbered on where the recording
    is split, and ``metadata.yaml``. What has reached the operating system survives a SIGKILL of
    this process: everything up to the last :meth:`flush`, and every full chunk.
    :meth:`write` flushes by itself when the last flush is 0.25 s past; so at most the messages of
    the last 0.25 s are lost, or, when messages stop coming, those of the 0.25 s before the pause:
    a recorder that wants these safe too calls :meth:`flush` from a timer. A power failure may cost
    more, since nothing is synced to the disk. ``metadata.yaml`` is there from the start and is
    renewed with the flush that follows new topics, with each new file, and every 5 s; in a killed
    recording its message counts lag behind.

    When the disk is full, or a file cannot be written for another reason, the file is cut back
    to its last complete record and given an ending, so that what was recorded opens everywhere.

    Use it as a context manager, or call :meth:`close`.

    Args:
        directory: where to write; it must not exist, its parents may.
        compression: ``zstd``, ``lz4`` or ``none``, of the chunks within a file.
        max_file_bytes: a file that has grown to this size is followed by another; 0: never. As
            messages reach the file chunk by chunk, it may be larger by one chunk.
        max_file_seconds: the same for the time from a file's first message on, by log time.
        chunk_bytes: about how many bytes of messages are compressed together; where a killed
            recorder may lose more, larger chunks take less time.
        custom_data: what ``metadata.yaml`` says under that key, where rosbag2 has room for a
            recording's own words; None for nothing.

    Raises:
        OccError: the directory exists or cannot be made, or the compression is unknown.
    """

    def __init__(
        self,
        directory: str | Path,
        *,
        compression: str = 'zstd',
        max_file_bytes: int = 0,
        max_file_seconds: float = 0.0,
        chunk_bytes: int = CHUNK_BYTES,
        custom_data: Mapping[str, str] | None = None,
    ) -> None:
        check_compression(compression)
        self.directory = Path(directory)
        self._compression, self._chunk_bytes = compression, chunk_bytes
        self._max_bytes, self._max_ns = max_file_bytes, round(max_file_seconds * 1e9)
        self._custom_data = dict(custom_data) if custom_data else None
        self._topics: dict[str, _Topic] = {}
        self._files: list[McapOutput] = []
        self._flushed = self._described = -float('inf')
        # What metadata.yaml has been written for, and the seconds that took.
        self._topics_described, self._describing = 0, 0.0
        self._closed = False
        try:
            self.directory.mkdir(parents=True)
        except FileExistsError as error:
            raise DataError(
                f'{directory} exists already; allowed is a new directory for each recording'
            ) from error
        except OSError as error:
            raise DataError(f'cannot record to {directory}: {error.strerror}') from error
        try:
            self._begin_file()
        except OSError as error:
            self._fail(error)

    def __enter__(self) -> BagWriter:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def paths(self) -> tuple[Path, ...]:
        """The files so far."""
        return tuple(file.path for file in self._files)

    @property
    def message_count(self) -> int:
        """Number of messages written."""
        return sum(file.span.count for file in self._files)

    @property
    def size(self) -> int:
        """Bytes in the files so far."""
        return sum(file.size for file in self._files)

    def write(
        self,
        topic: str,
        msgtype: str,
        data: bytes,
        log_time_ns: int,
        publish_time_ns: int | None = None,
        qos: Sequence[Mapping[str, Any]] | None = None,
        definition: str = '',
    ) -> None:
        """Append one message.

        Args:
            topic: full topic name, with its leading slash.
            msgtype: for example ``nav_msgs/msg/Odometry``.
            data: the message in CDR, stored unchanged.
            log_time_ns: when it was received, nanoseconds.
            publish_time_ns: when it was published; None means ``log_time_ns``.
            qos: profiles of the topic's publishers, one each, spelled as in rosbag2 metadata 9
                (see :func:`~occ_constraints_pkg.rosbag.qos.from_profile`); what the topic's first
                message brings is recorded.
            definition: of the type with all its parts, in ``ros2msg`` form, where a recording
                brings its own; empty: as :func:`.find_definition` knows it.

        Raises:
            OccError: the recording is closed, the topic had another type before, a time is out
                of range, or the file cannot be written; in the last case it is closed and what
                is in it is intact.
        """
        if self._closed:
            raise DataError(f'{self.directory} is closed; nothing more can be recorded to it')
        publish = log_time_ns if publish_time_ns is None else publish_time_ns
        if not (0 <= log_time_ns < 2**63 and 0 <= publish < 2**63):
            raise DataError(
                f'a message on {topic!r} got the times {log_time_ns} and {publish} ns; '
                'allowed are 0 to 2^63 - 1'
            )
        known = self._topics.get(topic)
        if known is not None and known.msgtype != msgtype:
            raise DataError(
                f'topic {topic!r} got a {msgtype} after {known.msgtype}; '
                'allowed is one type for each topic'
            )
        try:
            if self._is_full(log_time_ns):
                self._files[-1].finish(self._information(self._files[-1:]))
                self._begin_file()
            file = self._files[-1]
            if not file.has_channel(topic):
                self._add_channel(
                    file, topic, known or self._add_topic(topic, msgtype, qos or (), definition)
                )
            file.add(topic, data, log_time_ns, publish)
            if time.monotonic() - self._flushed >= FLUSH_SECONDS:
                self._flush()
        except OSError as error:
            self._fail(error)

    def set_custom_data(self, custom_data: Mapping[str, str]) -> None:
        """Replace what metadata.yaml says under ``custom_data``, from its next writing on.

        It ends up in the storage files too, of which each has a record with what metadata.yaml
        says of it; so call it before the first file is full.
        """
        self._custom_data = dict(custom_data) or None

    def flush(self) -> None:
        """Hand all messages so far to the operating system.

        Raises:
            OccError: the file cannot be written.
        """
        if self._closed:
            return
        try:
            self._flush()
        except OSError as error:
            self._fail(error)

    def close(self) -> None:
        """Finish the file and its metadata; a second call does nothing.

        Raises:
            OccError: the file cannot be written.
        """
        if self._closed:
            return
        try:
            self._files[-1].finish(self._information(self._files[-1:]))
            self._write_metadata()
        except OSError as error:
            self._fail(error)
        self._closed = True

    def _is_full(self, log_time_ns: int) -> bool:
        file = self._files[-1]
        if not file.span.count:
            return False
        too_large = 0 < self._max_bytes <= file.size
        return too_large or 0 < self._max_ns <= log_time_ns - file.span.start_ns

    def _begin_file(self) -> None:
        name = f'{self.directory.resolve().name}_{len(self._files)}.mcap'
        self._files.append(McapOutput(self.directory / name, self._compression, self._chunk_bytes))
        self._files[-1].start()
        self._write_metadata()

    def _add_topic(
        self, topic: str, msgtype: str, qos: Sequence[Mapping[str, Any]], definition: str
    ) -> _Topic:
        # What hash another definition has is not known here.
        text, type_hash = (definition, '') if definition else find_definition(msgtype)
        self._topics[topic] = _Topic(msgtype, [dict(profile) for profile in qos], text, type_hash)
        return self._topics[topic]

    @staticmethod
    def _add_channel(file: McapOutput, name: str, topic: _Topic) -> None:
        # The same in every file and in metadata.yaml: rosbags passes over a topic of which they
        # tell different things.
        metadata = {
            'offered_qos_profiles': dump_plain(topic.qos) if topic.qos else '',
            'topic_type_hash': topic.type_hash,
        }
        file.add_channel(name, topic.msgtype, topic.definition, metadata)

    def _flush(self) -> None:
        self._files[-1].flush()
        self._flushed = time.monotonic()
        # Not with each new topic: they come by the hundred, and all of them are written each time.
        is_due = len(self._topics) != self._topics_described
        patience = _METADATA_SHARE * self._describing if is_due else _METADATA_SECONDS
        if self._flushed - self._described >= patience:
            self._write_metadata()

    def _fail(self, error: OSError) -> None:
        """End the file after its last complete record, close everything, and raise."""
        self._closed = True
        last = self._files[-1] if self._files else None
        if last is not None:
            last.end_early()
        with suppress(OSError):
            if last is not None and not last.span.count and len(self._files) > 1:
                last.path.unlink()
                self._files.pop()
            self._write_metadata()
        what = f'recording to {self.directory} ended: {error.strerror}; '
        if not all(os.path.lexists(path) for path in self.paths):
            raise DataError(
                f'{what}the directory or a file of it has been removed or renamed, and the '
                f'{self.message_count} messages before that went with it'
            ) from error
        raise DataError(f'{what}the {self.message_count} messages before that are kept') from error

    def _information(self, files: Sequence[McapOutput]) -> dict[str, Any]:
        """Return ``rosbag2_bagfile_information`` of files as rosbag2 writes it in version 9."""
        names = [file.path.name for file in files]
        return {
            'version': 9,
            'storage_identifier': 'mcap',
            **_span_entry(reduce(Span.joined, (file.span for file in files), Span())),
            'topics_with_message_count': [
                {
                    'topic_metadata': {
                        'name': name,
                        'type': topic.msgtype,
                        'serialization_format': 'cdr',
                        'offered_qos_profiles': topic.qos,
                        'type_description_hash': topic.type_hash,
                    },
                    'message_count': sum(file.counts[name] for file in files),
                }
                for name, topic in self._topics.items()
            ],
            'compression_format': '',
            'compression_mode': '',
            'relative_file_paths': names,
            'files': [{'path': file.path.name, **_span_entry(file.span)} for file in files],
            'custom_data': self._custom_data,
            'ros_distro': 'jazzy',
        }

    def _write_metadata(self) -> None:
        begin = time.monotonic()
        text = dump_plain({'rosbag2_bagfile_information': self._information(self._files)})
        target, fresh = self.directory / 'metadata.yaml', self.directory / 'metadata.yaml.new'
        try:
            fresh.write_text(text, encoding='utf-8')
            fresh.replace(target)
        except OSError:
            with suppress(OSError):
                fresh.unlink()
            if not self._closed or not _overwrite(target, text.encode()):
                raise
        self._described, self._topics_described = time.monotonic(), len(self._topics)
        self._describing = self._described - begin


def check_compression(name: str) -> None:
    """Refuse what is no compression of chunks.

    Raises:
        OccError: there is none of this name.
    """
    if name not in COMPRESSIONS:
        raise DataError(
            f'a recording got the compression {name!r}; allowed are {", ".join(COMPRESSIONS)}'
        )


def _overwrite(path: Path, data: bytes) -> bool:
    """Write into the blocks that a file has already, which a full disk allows, if they suffice."""
    if not path.exists() or len(data) > path.stat().st_blocks * 512:
        return False
    descriptor = os.open(path, os.O_WRONLY)
    try:
        os.pwrite(descriptor, data, 0)
        os.ftruncate(descriptor, len(data))
    finally:
        os.close(descriptor)
    return True


def _span_entry(span: Span) -> dict[str, Any]:
    return {
        'duration': {'nanoseconds': span.end_ns - span.start_ns if span.count else 0},
        'starting_time': {'nanoseconds_since_epoch': span.start_ns},
        'message_count': span.count,
    }
