# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Write src/occ_constraints_pkg/CHANGELOG.rst, which bloom wants (REP 132), from CHANGELOG.md.

Usage: python scripts/changelog_rst.py. Released versions only: what is not released yet changes
with every commit, and is told by CHANGELOG.md alone.
"""

from __future__ import annotations

import re
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
SOURCE = ROOT / 'CHANGELOG.md'
TARGET = ROOT / 'src' / 'occ_constraints_pkg' / 'CHANGELOG.rst'
TITLE = 'Changelog for package occ_constraints_pkg'
_VERSION = re.compile(r'^## (\d+\.\d+\.\d+) \((\d{4}-\d\d-\d\d)\)$', re.MULTILINE)


def changelog_rst(text: str) -> str:
    """Return the released versions of a changelog in Markdown as reStructuredText."""
    bar = '^' * len(TITLE)
    parts = [f'{bar}\n{TITLE}\n{bar}\n']
    found = list(_VERSION.finditer(text))
    ends = [match.start() for match in found[1:]] + [len(text)]
    for match, end in zip(found, ends, strict=True):
        head = f'{match[1]} ({match[2]})'
        body = text[match.end() : end].strip()
        # A heading within a version is a line of its own there, not a section.
        body = re.sub(r'^### (.*)$', r'**\1**', body, flags=re.MULTILINE)
        body = re.sub(r'\[([^\]]+)\]\([^)]+\)', r'\1', body)
        body = re.sub(r'`([^`]+)`', r'``\1``', body)
        parts.append(f'{head}\n{"-" * len(head)}\n{re.sub("^- ", "* ", body, flags=re.M)}\n')
    return '\n'.join(parts)


if __name__ == '__main__':
    TARGET.write_text(changelog_rst(SOURCE.read_text(encoding='utf-8')), encoding='utf-8')
