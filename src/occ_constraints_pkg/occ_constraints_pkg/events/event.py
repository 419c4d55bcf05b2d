# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""One event as a value, and as the JSON that the topic ``events`` and the store hold."""

from __future__ import annotations

import json
import math
import secrets
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from typing import Any

from occ_constraints_pkg.documents import load_schema, validate
from occ_constraints_pkg.errors import InputError

SCHEMA = 1
"""Version of the document; readers ignore keys that they do not know."""

KINDS = ('violation', 'unknown', 'near_miss', 'stop', 'trigger')
PHASES = ('began', 'update', 'ended')
_WHERE = 'an event'


@dataclass(frozen=True)
class Stamps:
    """The header stamps of an event's inputs, in ns: the same for a recording, however played.

    Attributes:
        began: of the first input.
        worst: of the input with the smallest margin.
        last: of the last input that belongs to the event.
    """

    began: int
    worst: int
    last: int


@dataclass(frozen=True)
class Event:
    """Something that happened to one robot, from its beginning to its end.

    Attributes:
        id: 24 hexadecimal digits, unique for ever; ids sort by ``began``.
        kind: ``violation`` of one rule; ``unknown``: nothing could be judged; ``near_miss``: SAFE
            with a small margin, without a violation; ``stop`` of the gate; ``trigger``: somebody
            asked for a recording.
        robot: the namespace, ``/`` without one; of a table of robots, with ``#N`` for all but the
            first.
        text: one line for people.
        began: wall time in ns since the epoch.
        worst: wall time of the smallest margin; ``began`` where there is none.
        ended: wall time; None while it goes on.
        rule: id of the rule that was violated, came close, or stopped the robot; None for others.
        values: at the worst moment, of the features that the rule names.
        bounds: the rule's literals as in a constraints file: each with ``feature`` or ``family``,
            ``operator`` and ``bound``.
        margin: the smallest one; NaN where there is none.
        rule_set: fingerprint of the rules that judged; None where none did.
        reason: why it is UNKNOWN, why the gate stopped, or how the event ended.
        bag: path of the recording of the seconds around it; None where there is none.
        cause: id of the event that made the gate stop; None where none is known.
        stamps: of the inputs; None where it is about none.
    """

    id: str
    kind: str
    robot: str
    text: str
    began: int
    worst: int
    ended: int | None = None
    rule: str | None = None
    values: Mapping[str, float] = field(default_factory=dict)
    bounds: tuple[Mapping[str, Any], ...] = ()
    margin: float = math.nan
    rule_set: str | None = None
    reason: str = ''
    bag: str | None = None
    cause: str | None = None
    stamps: Stamps | None = None

    @property
    def seconds(self) -> float | None:
        """How long it lasted; None while it goes on, 0 where the clock was set back meanwhile."""
        return None if self.ended is None else max(0, self.ended - self.began) * 1e-9

    def to_document(self, phase: str) -> dict[str, Any]:
        """Return the event as plain values, ready for JSON.

        Args:
            phase: one of :data:`PHASES`.
        """
        return {
            'schema': SCHEMA,
            'id': self.id,
            'phase': phase,
            'kind': self.kind,
            'robot': self.robot,
            'rule': self.rule,
            'text': self.text,
            'values': {name: _finite(value) for name, value in self.values.items()},
            'bounds': [dict(item) for item in self.bounds],
            'margin': _finite(self.margin),
            'began': self.began,
            'worst': self.worst,
            'ended': self.ended,
            'rule_set': self.rule_set,
            'reason': self.reason,
            'bag': self.bag,
            'cause': self.cause,
            'stamps': None if self.stamps is None else vars(self.stamps).copy(),
        }

    def to_json(self, phase: str) -> str:
        """Return the text of a message on the topic ``events``."""
        return json.dumps(self.to_document(phase), allow_nan=False)

    @classmethod
    def from_document(cls, document: Any, where: str = _WHERE) -> tuple[Event, str]:
        """Return the event of a document, and the phase; keys that are not known are ignored.

        Raises:
            OccError: it is none, or one of a newer schema.
        """
        version = document.get('schema') if isinstance(document, dict) else None
        if isinstance(version, int) and version > SCHEMA:
            raise InputError(
                f'{where} has schema {version}; allowed is {SCHEMA} at most: update occ_constraints'
            )
        validate(document, _schema(), where)
        return cls.from_plain(document), document['phase']

    @classmethod
    def from_plain(cls, document: dict[str, Any]) -> Event:
        """Return the event of a document that this program has written; it is not checked."""
        stamps = document.get('stamps')
        if stamps is not None:
            stamps = Stamps(*(stamps[name] for name in ('began', 'worst', 'last')))
        return cls(
            id=document['id'],
            kind=document['kind'],
            robot=document['robot'],
            text=document['text'],
            began=document['began'],
            worst=document['worst'],
            ended=document['ended'],
            rule=document['rule'],
            values={name: _number(value) for name, value in document['values'].items()},
            bounds=tuple(document['bounds']),
            margin=_number(document['margin']),
            rule_set=document['rule_set'],
            reason=document['reason'],
            bag=document['bag'],
            cause=document.get('cause'),
            stamps=stamps,
        )

    @classmethod
    def from_json(cls, text: str, where: str = _WHERE) -> tuple[Event, str]:
        """Return the event of a message on the topic ``events``, and the phase.

        Raises:
            OccError: it is none, or one of a newer schema.
        """
        try:
            document = json.loads(text)
        except (ValueError, RecursionError) as error:
            raise InputError(f'{where} is not JSON: {error}') from error
        return cls.from_document(document, where)


def new_id(began: int) -> str:
    """Return an id for an event that began at this wall time in ns."""
    return f'{max(0, began):016x}{secrets.token_hex(4)}'


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _number(value: float | None) -> float:
    return math.nan if value is None else float(value)


@cache
def _schema() -> dict[str, Any]:
    return load_schema(__package__, 'event.schema.json')
