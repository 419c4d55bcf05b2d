# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Reading of recordings: rosbag2 directories and bare MCAP or SQLite files."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import chain, islice
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np

from occ_constraints_pkg.documents import did_you_mean
from occ_constraints_pkg.errors import DataError, OccError
from occ_constraints_pkg.files import sha256_of
from occ_constraints_pkg.rosbag.cdr_errors import wrong_bytes
from occ_constraints_pkg.rosbag.file_names import (
    SPLIT,
    SUFFIXES,
    bare_name,
    is_storage,
    natural_order,
    storage_suffix,
)
from occ_constraints_pkg.rosbag.mcap_file import McapFile
from occ_constraints_pkg.rosbag.metadata import (
    is_compressed_by_message,
    read_metadata,
    with_metadata,
)
from occ_constraints_pkg.rosbag.sqlite_file import MAGIC as SQLITE_MAGIC
from occ_constraints_pkg.rosbag.sqlite_file import SqliteFile
from occ_constraints_pkg.rosbag.stamped import stamped_of, with_header
from occ_constraints_pkg.rosbag.storage import (
    MAX_PIECE_BYTES,
    ZSTD_SUFFIXES,
    Block,
    Segment,
    StorageFile,
    TopicInfo,
    Unpacked,
    in_log_order,
    unpack_zstd,
)
from occ_constraints_pkg.rosbag.typestores import (
    UndefinedTypeError,
    find_definitions,
    find_typestore,
    possible_definitions,
)
from occ_constraints_pkg.wording import count_of

