# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Links of the documentation to files and headings of this repository."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PAGES = sorted({*ROOT.glob('*.md'), *ROOT.glob('docs/*.md'), *ROOT.glob('docker/*.md')})


def headings(page):
    """Return the anchors that GitHub gives to the headings of a page."""
    text = re.sub(r'```.*?```', '', page.read_text(encoding='utf-8'), flags=re.DOTALL)
    titles = re.findall(r'^#+ (.+)$', text, flags=re.MULTILINE)
    return {re.sub(r'[^\w\- ]', '', title.lower()).replace(' ', '-') for title in titles}


@pytest.mark.parametrize('page', PAGES, ids=lambda page: page.name)
def test_links_lead_somewhere(page):
    targets = re.findall(r'\]\((?!https?:)([^)\s]+)\)', page.read_text(encoding='utf-8'))
    for target in targets:
        path, _, anchor = target.partition('#')
        aim = page.parent / path if path else page
        assert aim.exists(), target
        assert not anchor or anchor in headings(aim), target
