# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The changelog beside package.xml, which bloom reads, is the one of the repository."""

import re
from importlib.util import module_from_spec, spec_from_file_location

import occ_constraints_pkg


def test_is_generated_from_the_changelog_of_the_repository(root):
    spec = spec_from_file_location('changelog_rst', root / 'scripts' / 'changelog_rst.py')
    script = module_from_spec(spec)
    spec.loader.exec_module(script)
    text = (root / 'CHANGELOG.md').read_text(encoding='utf-8')
    written = (root / 'src' / 'occ_constraints_pkg' / 'CHANGELOG.rst').read_text(encoding='utf-8')
    assert written == script.changelog_rst(text), 'run python scripts/changelog_rst.py'
    # As catkin_pkg reads it: a version, its date, a line below.
    versions = re.findall(r'^(\d+\.\d+\.\d+) \(\d{4}-\d\d-\d\d\)\n-+$', written, re.MULTILINE)
    assert versions[0] == occ_constraints_pkg.__version__
    assert re.findall(r'^## (\d\S+)', text, re.MULTILINE) == versions
