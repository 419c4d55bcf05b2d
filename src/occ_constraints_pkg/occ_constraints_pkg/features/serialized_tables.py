# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Tables out of serialized messages: one that is like the one before is not decoded again."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.features.table import Table
from occ_constraints_pkg.features.table_messages import STAMP, STAMP_AT, TableHead


class TableMessage:
    """What a PointCloud2 says, as far as anyone asks.

    Attributes:
        stamp_ns: of the header, in ns.
        frame_id: of the header.

    Args:
        stamp_ns: see above.
        frame_id: see above.
        content: the table, or the decoded message, which need not be one.
    """

    __slots__ = ('_content', 'frame_id', 'stamp_ns')

    def __init__(self, stamp_ns: int, frame_id: str, content: Any) -> None:
        self.stamp_ns, self.frame_id, self._content = stamp_ns, frame_id, content

    @property
    def table(self) -> Table:
        """Its rows; the values are read-only and may be unaligned.

        Raises:
            OccError: it is no table.
        """
        if not isinstance(self._content, Table):
            self._content = Table.from_message(self._content)
        return self._content


class TableReader:
    """Reads the serialized PointCloud2 messages of one topic.

    As a rule they differ in nothing but stamp and numbers. So the bytes from the frame to the
    numbers are worked out once, of the second of two messages of one length. Where a message has
    the same ones, its numbers stand where they stood there. Any other is decoded.

    Args:
        decode: makes a message of its bytes.
    """

    def __init__(self, decode: Callable[[bytes], Any]) -> None:
        self._decode = decode
        self._size = 0
        self._form: _Form | None = None

    def read(self, data: bytes) -> TableMessage:
        """Return what a message says.

        Args:
            data: the message in CDR, the four bytes of its head included.

        Raises:
            Exception: what ``decode`` raises.
        """
        form = self._form
        if form is not None and form.fits(data):
            return form.read(data)
        message = self._decode(data)
        if len(data) == self._size:
            self._form = _form(message, data)
        self._size = len(data)
        header = message.header
        stamp_ns = header.stamp.sec * 1_000_000_000 + header.stamp.nanosec
        return TableMessage(stamp_ns, header.frame_id, message)


@dataclass(frozen=True, eq=False, slots=True)
class _Form:
    """What messages have in common.

    Attributes:
        size: bytes of a message.
        known: the bytes before the numbers, as one number; 0 where they may differ.
        mask: ones where they may not.
        start: where the numbers begin.
        frame_id: of the header.
        table: one of the tables.
    """

    size: int
    known: int
    mask: int
    start: int
    frame_id: str
    table: Table

    def fits(self, data: bytes) -> bool:
        """Tell whether a message is of this form."""
        if len(data) != self.size:
            return False
        return int.from_bytes(data[: self.start], 'little') & self.mask == self.known

    def read(self, data: bytes) -> TableMessage:
        """Return such a message."""
        seconds, rest = STAMP.unpack_from(data, STAMP_AT)
        like = self.table.values
        values = np.frombuffer(data, like.dtype, like.size, self.start).reshape(like.shape)
        return TableMessage(
            seconds * 1_000_000_000 + rest, self.frame_id, Table(self.table.names, values)
        )


def _form(message: Any, data: bytes) -> _Form | None:
    """Return the form of a message; None for one that is no table, or a table with holes."""
    try:
        table = Table.from_message(message)
    except OccError:
        return None
    fields = [(field.name, field.offset, field.datatype, field.count) for field in message.fields]
    step = table.values.shape[1] * table.values.dtype.itemsize
    if fields != table.layout or message.point_step != step or not len(table.values):
        return None
    head = TableHead(
        message.header.frame_id,
        message.height,
        message.width,
        fields,
        message.point_step,
        message.row_step,
        len(message.data),
    )
    form = _Form(
        size=len(data),
        known=int.from_bytes(head.known, 'little'),
        mask=int.from_bytes(head.mask, 'little'),
        start=len(head.known),
        frame_id=message.header.frame_id,
        table=table,
    )
    # One more byte, ``is_dense``, follows the numbers.
    is_whole = len(data) > form.start + len(message.data)
    return form if is_whole and form.fits(data) else None
