# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Reading of recordings: rosbag2 directories and bare MCAP or SQLite files."""

from __future__ import annotations

import hashlib
import heapq
import re
from collections.abc import Collection, Iterator
from contextlib import ExitStack
from dataclasses import dataclass, replace
from functools import cache, cached_property
from pathlib import Path, PurePosixPath
from typing import Any

from rosbags.interfaces import MessageDefinitionFormat
from rosbags.rosbag2 import Reader, ReaderError
from rosbags.typesys import (
    Stores,
    TypesysError,
    get_types_from_idl,
    get_types_from_msg,
    get_typestore,
)
from ruamel.yaml import YAML
from ruamel.yaml.error import YAMLError

from occ_constraints_pkg.bags.mcap_file import McapIndex, index_mcap, load_segment
from occ_constraints_pkg.bags.qos import parse_profiles
from occ_constraints_pkg.documents import did_you_mean
from occ_constraints_pkg.errors import OccError

_SUFFIXES = ('.mcap', '.db3')


@dataclass(frozen=True)
class TopicInfo:
    """What a recording knows about a topic.

    Attributes:
        msgtype: for example ``nav_msgs/msg/Odometry``.
        count: number of messages.
        serialization: ``cdr``, or what else the messages are encoded in.
        definition: text of the message definition as stored; empty when the bag has none.
        definition_format: ``ros2msg``, ``ros2idl`` or empty.
        offered_qos: profiles of the recorded publishers, spelled as in rosbag2 metadata 9.
    """

    msgtype: str
    count: int
    serialization: str = 'cdr'
    definition: str = ''
    definition_format: str = ''
    offered_qos: tuple[dict[str, Any], ...] = ()


@dataclass(frozen=True)
class RawMessage:
    """One recorded message, still serialized.

    Attributes:
        topic: name as recorded, with its leading slash.
        msgtype: message type.
        log_time_ns: when the recorder received it.
        data: the serialized bytes.
    """

    topic: str
    msgtype: str
    log_time_ns: int
    data: bytes


