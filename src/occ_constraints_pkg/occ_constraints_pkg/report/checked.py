# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The page of a constraints file, with recordings judged by it or without."""

from __future__ import annotations

import platform
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from occ_constraints_pkg import __version__
from occ_constraints_pkg.checking.timeline import BRIDGE_SECONDS, Timeline
from occ_constraints_pkg.files import sha256_of
from occ_constraints_pkg.report.page import Page, facts_section, table_section
from occ_constraints_pkg.report.recordings import add_recordings, summarize
from occ_constraints_pkg.report.rules import add_provenance, add_rules
from occ_constraints_pkg.rules.constraints_file import Constraints


def constraints_page(
    title: str,
    path: str | Path,
    constraints: Constraints,
    *,
    timeline: Timeline | None = None,
    samples: np.ndarray | None = None,
    sources: Sequence[Mapping[str, Any]] = (),
    bridge: float = BRIDGE_SECONDS,
    settings: Mapping[str, Any] | None = None,
) -> Page:
    """Return a page with rules, and with recordings that were judged by them.

    Args:
        title: of the page.
        path: the constraints file.
        constraints: what is in it.
        timeline: the recordings, judged by these rules; ``None`` for none.
        samples: (n, k) demonstrations, for their density in the picture of the rules.
        sources: where the samples come from, as :attr:`Dataset.sources`.
        bridge: of :func:`check_data` when the recordings were judged.
        settings: how the recordings were judged, by name.
    """
    page = Page(title)
    judged = () if timeline is None else timeline.data.sources
    if timeline is not None:
        summarize(page, timeline)
        add_recordings(page, timeline, constraints.rule_set, bridge=bridge)
    add_rules(page, constraints, samples=samples, is_judged=timeline is not None)
    add_provenance(page, constraints)
    read = [
        ('rules', Path(path).name, sha256_of([Path(path)])),
        *(('judged', item['name'], item.get('sha256', 'not computed')) for item in judged),
        *(('demonstrations', item['name'], item.get('sha256', '')) for item in sources),
    ]
    page.add(table_section('Inputs of this page', ['what', 'name', 'SHA-256'], read, id='inputs'))
    page.add(
        facts_section(
            'Settings and versions',
            {
                **(settings or {}),
                'fingerprint of the rules': constraints.rule_set.fingerprint,
                'occ_constraints': __version__,
                'Python': platform.python_version(),
                'NumPy': np.__version__,
            },
            id='versions',
        )
    )
    return page