# The first two bytes of a message in plain CDR, big- and little-endian.
_CDR = (b'\0\0', b'\0\1')
# Messages that decide by which of several definitions a topic is read.
_EXAMPLES = 20
# Types as ROS 2 named them before its release Dashing, without the part 'msg'.
_FIRST_NAMES = re.compile(r'^(\w+)/(\w+)$')


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

    Files without a footer, which a killed recorder left behind, and truncated files are
    used up to the last complete message. Nothing is ever written beside the recording; files that
    are compressed as a whole are unpacked to a temporary folder, which goes with this object.

    Attributes:
        path: the directory or file.
        name: its last path component without the endings of storage files.
        files: the storage files, in order.
        topics: topic name to :class:`TopicInfo`, sorted by name.

    Raises:
        OccError: there is no such path, it is not a recording, or it holds no message.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        self._warnings: list[str] = []
        # Topic to how many of its messages have no bytes.
        self._empty: Counter[str] = Counter()
        self._stores: dict[str, Any] = {}
        self._definitions: dict[str, tuple[str, str, str, str]] = {}
        self._unpacked = Unpacked()
        try:
            self.name = self.path.name if self.path.is_dir() else bare_name(self.path)
            metadata = self._find_files()
        # A name may be too long, the path's or one that metadata.yaml lists.
        except OSError as error:
            where = error.filename or self.path
            raise DataError(f'cannot read {where}: {error.strerror}') from error
        self._message_zstd = is_compressed_by_message(metadata, self.path)
        self._storages = tuple(self._open(file) for file in self.files)
        self.topics = dict(sorted(with_metadata(self._all_topics(), metadata).items()))
        if not self.message_count:
            raise DataError(f'{self.path} holds no messages')
        stated = metadata.get('message_count')
        if isinstance(stated, int) and stated > self.message_count:
            self._warnings.append(
                f'{self.path} holds {self.message_count} messages, but its metadata.yaml '
                f'states {stated}'
            )

    @property
    def warnings(self) -> tuple[str, ...]:
        """One sentence for each thing that is missing or damaged, as far as has been read."""
        empty = (
            f'{self.path} has {count_of(count, "message")} without any bytes on {topic!r}, which '
            f'{"is" if count == 1 else "are"} left out'
            for topic, count in sorted(self._empty.items())
        )
        return (*self._warnings, *empty)

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
        raise DataError(
            f'{self.path} has no topic {name!r}{hint} its topics are {", ".join(self.topics)}'
        )

    @cached_property
    def start_ns(self) -> int:
        """Log time of the first message."""
        return min(segment.start_ns for storage in self._storages for segment in storage.segments)

    def file_at(self, time_ns: int) -> Path:
        """Return the storage file that holds what was logged at a time, or last before."""
        starts = [
            (min(segment.start_ns for segment in storage.segments), place)
            for place, storage in enumerate(self._storages)
            if storage.segments
        ]
        earlier = [item for item in starts if item[0] <= time_ns]
        return self.files[max(earlier)[1] if earlier else min(starts)[1]]

    def messages(self, topics: Collection[str] | None = None) -> Iterator[RawMessage]:
        """Yield messages in the order in which they were logged; equal times in file order.

        Memory holds one chunk at a time, or as many as overlap in time.

        Args:
            topics: names as in :attr:`topics`, or without slash; None means all.

        Raises:
            OccError: there is no such topic, or the recording is damaged.
        """
        names = list(self.topics) if topics is None else [self.find(name) for name in topics]
        return self._each_message(names)

    def _each_message(self, names: list[str]) -> Iterator[RawMessage]:
        kinds = [(name, self.topics[name].msgtype) for name in names]
        for block in self.blocks(names):
            data = block.data
            columns = (block.topics, block.times, block.starts, block.ends)
            for place, time, start, end in zip(*(item.tolist() for item in columns), strict=True):
                yield RawMessage(*kinds[place], time, bytes(data[start:end]))

    def blocks(self, topics: list[str]) -> Iterator[Block]:
        """Yield what :meth:`messages` does, many messages at a time.

        Args:
            topics: names as in :attr:`topics`; ``Block.topics`` are places in this list.

        Raises:
            OccError: the recording is damaged.
        """
        places = {name: place for place, name in enumerate(topics)}
        for name in topics:
            if self.topics[name].conflict:
                raise DataError(self.topics[name].conflict)
        pieces, empty = [], Counter[int]()
        for number, storage in enumerate(self._storages):
            wanted = {
                channel: places[name]
                for channel, (name, _) in sorted(storage.topics.items())
                if name in places
            }
            for place, segment in enumerate(storage.segments):
                if segment.channels is None or segment.channels & wanted.keys():
                    load = partial(self._load, storage, segment, wanted, empty)
                    pieces.append((segment.start_ns, number, place, load))
        pieces.sort(key=lambda piece: piece[:3])
        counts: Counter[int] = Counter()
        for block in in_log_order((start, load) for start, _, _, load in pieces):
            counts.update(dict(enumerate(np.bincount(block.topics).tolist())))
            yield block
        for name, place in places.items():
            if counts[place] + empty[place] != self.topics[name].count:
                raise DataError(
                    f'{self.path} is damaged: it has {counts[place]} messages on {name!r} instead '
                    f'of {self.topics[name].count}'
                )
            if empty[place]:
                self._empty[name] = empty[place]

    def _load(
        self,
        storage: StorageFile,
        segment: Segment,
        wanted: dict[int, int],
        empty: Counter[int],
    ) -> Block:
        """Load what is wanted of a segment; ``empty`` counts messages without bytes, by topic."""
        block = storage.load(segment)
        channels = np.array(list(wanted), dtype=np.int64)
        at = np.minimum(np.searchsorted(channels, block.topics), len(channels) - 1)
        is_wanted = channels[at] == block.topics
        if not is_wanted.all():
            block, at = block.select(is_wanted), at[is_wanted]
        block = replace(block, topics=np.array(list(wanted.values()), dtype=np.intp)[at])
        has_bytes = block.ends > block.starts
        if not has_bytes.all():
            empty.update(block.topics[~has_bytes].tolist())
            block = block.select(has_bytes)
        unstamped = [
            channel
            for channel in wanted
            if f'{_msgtype(storage, channel)}Stamped'
            == self.topics[storage.topics[channel][0]].msgtype
        ]
        is_plain = np.isin(channels[at][has_bytes], unstamped) if unstamped else None
        if self._message_zstd:
            try:
                block = block.mapped(_unpack_message)
            except ValueError as error:
                raise DataError(
                    f'{storage.path} is damaged: a compressed message cannot be read ({error})'
                ) from error
        if is_plain is not None and is_plain.any():
            plain = iter(is_plain.tolist())
            block = block.mapped(lambda data: with_header(data) if next(plain) else data)
        return block

    def raw(self, block: Block, row: int, topic: str) -> RawMessage:
        """Return one message of a block.

        Args:
            block: what :meth:`blocks` yielded.
            row: the message's number in it.
            topic: the name of its topic.
        """
        msgtype = self.topics[topic].msgtype
        return RawMessage(topic, msgtype, int(block.times[row]), block.message(row))

    def decode(self, raw: RawMessage) -> Any:
        """Return the message object, built by ``rosbags`` from the definition in the bag.

        A type without a definition in the bag is read as the type of that name in ROS 2 Jazzy.

        Raises:
            OccError: the type is unknown, or the bytes are not such a message.
        """
        store = self._store(raw.topic)
        try:
            # The generated code looks at the order of bytes only.
            if raw.data[:2] not in _CDR:
                raise ValueError('another encoding')
            return store.deserialize_cdr(raw.data, raw.msgtype)
        # The generated code fails on wrong bytes in whichever way comes first.
        except Exception as error:
            raise DataError(
                f'{self.path} has a message on {raw.topic!r} at {raw.log_time_ns} ns '
                f'{wrong_bytes(raw.data, raw.msgtype)}'
            ) from error

    def fields(self, topic: str) -> Mapping[str, Any]:
        """Return the parsed definitions of a topic's type and its parts, by type name.

        Raises:
            OccError: the topic is not in CDR, has two types, or its type is unknown or has a
                definition that cannot be read.
        """
        try:
            return find_definitions(*self._definition(topic))
        except UndefinedTypeError as error:
            raise self._undefined(topic, error.reason) from error

    def problem(self, topic: str) -> str:
        """Return why the messages of a topic cannot be read, in one sentence; empty if they can.

        Args:
            topic: as in :attr:`topics`.
        """
        try:
            self._store(topic)
            raw = next(self.messages([topic]), None)
            if raw is not None:
                self.decode(raw)
        except OccError as error:
            return str(error)
        return ''

    def _definition(self, topic: str) -> tuple[str, str, str, str]:
        """Return the definition by which the messages of a topic can be read."""
        info = self.topics[topic]
        if info.conflict:
            raise DataError(info.conflict)
        if info.serialization != 'cdr':
            raise DataError(
                f'{self.path} has topic {topic!r} serialized as {info.serialization!r}; '
                "allowed is 'cdr'"
            )
        if topic not in self._definitions:
            possible = possible_definitions(*_definition(info))
            self._definitions[topic] = first = next(possible)
            if first[0].strip() and 'wstring' not in first[0]:
                return first
            # The bag does not say all, so its messages have to.
            examples = list(islice(self._each_message([topic]), _EXAMPLES))
            for candidate in chain([first], possible):
                if _reads(candidate, examples):
                    self._definitions[topic] = candidate
                    break
        return self._definitions[topic]

    def fingerprint(self) -> dict[str, Any]:
        """Return ``name``, ``sha256`` over the storage files in order, and ``messages``."""
        return {'name': self.name, 'sha256': self._sha256, 'messages': self.message_count}

    @cached_property
    def _sha256(self) -> str:
        return sha256_of(self.files)

    def _find_files(self) -> dict[str, Any]:
        """Set :attr:`files`; return what metadata.yaml says, empty where there is none."""
        path = self.path
        if not path.exists():
            raise DataError(f'there is no recording at {path}')
        if not path.is_dir():
            if not is_storage(path):
                raise DataError(
                    f'{path} is not a recording; allowed are rosbag2 directories and files that '
                    f'end in {" or ".join(SUFFIXES)}'
                )
            self.files = (path,)
            return {}
        metadata, warning = read_metadata(path / 'metadata.yaml')
        self._warnings += [warning] if warning else []
        # Before version 4 the listed paths began with the directory's own name.
        names = [PurePosixPath(name).name for name in metadata.get('relative_file_paths') or ()]
        if not names:
            found = (file for file in path.iterdir() if is_storage(file))
            names = sorted((file.name for file in found), key=natural_order)
            if not names:
                raise DataError(
                    f'{path} is not a recording: it holds neither a metadata.yaml that lists files '
                    f'nor files that end in {" or ".join(SUFFIXES)}'
                )
        self.files = tuple(_as_stored(path / name) for name in names)
        self._add_unlisted()
        missing = [file.name for file in self.files if not file.is_file()]
        if missing:
            raise DataError(f'{path} lacks {", ".join(missing)}, which its metadata.yaml lists')
        return metadata

    def _add_unlisted(self) -> None:
        """Add files that continue those that are listed, as after a recorder was killed."""
        listed = {bare_name(file) for file in self.files}
        stems = {SPLIT.sub('', name) for name in listed if SPLIT.search(name)}
        suffixes = {storage_suffix(file) for file in self.files}
        found = [
            file
            for file in self.path.iterdir()
            if is_storage(file)
            and bare_name(file) not in listed
            and SPLIT.search(bare_name(file))
            and SPLIT.sub('', bare_name(file)) in stems
            and storage_suffix(file) in suffixes
        ]
        if found:
            names = sorted((file.name for file in found), key=natural_order)
            self._warnings.append(
                f'{self.path} holds {", ".join(names)}, which its metadata.yaml does not list; '
                f'{"it is" if len(names) == 1 else "they are"} used'
            )
            every = {file.name: file for file in (*self.files, *found)}
            self.files = tuple(every[name] for name in sorted(every, key=natural_order))

    def _open(self, path: Path) -> StorageFile:
        file, warning = self._unpacked.open(path)
        with file.open('rb') as stream:
            is_sqlite = stream.read(len(SQLITE_MAGIC)) == SQLITE_MAGIC
        kind = SqliteFile if is_sqlite or '.db3' in path.suffixes else McapFile
        storage = kind(path, file)
        self._warnings += [text for text in (warning, storage.warning) if text]
        return storage

    def _all_topics(self) -> dict[str, TopicInfo]:
        topics: dict[str, TopicInfo] = {}
        for storage in self._storages:
            for name, stored in storage.topics.values():
                info = replace(stored, msgtype=_full_name(stored.msgtype))
                known = topics.get(name)
                topics[name] = info if known is None else self._joined(name, known, info)
        return topics

    def _joined(self, topic: str, known: TopicInfo, info: TopicInfo) -> TopicInfo:
        """Join what two channels or files say of a topic, and note where they contradict."""
        # Of no matter to whoever does not need this topic.
        conflict = known.conflict
        if known.msgtype != info.msgtype and (stamped := stamped_of(known, info)) is not None:
            plain = known if stamped is info else info
            warning = (
                f'{self.path} has topic {topic!r} with two types: messages of type '
                f'{plain.msgtype} are read as {stamped.msgtype} without a stamp'
            )
            self._warnings += [] if warning in self._warnings else [warning]
            known, info = (
                replace(stamped, count=item.count, serialization=item.serialization)
                for item in (known, info)
            )
        pairs = [
            ('types', known.msgtype, info.msgtype),
            ('serializations', known.serialization, info.serialization),
        ]
        if known.definition and info.definition and known.definition != info.definition:
            # Definitions that differ in comments are the same.
            pairs.append(('definitions', *(_parsed_or_text(item) for item in (known, info))))
        told = known if known.definition else info
        for what, first, second in pairs:
            if first != second and not conflict:
                found = '' if what == 'definitions' else f', {first!r} and {second!r}'
                conflict = (
                    f'{self.path} has topic {topic!r} with two {what}{found}; '
                    'allowed is one for each topic'
                )
        return replace(
            told,
            conflict=conflict,
            count=known.count + info.count,
            offered_qos=known.offered_qos or info.offered_qos,
        )

    def _store(self, topic: str) -> Any:
        if topic not in self._stores:
            try:
                self._stores[topic] = find_typestore(*self._definition(topic))
            except UndefinedTypeError as error:
                raise self._undefined(topic, error.reason) from error
        return self._stores[topic]

    def _undefined(self, topic: str, reason: str) -> OccError:
        what = (
            f'cannot be used: {reason}'
            if reason
            else (
                'is neither complete in the bag nor part of ROS 2 Jazzy; --definitions DIR and '
                'AMENT_PREFIX_PATH say where its .msg or .idl file is'
            )
        )
        return DataError(
            f'{self.path} has topic {topic!r} of type {self.topics[topic].msgtype!r}, whose '
            f'definition {what}'
        )


