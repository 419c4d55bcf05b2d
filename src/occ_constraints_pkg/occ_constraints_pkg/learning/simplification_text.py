# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""What simplification did, as text and as plain values."""

from __future__ import annotations

from typing import Any

from occ_constraints_pkg.learning.simplification import Simplification
from occ_constraints_pkg.terminal import printable
from occ_constraints_pkg.wording import count_of


def describe_simplification(result: Simplification) -> str:
    """Return which rules were merged, removed and kept, and the numbers before and after."""
    lines = [f'{name} stands for {", ".join(former)}' for name, former in result.changed.items()]
    if result.removed:
        lines.append(f'needed no more: {", ".join(result.removed)}')
    if result.kept:
        lines.append(f'left alone for their note or counters: {", ".join(result.kept)}')
    rules, literals = result.before
    lines.append(
        f'{count_of(rules, "rule")} with {count_of(literals, "literal")} before, '
        + '{} with {} after'.format(*result.after)
    )
    return '\n'.join(map(printable, lines))


def simplification_document(result: Simplification) -> dict[str, Any]:
    """Return the same as plain values, ready for JSON."""
    return {
        **dict(zip(('rules_before', 'literals_before'), result.before, strict=True)),
        **dict(zip(('rules', 'literals'), result.after, strict=True)),
        'changed': {name: list(former) for name, former in result.changed.items()},
        'removed': list(result.removed),
        'kept': list(result.kept),
    }
