# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The shared files as text, for whoever puts a page together or serves one.

- ``style.css``: colours for light and dark, tables, buttons, bands, charts.
- ``patterns.svg``: patterns that tell verdicts apart without colour.
- ``charts.js``: defines ``charts``, with helpers for elements and a line chart.
"""

from __future__ import annotations

from importlib import resources


def asset(name: str, package: str = __package__) -> str:
    """Return a file that is installed with a package.

    Args:
        name: of the file.
        package: that holds it; by default this one.
    """
    return resources.files(package).joinpath(name).read_text('utf-8')
