# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Suggested feature maps as commented YAML, and statistics of a map as a table."""

from __future__ import annotations

import json
import math
import re
import textwrap
from collections.abc import Sequence
from typing import Any

from occ_constraints_pkg.suggestion.candidate import Candidate
from occ_constraints_pkg.suggestion.families import coupled_pairs
from occ_constraints_pkg.suggestion.statistics import FeatureStatistics, MapStatistics
from occ_constraints_pkg.suggestion.suggest import Suggestion
from occ_constraints_pkg.terminal import printable

_WIDTH = 98
_PLAIN = re.compile(r'[A-Za-z_/][A-Za-z0-9_./]*')
_ELEMENT = re.compile(r'\[[^\]]*\]')
_NOT_TEXT = {'true', 'false', 'null', 'yes', 'no', 'on', 'off', 'y', 'n'}


def suggestion_text(suggestion: Suggestion) -> str:
    """Return a suggested map as the text of a YAML file that loads as it is.

    Without a feature in use it says why; it loads as soon as one is added.
    """
    pace, seen = suggestion.pace, suggestion.seen
    of_robot = f', robot {suggestion.robot}' if suggestion.robot else ''
    told = (
        f'{seen.rows} rows in {seen.duration_s:.1f} s, of which {seen.usable:.1%} can be judged. '
        'Read it, delete what does not matter, and uncomment what does.'
        if suggestion.used
        else 'no feature can be used as it is. The map loads when one is added; each topic below '
        'says what is in the way.'
    )
    lines = [
        *_comment(f'Suggested from {suggestion.name}{of_robot}: {told}'),
        *(line for text in suggestion.warnings for line in _comment(f'Warning: {text}.')),
        'schema_version: 1',
    ]
    if pace is not None:
        lines += [
            *_comment(
                f'The trigger topic: each of its messages gives one row ({_rate(pace.rate)}); of '
                'the other topics, the latest value is used.'
            ),
            f'pace: {_flow(pace.key)}',
        ]
    lines += [
        *_comment('In seconds. An older value counts as missing, and the verdict is then UNKNOWN.'),
        f'max_age: {suggestion.max_age}',
        'features:' if suggestion.used else 'features: []',
    ]
    family = ''
    for item in suggestion.used:
        own = item.entry.get('family', '') if item.family_seen else ''
        if not own or own != family:
            lines += ['', *_about(item)]
        lines += _item(item.entry)
        family = own
    pairs = coupled_pairs(suggestion.used)
    if pairs:
        lines += [
            '',
            *_comment('Tied by the dynamics of a joint or sensor: no rule combines them.'),
        ]
        lines += ['apart:', *(f'- {_flow(list(pair))}' for pair in pairs)]
    aside = [item for item in suggestion.candidates if item.aside]
    if aside:
        lines += ['', *_comment('Not used, each for the reason given:')]
    for item in aside:
        if not item.is_brief:
            lines += ['#', *_about(item), *(f'# {line}' for line in _item(item.entry))]
    lines += _briefly(aside)
    if suggestion.unused:
        lines += ['', *_comment('Topics without a suggestion:')]
        for topic, reason in suggestion.unused:
            lines += _comment(f'{topic.name} ({topic.msgtype}): {reason}.')
    return '\n'.join(lines) + '\n'


def _briefly(aside: Sequence[Candidate]) -> list[str]:
    """Return fields that were set aside, those of one topic for one reason together."""
    together: dict[tuple[str, str], list[str]] = {}
    for item in aside:
        if item.is_brief:
            together.setdefault((item.topic.name, item.aside), []).append(item.entry['field'])
    lines = []
    for (topic, reason), fields in together.items():
        lines += ['#', *_comment(f'{topic}, {", ".join(_shortened(fields))}: {reason}.')]
    return lines


def _shortened(fields: Sequence[str]) -> list[str]:
    """Return field paths, elements of one array as one."""
    return list(dict.fromkeys(_ELEMENT.sub('[...]', field) for field in fields))


def describe_statistics(seen: MapStatistics, where: str, pace: str) -> str:
    """Return the statistics of a map as a table for people."""
    width = max(24, 1 + max((len(item.source.name) for item in seen.features), default=0))
    lines = [
        f'{where}: {seen.rows} rows in {seen.duration_s:.1f} s, triggered by {pace}; '
        f'{seen.usable:.1%} can be judged',
        f'{"feature":<{width}}{"unit":>7}{"min":>11}{"median":>11}{"max":>11}{"missing":>9}'
        f'{"outside":>9}{"stale":>8}  first problem',
    ]
    for item in seen.features:
        numbers = ''.join(f'{_number(value):>11}' for value in (item.low, item.median, item.high))
        shares = f'{item.missing:>9.1%}{item.outside:>9.1%}{item.stale:>8.1%}'
        problem = 'never changes' if item.is_constant else item.first_problem
        lines.append(
            f'{item.source.name:<{width}}{item.source.unit:>7}{numbers}{shares}  {problem}'.rstrip()
        )
    if seen.clock_jumps:
        lines.append(f'stamps jump back {seen.clock_jumps} times from one row to the next')
    return '\n'.join(map(printable, lines))


