# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The package is whole: its version, its nodes, its header in every file."""

import ast
import importlib
import re
from pathlib import Path
from xml.etree import ElementTree

import pytest
from occ_constraints_pkg.nodes import NODES

import occ_constraints_pkg

# Beside this folder while it is built and tested from its sources.
PACKAGE = Path(__file__).resolve().parents[1]
HEADER = '# Copyright 2026 The occ_constraints developers\n# SPDX-License-Identifier: Apache-2.0\n'
FOLDERS = sorted(
    path.name
    for path in (PACKAGE / 'occ_constraints_pkg').iterdir()
    if (path / '__init__.py').is_file()
)
# Of what monitor and gate need.
GROUND = [
    'errors',
    'files',
    'documents',
    'stopping',
    'rules',
    'rules.ruleset',
    'rules.gating',
    'rules.constraints_file',
    'features',
    'features.feature_map',
    'features.extractor',
    'features.table',
]


def test_versions_agree():
    manifest = ElementTree.parse(PACKAGE / 'package.xml').getroot()
    assert manifest.findtext('version') == occ_constraints_pkg.__version__
    assert manifest.findtext('export/build_type') == 'ament_python'


@pytest.mark.parametrize('node', NODES)
def test_a_node_has_its_script_and_its_parameters(node):
    script = PACKAGE / 'scripts' / node
    assert f"run('{node}', sys.argv[1:])" in script.read_text()
    assert f'\n/**/{node}:\n' in (PACKAGE / 'config' / 'params.yaml').read_text()
    assert f"'{node}'," in (PACKAGE / 'setup.py').read_text()


@pytest.mark.parametrize('module', GROUND)
def test_the_ground_loads_with_packages_of_apt_only(module):
    assert importlib.import_module(f'occ_constraints_pkg.{module}').__doc__


@pytest.mark.parametrize('folder', [*FOLDERS, '.'])
def test_every_file_tells_its_licence_and_what_it_is(folder):
    top = PACKAGE / 'occ_constraints_pkg' / folder
    files = top.glob('*.py') if folder == '.' else top.rglob('*.py')
    for path in files:
        text = path.read_text(encoding='utf-8')
        # ament_copyright knows whole licence texts only, not SPDX identifiers.
        assert text.startswith(HEADER), path
        assert ast.get_docstring(ast.parse(text)), path


@pytest.mark.parametrize('name', sorted(path.name for path in (PACKAGE / 'launch').iterdir()))
def test_a_launch_file_is_described(name):
    text = (PACKAGE / 'launch' / name).read_text(encoding='utf-8')
    assert text.startswith(HEADER)
    assert re.search(r'^def generate_launch_description', text, re.MULTILINE)
