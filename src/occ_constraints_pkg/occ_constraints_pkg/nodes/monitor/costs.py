# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The answer on ``costs``, written straight as bytes."""

from __future__ import annotations

from functools import lru_cache

from occ_constraints_pkg.features.table_messages import TableSerializer
from occ_constraints_pkg.ros.table_topics import table_bytes
from occ_constraints_pkg.ros.tables import COST_COLUMNS, costs_table
from occ_constraints_pkg.rules import Judgement, Verdict


def costs_message(judgement: Judgement, stamp_ns: int, frame_id: str) -> bytes:
    """Return a judgement as the message for ``costs``, serialized.

    To make a table of one row takes longer than to judge it, so that is left out.
    """
    if len(judgement.verdict) != 1:
        return table_bytes(costs_table(judgement), stamp_ns, frame_id)
    verdict = int(judgement.verdict[0])
    cost = 0.0 if verdict == Verdict.SAFE else 1.0
    row = (cost, verdict, judgement.margin[0], judgement.rule[0])
    return _serializer(frame_id).serialize(row, stamp_ns)


@lru_cache(maxsize=4)
def _serializer(frame_id: str) -> TableSerializer:
    return TableSerializer(COST_COLUMNS, frame_id)
