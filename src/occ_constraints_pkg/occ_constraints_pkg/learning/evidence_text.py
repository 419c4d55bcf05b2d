# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Why a rule is there: the evidence for its bounds, for people and for machines."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import UTC, datetime, timedelta
from typing import Any

from occ_constraints_pkg.documents import did_you_mean
from occ_constraints_pkg.errors import ConfigurationError
from occ_constraints_pkg.learning.evidence import MOST_LITERALS
from occ_constraints_pkg.rules.constraints_file import Constraints
from occ_constraints_pkg.rules.rule import Rule
from occ_constraints_pkg.terminal import printable

_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)


def why_document(constraints: Constraints, rule_id: str) -> dict[str, Any]:
    """Return a rule with what the demonstrations say of it, as what JSON can hold.

    Evidence is about the bounds that were learned. When one of a rule has been moved, or a literal
    added or removed, none of it applies, for other samples would be near. Then ``missing`` says
    why, and there is nothing else.

    Args:
        constraints: the file.
        rule_id: the rule.

    Raises:
        OccError: there is no such rule.
    """
    space = constraints.rule_set.space
    ids = [rule.id for rule in constraints.rule_set.rules]
    if rule_id not in ids:
        hint = did_you_mean(rule_id, ids) or '; occ show FILE prints the ids of all'
        raise ConfigurationError(f'the constraints have no rule {rule_id!r}{hint}')
    rule = constraints.rule_set.rules[ids.index(rule_id)]
    document: dict[str, Any] = {
        'id': rule.id,
        'text': rule.words(space),
        'formula': rule.formula(space),
        'enabled': rule.enabled,
        'note': rule.note,
    }
    texts = [literal.text(space) for literal in rule.literals]
    learned = _learned(constraints, rule)
    missing = _missing(constraints, rule, learned)
    if missing:
        return {**document, 'missing': missing, 'literals': [{'text': text} for text in texts]}
    return {
        **document,
        'missing': None,
        'flagged': learned['flagged'],
        'near': constraints.evidence['near'],
        'literals': [
            {
                'text': text,
                'near': item['near'],
                'episodes': item['episodes'],
                'closest': [_traced(constraints, sample) for sample in item['closest']],
            }
            for text, item in zip(texts, learned['literals'], strict=True)
        ],
    }


def describe_why(document: Mapping[str, Any]) -> str:
    """Return what :func:`why_document` gives as lines of text."""
    lines = [f'{document["id"]}: {document["text"]}']
    if document['note']:
        lines[0] += f'   # {document["note"]}'
    if document['missing']:
        lines.append(f'no evidence: {document["missing"]}')
        return '\n'.join(map(printable, lines))
    lines.append(
        f'training samples beyond its bounds, taken for outliers: {document["flagged"]}'
        if document['flagged']
        else 'no training sample lies beyond its bounds'
    )
    for literal in document['literals']:
        lines.append(f'  {literal["text"]}: {_describe_support(literal, document["near"])}')
        lines += [f'    {_describe_sample(sample)}' for sample in literal['closest']]
    return '\n'.join(map(printable, lines))


def _learned(constraints: Constraints, rule: Rule) -> Mapping[str, Any] | None:
    """Return what the file holds of the rule of this id, None if nothing."""
    items = constraints.evidence.get('rules', ())
    return next((item for item in items if item['id'] == rule.id), None)


def _missing(constraints: Constraints, rule: Rule, learned: Mapping[str, Any] | None) -> str | None:
    """Say why there is no evidence for a rule as it stands, None where there is."""
    if not constraints.evidence:
        return (
            'the file holds none; it was written by hand, by an earlier version, or with more than '
            f'{MOST_LITERALS} literals'
        )
    if learned is None:
        return 'the rule was not learned, but written by hand or made from others'
    if learned['formula'] != rule.formula(constraints.rule_set.space):
        return f'the rule was changed since it was learned, when it read {learned["formula"]}'
    if len(learned['literals']) != len(rule.literals):
        return 'the file does not have it for all literals of the rule'
    return None


def _traced(constraints: Constraints, sample: Mapping[str, Any]) -> dict[str, Any]:
    """Name the file, and tell times in seconds and by the calendar."""
    found = {key: sample[key] for key in ('value', 'feature') if key in sample}
    sources = constraints.provenance.get('bags', ())
    if 0 <= sample.get('source', -1) < len(sources):
        source = sources[sample['source']]
        found.update(source=source.get('name'), sha256=source.get('sha256'))
    if 'time_ns' in sample:
        if constraints.feature_map is not None:
            found['topic'] = constraints.feature_map.get('pace')
        found['time_s'] = sample['time_ns'] / 1e9
        found['time'] = _calendar(sample['time_ns'])
        found['time_ns'] = sample['time_ns']
    if 'row' in sample:
        found['row'] = sample['row']
    return found


def _calendar(time_ns: int) -> str:
    return (_EPOCH + timedelta(microseconds=time_ns // 1000)).isoformat(timespec='microseconds')


def _describe_support(literal: Mapping[str, Any], near: float) -> str:
    if not literal['closest']:
        return 'no safe sample would be flagged without it'
    within = f'within {near:.0%} of the demonstrated range'
    count = (
        f'safe samples {within}: {literal["near"]} (episodes: {literal["episodes"]})'
        if literal['near']
        else f'no safe sample {within}'
    )
    return f'{count}; closest, one per episode:'


def _describe_sample(sample: Mapping[str, Any]) -> str:
    text = f'{sample["value"]!r}'
    text += f' ({sample["feature"]}, of the same family)' if 'feature' in sample else ''
    if sample.get('source'):
        text += f' in {sample["source"]}'
    if 'time_ns' in sample:
        text += f', {sample["topic"]}' if sample.get('topic') else ''
        text += f' at {_seconds(sample["time_ns"])} s ({sample["time"]})'
    if 'row' in sample:
        text += f', row {sample["row"]}'
    return text


def _seconds(time_ns: int) -> str:
    """Return seconds with all nine places, which a float could not hold."""
    seconds, rest = divmod(time_ns, 10**9)
    return f'{seconds}.{rest:09d}'
