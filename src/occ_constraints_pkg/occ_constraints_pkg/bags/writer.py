# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Writing of rosbag2 recordings that survive a killed recorder and a full disk."""

from __future__ import annotations

import os
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mcap.data_stream import RecordBuilder
from mcap.records import DataEnd, Footer
from mcap.writer import CompressionType, Writer

from occ_constraints_pkg.bags.definitions import find_definition
from occ_constraints_pkg.bags.mcap_file import MAGIC
from occ_constraints_pkg.documents import dump_yaml
from occ_constraints_pkg.errors import OccError

_COMPRESSIONS = {
    'zstd': CompressionType.ZSTD,
    'lz4': CompressionType.LZ4,
    'none': CompressionType.NONE,
}
_CHUNK_BYTES = 256 * 1024
_FLUSH_SECONDS = 0.5
_METADATA_SECONDS = 5.0
# What rosbag2 writes as the start of a bag without messages.
_NEVER_NS = 2**63 - 1


@dataclass
class _Topic:
    channel: int
    msgtype: str
    qos: list[dict[str, Any]]
    type_hash: str


class BagWriter:
    """Writes serialized messages into a new rosbag2 directory (MCAP, metadata version 9).

    The directory holds ``<directory name>_0.mcap`` and ``metadata.yaml``. What has reached the
    operating system survives a SIGKILL of this process: everything up to the last :meth:`flush`,
    and every full chunk of 256 KiB. :meth:`write` flushes by itself when the last flush is 0.5 s
    past, and after the first message of a topic; so at most the messages of the last 0.5 s are
    lost, or, when messages stop coming, those of the 0.5 s before the pause: a recorder that wants
    these safe too calls :meth:`flush` from a timer. A power failure may cost more, since nothing
    is synced to the disk. ``metadata.yaml`` is there from the start and is renewed with each new
    topic and every 5 s; in a killed recording its message counts lag behind.

    When the disk is full, or the file cannot be written for another reason, the file is cut back
    to its last complete record and given an ending, so that what was recorded opens everywhere.

    Use it as a context manager, or call :meth:`close`.

    Args:
        directory: where to write; it must not exist, its parents may.
        compression: ``zstd``, ``lz4`` or ``none``, of the chunks within the file.

    Raises:
        OccError: the directory exists or cannot be made, or the compression is unknown.
    """

    def __init__(self, directory: str | Path, *, compression: str = 'zstd') -> None:
        if compression not in _COMPRESSIONS:
            raise OccError(
                f'a recording got the compression {compression!r}; '
                f'allowed are {", ".join(_COMPRESSIONS)}'
            )
        self.directory = Path(directory)
        self.path = self.directory / f'{self.directory.resolve().name}_0.mcap'
        try:
            self.directory.mkdir(parents=True)
            self._sink = _Sink(self.path)
        except FileExistsError as error:
            raise OccError(
                f'{directory} exists already; allowed is a new directory for each recording'
            ) from error
        except OSError as error:
            raise OccError(f'cannot record to {directory}: {error.strerror}') from error
        self._topics: dict[str, _Topic] = {}
        self._schemas: dict[str, int] = {}
        self._counts: Counter[str] = Counter()
        self._times = (_NEVER_NS, 0)
        # Length, counts and times of the part of the file that is complete; see _fail.
        self._safe = (0, self._counts, self._times)
        self._flushed = self._described = -float('inf')
        self._closed = False
        self._writer = Writer(
            self._sink, chunk_size=_CHUNK_BYTES, compression=_COMPRESSIONS[compression]
        )
        try:
            self._writer.start(profile='ros2', library='occ_constraints')
            self._note_progress()
            self._write_metadata()
        except OSError as error:
            self._fail(error)

    def __enter__(self) -> BagWriter:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def message_count(self) -> int:
        """Number of messages written."""
        return self._counts.total()

    def write(
        self,
        topic: str,
        msgtype: str,
        data: bytes,
        log_time_ns: int,
        publish_time_ns: int | None = None,
        qos: Sequence[Mapping[str, Any]] | None = None,
    ) -> None:
        """Append one message.

        Args:
            topic: full topic name, with its leading slash.
            msgtype: for example ``nav_msgs/msg/Odometry``.
            data: the message in CDR, stored unchanged.
            log_time_ns: when it was received, nanoseconds.
            publish_time_ns: when it was published; None means ``log_time_ns``.
            qos: profiles of the topic's publishers, one each, spelled as in rosbag2 metadata 9
                (see :func:`~occ_constraints_pkg.bags.qos.from_profile`); what the topic's first
                message brings is recorded.

        Raises:
            OccError: the recording is closed, the topic had another type before, a time is out
                of range, or the file cannot be written; in the last case it is closed and what
                is in it is intact.
        """
        if self._closed:
            raise OccError(f'{self.directory} is closed; nothing more can be recorded to it')
        publish = log_time_ns if publish_time_ns is None else publish_time_ns
        if not (0 <= log_time_ns < 2**63 and 0 <= publish < 2**63):
            raise OccError(
                f'a message on {topic!r} got the times {log_time_ns} and {publish} ns; '
                'allowed are 0 to 2^63 - 1'
            )
        known = self._topics.get(topic)
        if known is not None and known.msgtype != msgtype:
            raise OccError(
                f'topic {topic!r} got a {msgtype} after {known.msgtype}; '
                'allowed is one type for each topic'
            )
        try:
            entry = known or self._add_topic(topic, msgtype, qos or ())
            self._writer.add_message(entry.channel, log_time_ns, data, publish)
            self._counts[topic] += 1
            self._times = min(self._times[0], log_time_ns), max(self._times[1], log_time_ns)
            self._note_progress()
            if known is None or time.monotonic() - self._flushed >= _FLUSH_SECONDS:
                self._flush(describe=known is None)
        except OSError as error:
            self._fail(error)

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
            self._writer.flush()
            self._note_progress()
            # rosbag2 looks here for what metadata.yaml says when it opens the bare file.
            self._writer.add_metadata(
                'rosbag2', {'serialized_metadata': dump_yaml(self._information())}
            )
            self._writer.finish()
            self._write_metadata()
        except OSError as error:
            self._fail(error)
        self._closed = True
        self._sink.close()

    def _add_topic(self, topic: str, msgtype: str, qos: Sequence[Mapping[str, Any]]) -> _Topic:
        text, type_hash = find_definition(msgtype)
        schema = self._schemas.get(msgtype)
        if schema is None:
            encoding = 'ros2msg' if text else ''
            schema = self._writer.register_schema(msgtype, encoding, text.encode())
            self._schemas[msgtype] = schema
        profiles = [dict(profile) for profile in qos]
        channel = self._writer.register_channel(
            topic,
            'cdr',
            schema,
            {
                'offered_qos_profiles': dump_yaml(profiles) if profiles else '',
                'topic_type_hash': type_hash,
            },
        )
        self._topics[topic] = _Topic(channel, msgtype, profiles, type_hash)
        return self._topics[topic]

    def _flush(self, *, describe: bool = False) -> None:
        self._writer.flush()
        self._note_progress()
        self._flushed = time.monotonic()
        if describe or self._flushed - self._described >= _METADATA_SECONDS:
            self._write_metadata()

    def _note_progress(self) -> None:
        # The sink holds nothing back, so whenever it has grown and no error was raised, its file
        # ends with a complete record, and the writer has no message left in memory.
        if self._sink.position != self._safe[0]:
            self._safe = self._sink.position, self._counts.copy(), self._times

    def _fail(self, error: OSError) -> None:
        """Give the file an ending after its last complete record, close it, and raise."""
        self._closed = True
        size, self._counts, self._times = self._safe
        builder = RecordBuilder()
        DataEnd(0).write(builder)
        Footer(summary_start=0, summary_offset_start=0, summary_crc=0).write(builder)
        # Fifty bytes nearly always fit in the disk block that cutting has freed; where they do
        # not, the file is one that a killed recorder might have left.
        with suppress(OSError):
            self._sink.cut(size)
            self._sink.write(builder.end() + MAGIC)
        with suppress(OSError):
            self._sink.close()
        with suppress(OSError):
            self._write_metadata()
        raise OccError(
            f'recording to {self.directory} ended: {error.strerror}; '
            f'the {self._counts.total()} messages before that are kept'
        ) from error

    def _information(self) -> dict[str, Any]:
        """Return ``rosbag2_bagfile_information`` as rosbag2 writes it in version 9."""
        start, end = self._times
        count = self._counts.total()
        span = {
            'duration': {'nanoseconds': end - start if count else 0},
            'starting_time': {'nanoseconds_since_epoch': start},
            'message_count': count,
        }
        return {
            'version': 9,
            'storage_identifier': 'mcap',
            **span,
            'topics_with_message_count': [
                {
                    'topic_metadata': {
                        'name': name,
                        'type': topic.msgtype,
                        'serialization_format': 'cdr',
                        'offered_qos_profiles': topic.qos,
                        'type_description_hash': topic.type_hash,
                    },
                    'message_count': self._counts[name],
                }
                for name, topic in self._topics.items()
            ],
            'compression_format': '',
            'compression_mode': '',
            'relative_file_paths': [self.path.name],
            'files': [{'path': self.path.name, **span}],
            'custom_data': None,
            'ros_distro': 'jazzy',
        }

    def _write_metadata(self) -> None:
        target = self.directory / 'metadata.yaml'
        fresh = self.directory / 'metadata.yaml.new'
        text = dump_yaml({'rosbag2_bagfile_information': self._information()})
        try:
            fresh.write_text(text, encoding='utf-8')
            fresh.replace(target)
        except OSError:
            with suppress(OSError):
                fresh.unlink()
            raise
        self._described = time.monotonic()


class _Sink:
    """A file for the MCAP writer that keeps no bytes back in this process."""

    def __init__(self, path: Path) -> None:
        self._descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o666)
        self.position = 0

    def write(self, data: bytes) -> int:
        rest = memoryview(data)
        while rest:
            written = os.write(self._descriptor, rest)
            self.position += written
            rest = rest[written:]
        return len(data)

    def tell(self) -> int:
        return self.position

    def flush(self) -> None:
        """Do nothing: all has been written."""

    def cut(self, size: int) -> None:
        os.ftruncate(self._descriptor, size)
        os.lseek(self._descriptor, size, os.SEEK_SET)
        self.position = size

    def close(self) -> None:
        os.close(self._descriptor)
