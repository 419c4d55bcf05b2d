# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The page of claims names tests that exist, and figures as they were recorded."""

import sys
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]


@pytest.fixture(scope='module')
def script():
    spec = spec_from_file_location('claims', ROOT / 'scripts' / 'claims.py')
    module = module_from_spec(spec)
    # Dataclasses look their module up.
    sys.modules['claims'] = module
    yield spec.loader.exec_module(module) or module
    del sys.modules['claims']


def test_every_claim_names_tests_that_are_there(script):
    assert [test for claim in script.CLAIMS for test in claim.missing()] == []
    assert all(claim.tests for claim in script.CLAIMS)


def test_the_page_is_up_to_date(script):
    written = (ROOT / 'docs' / 'claims.md').read_text(encoding='utf-8')
    assert written == script.page(), 'run python scripts/claims.py'
