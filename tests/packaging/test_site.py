# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The site of the documentation lists every page; `make docs` builds it and checks its links."""

import re
from importlib.util import module_from_spec, spec_from_file_location

import pytest


@pytest.fixture(scope='module')
def script(root):
    spec = spec_from_file_location('site_pages', root / 'scripts' / 'site_pages.py')
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope='module')
def pages(script, tmp_path_factory):
    target = tmp_path_factory.mktemp('site') / 'pages'
    script.write_pages(target)
    return target


def test_every_page_is_in_the_navigation(pages, root):
    text = (root / 'mkdocs.yml').read_text(encoding='utf-8')
    listed = re.findall(r'^ +- [^:]+: (\S+\.md)$', text.split('\nnav:\n')[1], re.MULTILINE)
    there = {page.relative_to(pages).as_posix() for page in pages.rglob('*.md')}
    assert sorted(listed) == sorted(there)


def test_links_between_pages_lead_somewhere_on_the_site(pages):
    for page in pages.rglob('*.md'):
        text = re.sub(r'```.*?```', '', page.read_text(encoding='utf-8'), flags=re.DOTALL)
        for target in re.findall(r'\]\((?!https?:|mailto:|#)([^)\s]+)\)', text):
            assert (page.parent / target.partition('#')[0]).is_file(), f'{page}: {target}'


def test_the_reference_is_generated_from_the_code(pages, nodes):
    reference = {page.stem: page.read_text() for page in (pages / 'reference').iterdir()}
    assert set(reference) == {'nodes', 'commands', 'python', 'files'}
    assert all(f'## {node}\n' in reference['nodes'] for node in nodes)
    assert '## occ features suggest\n' in reference['commands']
    assert '## load_feature_map\n' in reference['python']
    assert '| `features[].topic` |' in reference['files']


def test_pages_say_whether_their_commands_are_run(pages):
    for name, note in (('index.md', 'are run by'), ('nav2.md', 'do not run them')):
        assert note in (pages / name).read_text(encoding='utf-8').splitlines()[-1]
    assert 'run' not in (pages / 'glossary.md').read_text(encoding='utf-8').splitlines()[-1]
