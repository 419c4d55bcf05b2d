# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""How early violations were warned of, as text and as plain values."""

from __future__ import annotations

from typing import Any

import numpy as np

from occ_constraints_pkg.checking.early_warning import WarningRecord
from occ_constraints_pkg.checking.timeline import Timeline
from occ_constraints_pkg.rules.ruleset import RuleSet


def describe_warnings(record: WarningRecord) -> str:
    """Return one sentence on the violations that were warned of, and one on false warnings."""
    document = warnings_summary(record)
    found = f'{document["warned"]} of {document["onsets"]} violations were'
    if document['warned']:
        found += (
            f' warned of, the median {document["median_seconds"]:.2f} s and the least '
            f'{document["least_seconds"]:.2f} s before'
        )
    else:
        found += ' warned of'
    wrong = f'{document["false"]} of {document["warnings"]} warnings were false'
    if document['false_share'] is not None:
        wrong += f' ({document["false_share"]:.0%})'
    return f'with violations estimated within {record.horizon:g} s: {found}; {wrong}'


def warnings_summary(record: WarningRecord) -> dict[str, Any]:
    """Return the numbers over all violations, ready for JSON; null where there are none."""
    seconds = [onset.warned for onset in record.onsets if onset.warned > 0.0]
    return {
        'horizon': record.horizon,
        'onsets': len(record.onsets),
        'warned': len(seconds),
        'median_seconds': float(np.median(seconds)) if seconds else None,
        'least_seconds': min(seconds) if seconds else None,
        'warnings': record.warnings,
        'false': record.false,
        'false_share': record.false / record.warnings if record.warnings else None,
    }


def warnings_document(
    record: WarningRecord, timeline: Timeline, rule_set: RuleSet
) -> dict[str, Any]:
    """Return the summary, and for each violation how early the warning came and by what."""
    names, sources = rule_set.space.names, timeline.data.sources
    return {
        **warnings_summary(record),
        'violations': [
            {
                'source': sources[onset.source]['name'],
                'episode': onset.episode,
                'start': onset.start,
                'rule': rule_set.rules[onset.rule].id,
                'warned_seconds': onset.warned,
                'feature': names[onset.feature] if onset.feature >= 0 else None,
            }
            for onset in record.onsets
        ],
    }
