# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""What two runs of a benchmark differ by: ``python -m benchmarks.compare BEFORE.json AFTER.json``.

A report and not a gate: machines differ, and what else they do. Ratios of one run differ least.
"""

from __future__ import annotations

import json
import math
import sys
from pathlib import Path
from typing import Any

from occ_constraints_pkg.errors import ConfigurationError

# Changes below this are as likely of the machine.
_NOTABLE = 0.2


def compare(before: dict[str, Any], after: dict[str, Any]) -> list[str]:
    """Return a line for each metric: before, after, their ratio, and a mark where it is notable.

    Args:
        before: what a benchmark printed with ``--json``, as for ``after``.
        after: see there; metrics that only one of them has are told too.
    """
    lines = []
    if before.get('machine') != after.get('machine'):
        lines.append(f'machines differ: {before.get("machine")}, {after.get("machine")}')
    old, new = before['metrics'], after['metrics']
    width = max(map(len, old | new), default=0)
    for name in old | new:
        if name not in old or name not in new:
            lines.append(f'{name:{width}}  only {"after" if name in new else "before"}')
            continue
        ratio = new[name] / old[name] if old[name] else math.nan
        mark = '  <--' if abs(ratio - 1.0) > _NOTABLE else ''
        lines.append(f'{name:{width}}  {old[name]:10.4g}  {new[name]:10.4g}  {ratio:6.2f}{mark}')
    return lines


def main(argv: list[str]) -> int:
    """Print the comparison of two files; return the exit code."""
    try:
        if len(argv) != 2:
            raise ConfigurationError(f'got {len(argv)} files; allowed are two: BEFORE AFTER')
        documents = [json.loads(Path(path).read_text(encoding='utf-8')) for path in argv]
        for path, document in zip(argv, documents, strict=True):
            if not isinstance(document, dict) or not isinstance(document.get('metrics'), dict):
                raise ConfigurationError(
                    f'{path} has no metrics; allowed is what `python -m benchmarks NAME --json` '
                    'prints'
                )
        print(*compare(*documents), sep='\n')
    except (ConfigurationError, OSError, ValueError) as error:
        print(f'error: {error}', file=sys.stderr)
        return 2
    return 0


if __name__ == '__main__':
    sys.exit(main(sys.argv[1:]))
