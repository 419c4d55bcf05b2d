# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""A browser for the tests of pages."""

import os
import shutil

import pytest

# Without this variable, a machine without a browser skips the tests that need one.
REQUIRED = 'OCC_REQUIRE_BROWSER'


# Not for the whole session: while it is there, its event loop runs in this thread, and tests fail
# that run one of their own.
@pytest.fixture(scope='module')
def browser():
    """Yield Debian's Chromium, one for all tests of a module."""
    path = shutil.which('chromium') or shutil.which('chromium-browser')
    try:
        from playwright.sync_api import sync_playwright
    except ModuleNotFoundError:
        sync_playwright = None
    missing = 'playwright' if sync_playwright is None else '' if path else 'Chromium'
    if missing:
        if os.environ.get(REQUIRED) == '1':
            pytest.fail(f'{missing} is not installed, and {REQUIRED}=1 requires it')
        pytest.skip(f'{missing} is not installed')
    with sync_playwright() as playwright:
        launched = playwright.chromium.launch(executable_path=path, args=['--no-sandbox'])
        yield launched
        launched.close()
