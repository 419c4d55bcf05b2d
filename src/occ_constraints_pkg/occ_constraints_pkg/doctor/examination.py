# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The whole examination, in a bounded time, and its text."""

from __future__ import annotations

import time
from collections.abc import Iterator
from functools import partial
from pathlib import Path

from occ_constraints_pkg.doctor import local
from occ_constraints_pkg.doctor.findings import NOTE, OK, PROBLEM, Finding, examined
from occ_constraints_pkg.doctor.network import examine_network
from occ_constraints_pkg.ros.environment import check_middleware
from occ_constraints_pkg.terminal import printable

# All but the processes at the end takes less than a second.
_SECONDS = 9.0
_NAME_WIDTH = len('simulated time')


def examine(bags: Path) -> Iterator[Finding]:
    """Look at all that nodes need; what is found is yielded at once, the slow things last.

    Args:
        bags: folder that recordings are to be written to.
    """
    end = time.monotonic() + _SECONDS
    checks = {
        'python': local.python,
        'package': local.package,
        'extra train': partial(local.extra, 'train'),
        'extra report': partial(local.extra, 'report'),
        'extra dashboard': partial(local.extra, 'dashboard'),
        'disk': partial(local.disk, bags),
        'clock': local.clock,
        'ROS packages': local.ros_packages,
        'domain': local.domain,
        'memory': local.memory,
        'logs': local.logs,
        'middleware': _middleware,
    }
    found = {}
    for name, check in checks.items():
        finding = examined(name, check)
        found[name] = finding.level
        yield finding
    needed = ('ROS packages', 'domain', 'memory', 'logs', 'middleware', 'clock')
    if PROBLEM in (found[name] for name in needed):
        text = 'not tried, for what stands above would let it fail'
        yield Finding('discovery', NOTE, text, 'solve that first')
    else:
        yield from examine_network(end)


def _middleware() -> Finding:
    check_middleware()
    return Finding('middleware', OK, 'RMW_IMPLEMENTATION names nothing that is missing')


def text_of(finding: Finding) -> str:
    """Return a line for one finding, and under it what to do."""
    lines = [f'{finding.level:8} {finding.name:{_NAME_WIDTH}}  {printable(finding.text)}']
    if finding.advice:
        lines.append(f'{"":8} {"":{_NAME_WIDTH}}  -> {printable(finding.advice)}')
    return '\n'.join(lines)


def summary_of(findings: list[Finding]) -> str:
    """Return the last line."""
    problems = sum(item.level == PROBLEM for item in findings)
    if not problems:
        return 'nodes can run here'
    return f'{problems} of {len(findings)} need mending'


def document_of(findings: list[Finding]) -> dict[str, object]:
    """Return the findings for machines."""
    return {
        'ok': all(item.level != PROBLEM for item in findings),
        'findings': [
            {'name': item.name, 'level': item.level, 'text': item.text, 'advice': item.advice}
            for item in findings
        ],
    }
