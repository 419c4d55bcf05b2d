# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""What metadata.yaml of a rosbag2 directory tells, of versions 1 to 9, and its writing."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from occ_constraints_pkg.documents import parse_yaml, read_text
from occ_constraints_pkg.errors import DataError
from occ_constraints_pkg.rosbag.qos import parse_profiles
from occ_constraints_pkg.rosbag.storage import TopicInfo

_KINDS = {str: 'names', dict: 'topics'}
# Text that means itself to YAML 1.1 and 1.2 without quotes.
_BARE = re.compile(r'(?!(?:true|false|yes|no|on|off|y|n|null|nan|inf)$)[a-z/][a-z0-9_/.-]*', re.I)


def with_metadata(topics: dict[str, TopicInfo], metadata: dict[str, Any]) -> dict[str, TopicInfo]:
    """Complete topics with the QoS and the serialization that only metadata.yaml may tell."""
    result = dict(topics)
    for entry in metadata.get('topics_with_message_count') or ():
        told = (entry.get('topic_metadata') if isinstance(entry, dict) else None) or {}
        info = result.get(told.get('name')) if isinstance(told, dict) else None
        if info is None:
            continue
        qos = info.offered_qos or parse_profiles(told.get('offered_qos_profiles'))
        serialization = str(told.get('serialization_format') or info.serialization)
        result[told['name']] = replace(info, offered_qos=qos, serialization=serialization)
    return result


def read_metadata(path: Path) -> tuple[dict[str, Any], str]:
    """Return the content of a metadata.yaml, empty where there is none, and a warning or nothing.

    Raises:
        OccError: it cannot be read, or is of a version that is not known.
    """
    if not path.exists():
        return {}, ''
    text = read_text(path)
    if not text.strip('\0 \n'):
        return {}, f'{path} is empty, as after a recorder was killed; the files beside it are used'
    document = parse_yaml(text, str(path))
    metadata = document.get('rosbag2_bagfile_information') if isinstance(document, dict) else None
    if not isinstance(metadata, dict):
        raise DataError(f'{path} is not the metadata of a rosbag2 recording')
    version = metadata.get('version')
    if not isinstance(version, int) or not 1 <= version <= 9:
        raise DataError(f'{path} has version {version!r}; allowed are 1 to 9')
    for key, kind in (('relative_file_paths', str), ('topics_with_message_count', dict)):
        value = metadata.get(key) or []
        if not isinstance(value, list) or not all(isinstance(item, kind) for item in value):
            raise DataError(f'{path} is damaged: {key} is not a list of {_KINDS[kind]}')
    return metadata, ''


def is_compressed_by_message(metadata: dict[str, Any], path: Path) -> bool:
    """Tell whether each message is compressed by itself, which only metadata.yaml tells.

    Raises:
        OccError: the compression is of another format or mode than there should be.
    """
    mode = str(metadata.get('compression_mode') or 'none').lower()
    format_ = str(metadata.get('compression_format') or 'none').lower()
    if mode not in ('none', 'file', 'message') or (mode != 'none' and format_ != 'zstd'):
        raise DataError(
            f'{path} is compressed with {format_!r} by {mode!r}; '
            "allowed is 'zstd' by file or by message"
        )
    return mode == 'message'


# YAML looks no further for the colon after a key that does not say that it is one.
_LONGEST_KEY = 1000


def dump_plain(document: Any) -> str:
    """Write mappings, lists, texts, whole numbers, booleans and None as YAML, as rosbag2 does.

    A recorder writes its topics again and again. For thousands of them, this takes a hundredth of
    the time of a general YAML writer.
    """
    return '\n'.join(_lines(document)) + '\n'


def _lines(value: Any) -> Iterator[str]:
    if isinstance(value, Mapping) and value:
        for key, item in value.items():
            name = _scalar(key)
            if len(name) > _LONGEST_KEY:
                yield f'? {name}'
                name = ''
            if isinstance(item, Mapping | list | tuple) and item:
                yield f'{name}:'
                yield from ('  ' + line for line in _lines(item))
            else:
                yield f'{name}: {_scalar(item)}'
    elif isinstance(value, list | tuple) and value:
        for item in value:
            lead = '- '
            for line in _lines(item):
                yield lead + line
                lead = '  '
    else:
        yield _scalar(value)


def _scalar(value: Any) -> str:
    if value is None or isinstance(value, bool):
        return {None: 'null', True: 'true', False: 'false'}[value]
    if isinstance(value, int):
        return str(value)
    if isinstance(value, Mapping | list | tuple):
        return '{}' if isinstance(value, Mapping) else '[]'
    text = str(value)
    if _BARE.fullmatch(text):
        return text
    return f'"{"".join(map(_escaped, text))}"'


def _escaped(character: str) -> str:
    if character in '"\\':
        return f'\\{character}'
    return character if ' ' <= character <= '~' else f'\\U{ord(character):08x}'
