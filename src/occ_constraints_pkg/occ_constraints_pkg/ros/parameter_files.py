# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Which parameters a parameter file of ROS sets for which node; needs nothing but Python."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any


def names_of_sections(content: Any, node: str, key: str = '') -> Iterator[str]:
    """Yield the names of parameters in the sections that name a node.

    Args:
        content: of a parameter file.
        node: its full name.
        key: under which ``content`` stands in the file.
    """
    if not isinstance(content, dict):
        return
    for part, value in content.items():
        if part != 'ros__parameters':
            yield from names_of_sections(value, node, f'{key}/{part}')
        elif _names(key, node):
            yield from _flat(value, '')


def names_for_any_node(content: Any) -> Iterator[str]:
    """Yield the names of parameters in the sections ``/**``, which hold for every node."""
    for key, section in content.items() if isinstance(content, dict) else ():
        if isinstance(key, str) and key.strip('/') == '**' and isinstance(section, dict):
            yield from _flat(section.get('ros__parameters'), '')


def _names(key: str, node: str) -> bool:
    """Return whether the key of a section means a node, and no other one of its namespace."""
    parts = [part for part in key.split('/') if part]
    patterns = {'**': '(/[^/]+)*', '*': '/[^/]+'}
    pattern = ''.join(patterns.get(part, f'/{re.escape(part)}') for part in parts)
    return bool(parts) and parts[-1] not in patterns and bool(re.fullmatch(pattern, node))


def _flat(content: Any, prefix: str) -> Iterator[str]:
    if not isinstance(content, dict):
        yield prefix
        return
    for part, value in content.items():
        yield from _flat(value, f'{prefix}.{part}' if prefix else str(part))