def _full_name(msgtype: str) -> str:
    return _FIRST_NAMES.sub(r'\1/msg/\2', msgtype)


def _msgtype(storage: StorageFile, channel: int) -> str:
    return _full_name(storage.topics[channel][1].msgtype)


def _unpack_message(data: bytes) -> bytes:
    return unpack_zstd(data, MAX_PIECE_BYTES)


def _as_stored(file: Path) -> Path:
    """Return a listed file under the name it has: some are compressed or unpacked later on."""
    others = [file.with_name(file.name + suffix) for suffix in ZSTD_SUFFIXES]
    others += [file.with_suffix('')] if file.suffix in ZSTD_SUFFIXES else []
    return next((other for other in (file, *others) if other.is_file()), file)


def _definition(info: TopicInfo) -> tuple[str, str, str]:
    return info.definition, info.definition_format, info.msgtype


def _reads(definition: tuple[str, str, str, str], examples: list[RawMessage]) -> bool:
    """Tell whether messages can be read by a definition."""
    try:
        store = find_typestore(*definition)
        for raw in examples:
            store.deserialize_cdr(raw.data, raw.msgtype)
    # The generated code fails on wrong bytes in whichever way comes first.
    except Exception:
        return False
    return True


def _parsed_or_text(info: TopicInfo) -> Any:
    try:
        return find_definitions(*_definition(info))
    except UndefinedTypeError:
        return info.definition
