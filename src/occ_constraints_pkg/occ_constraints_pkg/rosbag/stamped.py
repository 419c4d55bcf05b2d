# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Topics on which both a type and its stamped form came, such as Twist and TwistStamped."""

from __future__ import annotations

from rosbags.interfaces import Nodetype

from occ_constraints_pkg.rosbag.storage import TopicInfo
from occ_constraints_pkg.rosbag.typestores import UndefinedTypeError, find_definitions

_HEADER = 'std_msgs/msg/Header'
# Of a header: stamp 0, which is none, then an empty frame, and what aligns the part behind it; the
# frame's length is in either order of bytes.
_NO_HEADER = {1: bytes(8) + b'\1\0\0\0' + bytes(4), 0: bytes(8) + b'\0\0\0\1' + bytes(4)}
_ENCODING_BYTES = 4


def stamped_of(first: TopicInfo, second: TopicInfo) -> TopicInfo | None:
    """Return which of two types is the other one behind a header; None if neither is."""
    for plain, stamped in ((first, second), (second, first)):
        if stamped.msgtype != f'{plain.msgtype}Stamped':
            continue
        definition = stamped.definition, stamped.definition_format, stamped.msgtype
        try:
            _, fields = find_definitions(*definition)[stamped.msgtype]
        except UndefinedTypeError:
            return None
        parts = [field for _, field in fields]
        if parts == [(Nodetype.NAME, _HEADER), (Nodetype.NAME, plain.msgtype)]:
            return stamped
    return None


def with_header(data: bytes) -> bytes:
    """Return a message in CDR as that of its stamped type, without a stamp.

    The header has a length of which all alignments are parts, so what follows it stays as it is.
    """
    header = _NO_HEADER.get(data[1], b'') if len(data) > 1 else b''
    return data[:_ENCODING_BYTES] + header + data[_ENCODING_BYTES:]
