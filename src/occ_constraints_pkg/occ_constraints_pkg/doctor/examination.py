# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The whole examination, in a bounded time, and its text."""

from __future__ import annotations

import time
from functools import partial
from pathlib import Path

from occ_constraints_pkg.doctor import local
from occ_constraints_pkg.doctor.findings import NOTE, OK, PROBLEM, Finding, examined
from occ_constraints_pkg.doctor.network import examine_network
from occ_constraints_pkg.ros.environment import check_middleware
from occ_constraints_pkg.terminal import printable

# All but the processes at the end takes less than a second.
_SECONDS = 9.0


def examine(bags: Path) -> list[Finding]:
    """Look at all that nodes need.

    Args:
        bags: folder that recordings are to be written to.
    """
    end = time.monotonic() + _SECONDS
    checks = {
        'python': local.python,
        'package': local.package,
        'extra train': partial(local.extra, 'train'),
        'extra report': partial(local.extra, 'report'),
        'disk': partial(local.disk, bags),
        'clock': local.clock,
        'ROS packages': local.ros_packages,
        'domain': local.domain,
        'memory': local.memory,
        'logs': local.logs,
        'middleware': _middleware,
    }
    findings = [examined(name, check) for name, check in checks.items()]
    found = {item.name: item.level for item in findings}
    needed = ('ROS packages', 'domain', 'memory', 'logs', 'middleware', 'clock')
    if PROBLEM in (found[name] for name in needed):
        text = 'not tried, for what stands above would let it fail'
        return [*findings, Finding('discovery', NOTE, text, 'solve that first')]
    return [*findings, *examine_network(end)]


def _middleware() -> Finding:
    check_middleware()
    return Finding('middleware', OK, 'RMW_IMPLEMENTATION names nothing that is missing')


def text_of(findings: list[Finding]) -> str:
    """Return a line for each finding, and under it what to do."""
    width = max(len(item.name) for item in findings)
    lines = []
    for item in findings:
        lines.append(f'{item.level:8} {item.name:{width}}  {printable(item.text)}')
        if item.advice:
            lines.append(f'{"":8} {"":{width}}  -> {printable(item.advice)}')
    problems = sum(item.level == PROBLEM for item in findings)
    lines.append(
        'nodes can run here' if not problems else f'{problems} of {len(findings)} need mending'
    )
    return '\n'.join(lines)


def document_of(findings: list[Finding]) -> dict[str, object]:
    """Return the findings for machines."""
    return {
        'ok': all(item.level != PROBLEM for item in findings),
        'findings': [
            {'name': item.name, 'level': item.level, 'text': item.text, 'advice': item.advice}
            for item in findings
        ],
    }
