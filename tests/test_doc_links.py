# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""What the documentation names is there: links, headings, files, modules, commands."""

import re
from pathlib import Path

import pytest
from occ_constraints_pkg.cli.commands import cli

import occ_constraints_pkg

ROOT = Path(__file__).parents[1]
PACKAGE = Path(occ_constraints_pkg.__file__).parent
PAGES = sorted(
    {
        *ROOT.glob('*.md'),
        *ROOT.glob('docs/**/*.md'),
        *ROOT.glob('docker/*.md'),
        *ROOT.glob('bags/*/*.md'),
        *PACKAGE.rglob('*.md'),
    }
)
# The changelog tells what things were called.
PAGES_OF_TODAY = [page for page in PAGES if page.name != 'CHANGELOG.md']
# Where a path may begin that is not meant from the page itself.
BASES = (ROOT, PACKAGE, PACKAGE.parent, ROOT / 'docs')


def name_of(page):
    return str(page.relative_to(ROOT))


def headings(page):
    """Return the anchors that GitHub gives to the headings of a page."""
    text = re.sub(r'```.*?```', '', page.read_text(encoding='utf-8'), flags=re.DOTALL)
    titles = re.findall(r'^#+ (.+)$', text, flags=re.MULTILINE)
    return {re.sub(r'[^\w\- ]', '', title.lower()).replace(' ', '-') for title in titles}


@pytest.mark.parametrize('page', PAGES, ids=name_of)
def test_links_lead_somewhere(page):
    targets = re.findall(r'\]\((?!https?:)([^)\s]+)\)', page.read_text(encoding='utf-8'))
    for target in targets:
        path, _, anchor = target.partition('#')
        aim = page.parent / path if path else page
        assert aim.exists(), target
        assert not anchor or anchor in headings(aim), target


@pytest.mark.parametrize('page', PAGES_OF_TODAY, ids=name_of)
def test_files_in_the_text_are_there(page):
    text = page.read_text(encoding='utf-8')
    for path in re.findall(r'`((?:\w+/)+[\w.]+\.(?:py|json|xml|yaml))`', text):
        begins = any((base / path.partition('/')[0]).is_dir() for base in BASES)
        is_there = any((base / path).exists() for base in BASES)
        assert is_there or not begins or 'NAME' in path, path


@pytest.mark.parametrize('page', PAGES_OF_TODAY, ids=name_of)
def test_commands_in_the_text_are_there(page):
    text = page.read_text(encoding='utf-8')
    for name in re.findall(r'(?:^|`)occ\s([a-z]+)', text, re.MULTILINE):
        assert name in cli.commands, f'occ {name}'
    for tool, name in re.findall(r'python -m\s(experiments|benchmarks)\s([a-z_]+)', text):
        module = ROOT / tool / name
        assert module.is_dir() or module.with_suffix('.py').is_file(), f'{tool} {name}'


def test_the_glossary_names_modules_that_are_there():
    text = (ROOT / 'docs' / 'glossary.md').read_text(encoding='utf-8')
    rows = [line.split(' | ') for line in text.splitlines() if line.startswith('| ')]
    for row in rows[1:]:
        for module in re.findall(r'`([\w.]+)`', row[3]):
            path = PACKAGE / module.replace('.', '/')
            assert path.is_dir() or path.with_suffix('.py').is_file(), f'{row[0]}: {module}'


def test_the_glossary_is_in_alphabetical_order():
    text = (ROOT / 'docs' / 'glossary.md').read_text(encoding='utf-8')
    terms = [term.lower() for term in re.findall(r'^\| ([^|]+) \|', text, re.MULTILINE)][1:]
    assert terms == sorted(terms)
