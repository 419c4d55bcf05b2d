# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Sites of the page, which end with the test."""

import pytest
from sites import Site


@pytest.fixture
def make_site():
    """Return a function that returns a :class:`Site`."""
    pytest.importorskip('uvicorn', reason="needs the extra 'dashboard'")
    sites = []

    def make(*args, **options):
        sites.append(Site(*args, **options))
        return sites[-1]

    yield make
    for site in sites:
        site.close()


@pytest.fixture
def site(make_site):
    """Return a :class:`Site` that is read-only."""
    return make_site()
