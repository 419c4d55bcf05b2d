# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""One MCAP file while it is written, always fit to be ended after its last complete record."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mcap.data_stream import RecordBuilder
from mcap.records import DataEnd, Footer
from mcap.writer import CompressionType, Writer

from occ_constraints_pkg.rosbag.mcap_file import MAGIC
from occ_constraints_pkg.rosbag.metadata import dump_plain

COMPRESSIONS = {
    'zstd': CompressionType.ZSTD,
    'lz4': CompressionType.LZ4,
    'none': CompressionType.NONE,
}
"""How the chunks within a file may be compressed."""

CHUNK_BYTES = 256 * 1024
"""What is held back at the most until it is compressed and written."""
# What rosbag2 writes as the start of a bag without messages.
_NEVER_NS = 2**63 - 1


@dataclass(frozen=True)
class Span:
    """Number of messages, and log times of the first and the last in ns."""

    count: int = 0
    start_ns: int = _NEVER_NS
    end_ns: int = 0

    def joined(self, other: Span) -> Span:
        """Return the span over both."""
        return Span(
            self.count + other.count,
            min(self.start_ns, other.start_ns),
            max(self.end_ns, other.end_ns),
        )


class McapOutput:
    """Writes one MCAP file of the profile ``ros2``.

    Errors of the operating system are passed on as they are; :meth:`end_early` is what to do then.

    Attributes:
        path: the file; it must not exist before.
        counts: number of messages by topic.

    Args:
        path: the file.
        compression: a key of :data:`COMPRESSIONS`.
        chunk_bytes: about how many bytes of messages make a chunk.
    """

    def __init__(self, path: Path, compression: str, chunk_bytes: int = CHUNK_BYTES) -> None:
        self.path = path
        self.counts: Counter[str] = Counter()
        self._count, self._start_ns, self._end_ns = 0, _NEVER_NS, 0
        self._sink = _Sink(path)
        self._channels: dict[str, int] = {}
        self._schemas: dict[str, int] = {}
        # Length, counts and span of the part of the file that is complete.
        self._safe = (0, self.counts, Span())
        self._ended = False
        self._writer = Writer(
            self._sink, chunk_size=chunk_bytes, compression=COMPRESSIONS[compression]
        )

    @property
    def span(self) -> Span:
        """Number of messages and their log times."""
        return Span(self._count, self._start_ns, self._end_ns)

    @property
    def size(self) -> int:
        """Bytes in the file, without what is still to be flushed."""
        return self._sink.position

    def start(self) -> None:
        """Write the beginning."""
        self._writer.start(profile='ros2', library='occ_constraints')
        self._note_progress()

    def has_channel(self, topic: str) -> bool:
        """Tell whether messages of a topic can be added."""
        return topic in self._channels

    def add_channel(
        self, topic: str, msgtype: str, definition: str, metadata: Mapping[str, str]
    ) -> None:
        """Make a topic known; ``definition`` is in the form ``ros2msg``, or empty."""
        schema = self._schemas.get(msgtype)
        if schema is None:
            encoding = 'ros2msg' if definition else ''
            schema = self._writer.register_schema(msgtype, encoding, definition.encode())
            self._schemas[msgtype] = schema
        self._channels[topic] = self._writer.register_channel(topic, 'cdr', schema, dict(metadata))

    def add(self, topic: str, data: bytes, log_time_ns: int, publish_time_ns: int) -> None:
        """Append one message."""
        self._writer.add_message(self._channels[topic], log_time_ns, data, publish_time_ns)
        self.counts[topic] += 1
        # Plain numbers: this is done for each message.
        self._count += 1
        if log_time_ns < self._start_ns:
            self._start_ns = log_time_ns
        if log_time_ns > self._end_ns:
            self._end_ns = log_time_ns
        self._note_progress()

    def flush(self) -> None:
        """Hand all messages so far to the operating system."""
        self._writer.flush()
        self._note_progress()

    def finish(self, information: Mapping[str, Any]) -> None:
        """End the file properly and close it.

        Args:
            information: what metadata.yaml says of this file, where rosbag2 looks for it when it
                opens the file alone.
        """
        self.flush()
        self._writer.add_metadata('rosbag2', {'serialized_metadata': dump_plain(information)})
        self._writer.finish()
        self._ended = True
        self._sink.close()

    def end_early(self) -> None:
        """Cut the file back to its last complete record, give it an ending, and close it.

        Nothing is done to a file that was finished.
        """
        if self._ended:
            return
        self._ended = True
        size, self.counts, span = self._safe
        self._count, self._start_ns, self._end_ns = span.count, span.start_ns, span.end_ns
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

    def _note_progress(self) -> None:
        # The sink holds nothing back, so whenever it has grown and no error was raised, its file
        # ends with a complete record, and the writer has no message left in memory.
        if self._sink.position != self._safe[0]:
            self._safe = self._sink.position, self.counts.copy(), self.span


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