class Recording:
    """A recording that has been looked through but not read; nothing stays open.

    MCAP files are read here, including files without a footer that a killed recorder left behind;
    SQLite files and file- or message-wise compressed bags are read through ``rosbags``.

    Attributes:
        path: the directory or file.
        name: its last path component without ``.mcap`` or ``.db3``.
        files: the storage files, in order.
        topics: topic name to :class:`TopicInfo`, sorted by name.
        warnings: one sentence for each thing that is missing or damaged.

    Raises:
        OccError: there is no such path, it is not a recording, or it holds no message.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        self.name = self.path.stem if self.path.suffix in _SUFFIXES else self.path.name
        self.warnings: tuple[str, ...] = ()
        self._stores: dict[str, Any] = {}
        metadata = self._find_files()
        mode = str(metadata.get('compression_mode') or 'none').lower()
        self._compressed = mode != 'none'
        self._indexes: tuple[McapIndex, ...] = ()
        if not self._compressed and all(file.suffix == '.mcap' for file in self.files):
            self._indexes = tuple(index_mcap(file) for file in self.files)
            self.warnings += tuple(index.warning for index in self._indexes if index.warning)
            topics = self._mcap_topics()
        else:
            topics = self._rosbags_topics()
        self.topics = dict(sorted(_with_metadata(topics, metadata).items()))
        if not self.message_count:
            raise OccError(f'{self.path} holds no messages; allowed is a recording with some')

    @property
    def message_count(self) -> int:
        """Number of messages that can be read."""
        return sum(info.count for info in self.topics.values())

    def find(self, name: str) -> str:
        """Return the recorded name of a topic that is given with or without leading slash.

        Raises:
            OccError: there is no such topic; the sentence lists those that are there.
        """
        for topic in self.topics:
            if topic.strip('/') == name.strip('/'):
                return topic
        hint = did_you_mean(f'/{name.strip("/")}', self.topics) or ';'
        raise OccError(
            f'{self.path} has no topic {name!r}{hint} its topics are {", ".join(self.topics)}'
        )

    def messages(self, topics: Collection[str] | None = None) -> Iterator[RawMessage]:
        """Yield messages in the order in which they were logged; equal times in file order.

        Memory holds one chunk at a time, or as many as overlap in time.

        Args:
            topics: names as in :attr:`topics`, or without slash; None means all.

        Raises:
            OccError: there is no such topic, or the recording is damaged.
        """
        wanted = set(self.topics) if topics is None else {self.find(name) for name in topics}
        return self._mcap_messages(wanted) if self._indexes else self._rosbags_messages(wanted)

    def decode(self, raw: RawMessage) -> Any:
        """Return the message object, built by ``rosbags`` from the definition in the bag.

        A type without a definition in the bag is read as the type of that name in ROS 2 Jazzy.

        Raises:
            OccError: the type is unknown, or the bytes are not such a message.
        """
        info = self.topics[raw.topic]
        if info.serialization != 'cdr':
            raise OccError(
                f'{self.path} has topic {raw.topic!r} serialized as {info.serialization!r}; '
                "allowed is 'cdr'"
            )
        store = self._stores.get(raw.msgtype) or self._make_store(raw.topic, info)
        try:
            return store.deserialize_cdr(raw.data, raw.msgtype)
        # The generated code fails on wrong bytes in whichever way comes first.
        except Exception as error:
            raise OccError(
                f'{self.path} has a message on {raw.topic!r} at {raw.log_time_ns} ns whose '
                f'{len(raw.data)} bytes are not a {raw.msgtype}'
            ) from error

    def fingerprint(self) -> dict[str, Any]:
        """Return ``name``, ``sha256`` over the storage files in order, and ``messages``."""
        return {'name': self.name, 'sha256': self._sha256, 'messages': self.message_count}

    @cached_property
    def _sha256(self) -> str:
        digest = hashlib.sha256()
        for file in self.files:
            with file.open('rb') as stream:
                while block := stream.read(1 << 20):
                    digest.update(block)
        return digest.hexdigest()

    def _find_files(self) -> dict[str, Any]:
        """Set :attr:`files`; return what metadata.yaml says, empty where there is none."""
        path = self.path
        if not path.exists():
            raise OccError(f'there is no recording at {path}')
        if not path.is_dir():
            if path.suffix not in _SUFFIXES:
                raise OccError(
                    f'{path} is not a recording; allowed are rosbag2 directories and files that '
                    f'end in {" or ".join(_SUFFIXES)}'
                )
            self.files = (path,)
            return {}
        metadata = _read_metadata(path / 'metadata.yaml')
        # Before version 4 the listed paths began with the directory's own name.
        names = [PurePosixPath(name).name for name in metadata.get('relative_file_paths') or ()]
        if not names:
            found = (file for file in path.iterdir() if file.suffix in _SUFFIXES)
            names = sorted((file.name for file in found), key=_natural)
            if not names:
                raise OccError(
                    f'{path} is not a recording: it holds neither a metadata.yaml that lists files '
                    f'nor files that end in {" or ".join(_SUFFIXES)}'
                )
        self.files = tuple(path / name for name in names)
        missing = [file.name for file in self.files if not file.is_file()]
        if missing:
            raise OccError(f'{path} lacks {", ".join(missing)}, which its metadata.yaml lists')
        return metadata

    def _mcap_topics(self) -> dict[str, TopicInfo]:
        topics: dict[str, TopicInfo] = {}
        for index in self._indexes:
            for key, channel in index.channels.items():
                schema = index.schemas.get(channel.schema_id)
                info = topics.get(channel.topic)
                if info is None:
                    info = TopicInfo(
                        schema.name if schema else '',
                        0,
                        channel.message_encoding,
                        schema.data.decode('utf-8', 'replace') if schema else '',
                        schema.encoding if schema else '',
                        parse_profiles(channel.metadata.get('offered_qos_profiles')),
                    )
                elif schema and schema.name != info.msgtype:
                    raise OccError(
                        f'{index.path} has topic {channel.topic!r} both as {info.msgtype} and as '
                        f'{schema.name}; allowed is one type for each topic'
                    )
                topics[channel.topic] = replace(info, count=info.count + index.counts[key])
        return topics

    def _mcap_messages(self, wanted: set[str]) -> Iterator[RawMessage]:
        makers = [
            {
                key: (channel.topic, self.topics[channel.topic].msgtype)
                for key, channel in index.channels.items()
                if channel.topic in wanted
            }
            for index in self._indexes
        ]
        with ExitStack() as stack:
            files = [stack.enter_context(index.path.open('rb')) for index in self._indexes]
            waiting = [
                (segment.start_ns, number, place, segment)
                for number, index in enumerate(self._indexes)
                for place, segment in enumerate(index.segments)
            ]
            waiting.sort(reverse=True, key=lambda entry: entry[:3])
            for time, number, key, data in _merge(waiting, self._indexes, files, makers):
                topic, msgtype = makers[number][key]
                yield RawMessage(topic, msgtype, time, data)

    def _rosbags_readers(self, stack: ExitStack) -> list[Reader]:
        # A directory is opened as such only to be decompressed: the reader of rosbags passes over
        # all messages of a topic whose QoS differs between metadata.yaml and the storage file.
        paths = (self.path,) if self._compressed else self.files
        try:
            return [stack.enter_context(Reader(path)) for path in paths]
        # rosbags lets errors of the storage library and of the operating system through.
        except Exception as error:
            raise OccError(f'{self.path} cannot be read: {str(error).rstrip(".")}') from error

    def _rosbags_topics(self) -> dict[str, TopicInfo]:
        formats = {MessageDefinitionFormat.MSG: 'ros2msg', MessageDefinitionFormat.IDL: 'ros2idl'}
        topics: dict[str, TopicInfo] = {}
        with ExitStack() as stack:
            for reader in self._rosbags_readers(stack):
                for connection in reader.connections:
                    info = topics.get(connection.topic) or TopicInfo(
                        connection.msgtype,
                        0,
                        connection.ext.serialization_format,
                        connection.msgdef.data,
                        formats.get(connection.msgdef.format, ''),
                    )
                    topics[connection.topic] = replace(info, count=info.count + connection.msgcount)
        return topics

    def _rosbags_messages(self, wanted: set[str]) -> Iterator[RawMessage]:
        with ExitStack() as stack:
            sources = []
            for reader in self._rosbags_readers(stack):
                connections = [item for item in reader.connections if item.topic in wanted]
                if connections:
                    sources.append(reader.messages(connections))
            count = 0
            try:
                for connection, time, data in heapq.merge(*sources, key=lambda entry: entry[1]):
                    count += 1
                    yield RawMessage(connection.topic, connection.msgtype, time, bytes(data))
            except ReaderError as error:
                raise OccError(f'{self.path} is damaged: {error}') from error
        promised = sum(self.topics[topic].count for topic in wanted)
        if count != promised:
            raise OccError(f'{self.path} is damaged: it has {count} messages instead of {promised}')

    def _make_store(self, topic: str, info: TopicInfo) -> Any:
        """Return a typestore that knows the topic's type.

        Each type of a bag gets a store of its own: bags join topics whose definitions of a shared
        part differ, and a common store would refuse the second.
        """
        try:
            types = _parse_definition(info)
            if types:
                store = get_typestore(Stores.EMPTY)
                store.register(types)
            else:
                store = _jazzy()
            store.get_msgdef(info.msgtype)
        # The generated code of a definition that lacks a part fails on a plain lookup.
        except (TypesysError, KeyError, ValueError, SyntaxError) as error:
            raise OccError(
                f'{self.path} has topic {topic!r} of type {info.msgtype!r}, whose definition is '
                'neither complete in the bag nor part of ROS 2 Jazzy'
            ) from error
        self._stores[info.msgtype] = store
        return store


def _merge(waiting: list, indexes: tuple, files: list, makers: list) -> Iterator[tuple]:
    """Yield ``(time, file number, channel, data)`` in order from segments sorted latest first."""
    heap: list[tuple] = []
    while waiting or heap:
        while waiting and (not heap or waiting[-1][0] <= heap[0][0]):
            _, number, place, segment = waiting.pop()
            channels = makers[number]
            messages = iter(
                [
                    message
                    for message in load_segment(indexes[number], files[number], segment)
                    if message[1] in channels
                ]
            )
            first = next(messages, None)
            if first is not None:
                heapq.heappush(heap, (first[0], number, place, first, messages))
        if not heap:
            continue
        _, number, place, (time, key, data), messages = heap[0]
        yield time, number, key, data
        following = next(messages, None)
        if following is None:
            heapq.heappop(heap)
        else:
            heapq.heapreplace(heap, (following[0], number, place, following, messages))


def _with_metadata(topics: dict[str, TopicInfo], metadata: dict[str, Any]) -> dict[str, TopicInfo]:
    """Complete topics with the QoS and the serialization that only metadata.yaml may tell."""
    result = dict(topics)
    for entry in metadata.get('topics_with_message_count') or ():
        told = entry.get('topic_metadata') or {}
        info = result.get(told.get('name'))
        if info is None:
            continue
        qos = info.offered_qos or parse_profiles(told.get('offered_qos_profiles'))
        serialization = told.get('serialization_format') or info.serialization
        result[told['name']] = replace(info, offered_qos=qos, serialization=serialization)
    return result


def _read_metadata(path: Path) -> dict[str, Any]:
    if not path.exists():
        return {}
    try:
        metadata = YAML(typ='safe', pure=True).load(path.read_text(encoding='utf-8'))
        metadata = metadata['rosbag2_bagfile_information']
        if not isinstance(metadata, dict):
            raise TypeError('not a mapping')
    except (OSError, YAMLError, KeyError, TypeError, ValueError) as error:
        raise OccError(f'{path} is not the metadata of a rosbag2 recording') from error
    version = metadata.get('version')
    if not isinstance(version, int) or version > 9:
        raise OccError(f'{path} has version {version!r}; allowed are 1 to 9')
    return metadata


def _parse_definition(info: TopicInfo) -> dict[str, Any]:
    if not info.definition.strip():
        return {}
    if info.definition_format == 'ros2msg':
        return get_types_from_msg(info.definition, info.msgtype)
    types: dict[str, Any] = {}
    for part in re.split(r'^={80}\n(?:IDL: .*\n)?', info.definition, flags=re.MULTILINE):
        if part.strip():
            types.update(get_types_from_idl(part))
    return types


def _natural(name: str) -> list[Any]:
    """Sort key that puts ``bag_10`` after ``bag_9``."""
    return [int(part) if part.isdigit() else part for part in re.split(r'(\d+)', name)]


@cache
def _jazzy() -> Any:
    return get_typestore(Stores.ROS2_JAZZY)
