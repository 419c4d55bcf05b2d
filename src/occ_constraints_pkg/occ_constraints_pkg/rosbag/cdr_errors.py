# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Why bytes are not a message in the CDR of ROS 2, in words."""

from __future__ import annotations

import re

# The first two bytes, which name the encoding (OMG DDS-RTPS and DDS-XTypes).
_ENCODINGS = {
    0x0002: 'XCDR1 with parameter lists',
    0x0003: 'XCDR1 with parameter lists',
    0x0004: 'XML',
    0x0006: 'XCDR2 (plain)',
    0x0007: 'XCDR2 (plain)',
    0x0008: 'XCDR2 (delimited)',
    0x0009: 'XCDR2 (delimited)',
    0x000A: 'XCDR2 (parameter lists)',
    0x000B: 'XCDR2 (parameter lists)',
    # As some publishers wrote them before these numbers were settled.
    0x0010: 'XCDR2 (plain)',
    0x0011: 'XCDR2 (plain)',
    0x0012: 'XCDR2 (parameter lists)',
    0x0013: 'XCDR2 (parameter lists)',
    0x0014: 'XCDR2 (delimited)',
    0x0015: 'XCDR2 (delimited)',
}
_LARGEST_TEXT = 255
# A frame or other name at the beginning, behind the stamp of a header.
_NAME = re.compile(rb'[\w/ .:-]+')


def wrong_bytes(data: bytes, msgtype: str) -> str:
    """Return what is wrong with a message that could not be decoded, to go on a sentence with.

    Args:
        data: the message.
        msgtype: what it should be.
    """
    encoding = _ENCODINGS.get(int.from_bytes(data[:2], 'big'))
    if encoding:
        return f'that is encoded in {encoding}; allowed is plain CDR, as ROS 2 has it (XCDR1)'
    text = f'whose {len(data)} bytes are not a {msgtype}'
    if name := _name_without_end(data):
        text += f': the text {name!r} in it does not end in a zero byte, as CDR requires'
    return text


def _name_without_end(data: bytes) -> str:
    """Return the text behind a header's stamp if its length does not count a zero at its end."""
    if data[:2] not in (b'\0\0', b'\0\1') or len(data) < 16:
        return ''
    length = int.from_bytes(data[12:16], 'little' if data[1] else 'big')
    text = data[16 : 16 + length]
    is_name = 0 < length <= _LARGEST_TEXT and len(text) == length and _NAME.fullmatch(text)
    return text.decode('ascii', 'replace') if is_name else ''
