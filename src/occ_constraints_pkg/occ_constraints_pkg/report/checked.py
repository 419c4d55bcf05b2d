# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The page of a constraints file, with recordings judged by it or without."""

from __future__ import annotations

import numpy as np

from occ_constraints_pkg.checking.timeline import Timeline
from occ_constraints_pkg.report.page import Page
from occ_constraints_pkg.report.recordings import add_recordings, summarize
from occ_constraints_pkg.report.rules import add_provenance, add_rules
from occ_constraints_pkg.rules.constraints_file import Constraints


def constraints_page(
    title: str,
    constraints: Constraints,
    *,
    timeline: Timeline | None = None,
    samples: np.ndarray | None = None,
) -> Page:
    """Return a page with rules, and with recordings that were judged by them.

    Args:
        title: of the page.
        constraints: the rules.
        timeline: the recordings, judged by these rules; ``None`` for none.
        samples: (n, k) demonstrations, for their density in the picture of the rules.
    """
    page = Page(title)
    if timeline is not None:
        summarize(page, timeline)
        add_recordings(page, timeline, constraints.rule_set)
    add_rules(page, constraints, samples=samples, is_judged=timeline is not None)
    add_provenance(page, constraints)
    return page
