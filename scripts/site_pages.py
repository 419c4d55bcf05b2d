# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Write the pages of the documentation's site to build/pages: those of docs/, and a reference.

Usage: python scripts/site_pages.py, in the environment that has the package. The pages at the top
of the repository come beside those of docs/, and the reference is generated from the code.
"""

from __future__ import annotations

import inspect
import json
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from importlib import resources
from pathlib import Path

import click
from occ_constraints_pkg.cli.commands import cli
from occ_constraints_pkg.nodes import NODES

import occ_constraints_pkg as occ

ROOT = Path(__file__).resolve().parents[1]
DOCS = ROOT / 'docs'
TARGET = ROOT / 'build' / 'pages'
# Pages at the top of the repository, and what they are called here.
TOP = {
    'README.md': 'index.md',
    'CONTRIBUTING.md': 'contributing.md',
    'CHANGELOG.md': 'changelog.md',
    'QUALITY_DECLARATION.md': 'quality_declaration.md',
    'SECURITY.md': 'security.md',
}
_SCHEMAS = {
    'Feature map': ('occ_constraints_pkg.features', 'feature_map.schema.json'),
    'Manifest': ('occ_constraints_pkg.datasets', 'manifest.schema.json'),
    'Constraints file': ('occ_constraints_pkg.rules', 'constraints.schema.json'),
}
_LINK = re.compile(r'(!?)\[([^\]]*)\]\((?!https?:|mailto:|#)([^)\s]+)\)')
# Notes below pages with commands: what tests do with them.
_RUN = '*Commands whose output is shown here are run by `tests/test_shown_output.py`.*'
_NOT_RUN = '*Tests check that the commands on this page exist, and do not run them.*'
_FENCE = re.compile(r'(```.*?```)', re.DOTALL)


def write_pages(folder: Path = TARGET) -> None:
    """Write all pages anew to a folder."""
    shutil.rmtree(folder, ignore_errors=True)
    shutil.copytree(DOCS, folder)
    for page in sorted(DOCS.rglob('*.md')):
        _copy(page, page.relative_to(DOCS), folder)
    for name, other in TOP.items():
        _copy(ROOT / name, Path(other), folder)
    reference = {
        'nodes.md': _nodes(),
        'commands.md': _commands(),
        'python.md': _python(),
        'files.md': _files(),
    }
    (folder / 'reference').mkdir()
    for name, parts in reference.items():
        text = '\n\n'.join(parts) + '\n'
        (folder / 'reference' / name).write_text(text, encoding='utf-8')


def _copy(source: Path, page: Path, folder: Path) -> None:
    """Copy a page to a path below a folder; links to what is not on the site become text."""

    def moved(match: re.Match[str]) -> str:
        mark, words, link = match.groups()
        path, _, anchor = link.partition('#')
        aim = (source.parent / path).resolve()
        if aim.is_relative_to(DOCS) and aim.is_file():
            there = aim.relative_to(DOCS).as_posix()
        elif aim.parent == ROOT and aim.name in TOP:
            there = TOP[aim.name]
        else:
            return words
        up = '../' * len(page.parent.parts)
        return f'{mark}[{words}]({up}{there}{"#" + anchor if anchor else ""})'

    text = source.read_text(encoding='utf-8')
    if '```sh' in text:
        shown = (ROOT / 'tests' / 'test_shown_output.py').read_text(encoding='utf-8')
        is_run = repr(source.name) in shown
        text += f'\n{_RUN if is_run else _NOT_RUN}\n'
    parts = _FENCE.split(text)
    # Code keeps its brackets.
    parts[::2] = [_LINK.sub(moved, part) for part in parts[::2]]
    (folder / page).write_text(''.join(parts), encoding='utf-8')


def _nodes() -> Iterator[str]:
    yield '# Parameters of the nodes'
    yield 'What `occ node NAME --help` prints. [Nodes and topics](../nodes.md) says what they mean.'
    for name in NODES:
        done = subprocess.run(
            [sys.executable, '-m', 'occ_constraints_pkg', 'node', name, '--help'],
            capture_output=True,
            text=True,
            check=True,
            cwd=ROOT,
        )
        yield f'## {name}\n\n```text\n{done.stdout.strip()}\n```'


def _commands() -> Iterator[str]:
    yield '# Commands'
    yield 'What `occ COMMAND --help` prints.'
    for words, command in _each(cli, 'occ'):
        with click.Context(command, info_name=words) as context:
            yield f'## {words}\n\n```text\n{command.get_help(context)}\n```'


def _each(command: click.Command, words: str) -> Iterator[tuple[str, click.Command]]:
    yield words, command
    if isinstance(command, click.Group):
        for name in command.list_commands(click.Context(command)):
            yield from _each(command.get_command(click.Context(command), name), f'{words} {name}')


def _python() -> Iterator[str]:
    yield '# Python'
    yield '`import occ_constraints_pkg as occ` gives these names; the tests run each example.'
    for name in sorted(occ.__all__):
        value = getattr(occ, name)
        doc = inspect.getdoc(value) or ''
        if not callable(value):
            continue
        try:
            signature = str(inspect.signature(value))
        except ValueError:
            signature = ''
        yield f'## {name}\n\n```python\nocc.{name}{signature}\n```\n\n```text\n{doc}\n```'


def _files() -> Iterator[str]:
    yield '# Keys of files'
    yield (
        'From the schemas that files are checked against. What they mean is in [feature maps]'
        '(../feature_map.md), [constraints file](../constraints_file.md) and [data](../data.md).'
    )
    for title, (package, name) in _SCHEMAS.items():
        path = resources.files(package).joinpath(name)
        schema = json.loads(path.read_text(encoding='utf-8'))
        rows = [f'| `{key}` | {kind} | {text} |' for key, kind, text in _keys(schema, schema, '')]
        yield f'## {title}\n\n| key | value | meaning |\n|---|---|---|\n' + '\n'.join(rows)


def _keys(
    part: dict, schema: dict, prefix: str, within: tuple[str, ...] = ()
) -> Iterator[tuple[str, str, str]]:
    """Yield path, kind and description of each key of a schema, those of lists and trees once."""
    part, within = _resolved(part, schema, within)
    for key, value in part.get('properties', {}).items():
        again = value.get('$ref') in within
        value, inner = _resolved(value, schema, within)
        kind = value.get('type', 'one of several' if {'anyOf', 'oneOf'} & set(value) else '')
        kind = ' or '.join(kind) if isinstance(kind, list) else str(kind)
        if 'enum' in value:
            kind = ', '.join(f'`{item}`' for item in value['enum'])
        text = ' '.join(str(value.get('description', '')).split()).replace('|', '\\|')
        yield f'{prefix}{key}', kind, text
        items = value.get('items')
        if 'properties' in value and not again:
            yield from _keys(value, schema, f'{prefix}{key}.', inner)
        elif isinstance(items, dict) and items.get('$ref') not in inner:
            yield from _keys(items, schema, f'{prefix}{key}[].', inner)


def _resolved(part: dict, schema: dict, within: tuple[str, ...]) -> tuple[dict, tuple[str, ...]]:
    """Return what a reference stands for, and the references that lead there."""
    while '$ref' in part:
        found: dict = schema
        within = (*within, part['$ref'])
        for step in part['$ref'].removeprefix('#/').split('/'):
            found = found[step]
        part = {**found, **{key: value for key, value in part.items() if key != '$ref'}}
    return part, within


if __name__ == '__main__':
    write_pages()