def statistics_document(seen: MapStatistics) -> dict[str, Any]:
    """Return the statistics of a map as plain values for JSON; None for a missing number."""
    return {
        'rows': seen.rows,
        'duration_s': seen.duration_s,
        'usable_share': seen.usable,
        'clock_jumps': seen.clock_jumps,
        'features': [
            {
                'name': item.source.name,
                'unit': item.source.unit,
                'min': _finite(item.low),
                'median': _finite(item.median),
                'max': _finite(item.high),
                'missing_share': item.missing,
                'outside_share': item.outside,
                'stale_share': item.stale,
                'longest_still_s': item.longest_still_s,
                'first_problem': item.first_problem or None,
                'is_problem': item.is_problem,
            }
            for item in seen.features
        ],
        'warnings': list(seen.warnings),
    }


def suggestion_document(suggestion: Suggestion, output: str | None) -> dict[str, Any]:
    """Return a suggested map and what was seen as plain values for JSON.

    Args:
        suggestion: the map.
        output: the file it was written to; None for none.
    """
    return {
        'output': output,
        'robot': suggestion.robot or None,
        'map': suggestion_text(suggestion),
        'pace': None if suggestion.pace is None else suggestion.pace.name,
        'max_age': suggestion.max_age,
        **statistics_document(suggestion.seen),
        'not_used': [
            {'name': item.entry['name'], 'topic': item.topic.name, 'reason': item.aside}
            for item in suggestion.candidates
            if item.aside
        ],
        'topics_not_used': [
            {'topic': topic.name, 'type': topic.msgtype, 'reason': reason}
            for topic, reason in suggestion.unused
        ],
        'warnings': list(suggestion.warnings),
    }


def _about(item: Candidate) -> list[str]:
    """Return the comment above an entry."""
    name = item.entry['name']
    lines = []
    if item.seen:
        if item.family_seen:
            name = f'the family {item.entry["family"]}'
        seen_all = item.family_seen or item.seen
        text = f'{name}: {_span(seen_all)} {item.entry["unit"]}'.removesuffix(' 1')
        missing = max(seen.missing + seen.outside for seen in seen_all)
        text += f'; {item.topic.name} at {_rate(item.topic.rate)}'
        text += f', missing in {missing:.1%} of the rows' if missing else ', never missing'
        lines += _comment(text + '.')
    if item.aside:
        lines += _comment(f'{name} is not used: {item.aside}.')
    if item.remark:
        lines += _comment(item.remark[0].upper() + item.remark[1:].rstrip('.') + '.')
    return lines


def _span(seen: Sequence[FeatureStatistics]) -> str:
    low, high = min(item.low for item in seen), max(item.high for item in seen)
    if low == high:
        return f'always {_number(low)}'
    text = f'{_number(low)} to {_number(high)}'
    return f'{text}, median {_number(seen[0].median)}' if len(seen) == 1 else text


def _comment(text: str) -> list[str]:
    return [
        f'# {line}' for line in textwrap.wrap(printable(text), _WIDTH - 2, break_on_hyphens=False)
    ]


def _item(entry: dict[str, Any]) -> list[str]:
    """Return an entry as an item of a YAML list, in lines that are not too long."""
    pairs = [f'{key}: {_flow(value)}' for key, value in entry.items()]
    lines = ['- {' + pairs[0]]
    for pair in pairs[1:]:
        if len(lines[-1]) + len(pair) + 3 <= _WIDTH:
            lines[-1] += f', {pair}'
        else:
            lines[-1] += ','
            lines.append(f'   {pair}')
    lines[-1] += '}'
    return lines


def _flow(value: Any) -> str:
    """Return a plain value as YAML on one line."""
    if isinstance(value, dict):
        return '{' + ', '.join(f'{key}: {_flow(item)}' for key, item in value.items()) + '}'
    if isinstance(value, list):
        return '[' + ', '.join(_flow(item) for item in value) + ']'
    if isinstance(value, str) and printable(value) != value:
        return json.dumps(value)
    if isinstance(value, str) and not (_PLAIN.fullmatch(value) and value.lower() not in _NOT_TEXT):
        return "'" + value.replace("'", "''") + "'"
    return value if isinstance(value, str) else json.dumps(value)


def _rate(rate: float) -> str:
    return f'{rate:.3g} Hz' if math.isfinite(rate) else 'an unknown rate'


def _number(value: float) -> str:
    return f'{value:.4g}' if math.isfinite(value) else '-'


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None
