# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The section with the rules: in words, with evidence, and with bounds to try others."""

from __future__ import annotations

import io
from typing import Any

import numpy as np

from occ_constraints_pkg.errors import MissingDependencyError, import_needed
from occ_constraints_pkg.learning.evidence import describe_why, why_document
from occ_constraints_pkg.learning.rules_text import describe_guarantee
from occ_constraints_pkg.report.page import (
    Page,
    Section,
    facts_section,
    picture_section,
    render,
    table_section,
)
from occ_constraints_pkg.report.subjects import Subjects, rules_data
from occ_constraints_pkg.rules.constraints_file import Constraints
from occ_constraints_pkg.rules.rule import Rule

_PICTURE_DOTS = 110
# Each rule that people look at costs a few hundred bytes; of more, the rest is in the file.
_MOST_RULES = 500


def add_rules(
    page: Page,
    constraints: Constraints,
    *,
    samples: np.ndarray | None = None,
    is_judged: bool = False,
) -> None:
    """Add the rules, how they were learned, and a picture of them.

    Args:
        page: where.
        constraints: the rules and their evidence.
        samples: (n, k) demonstrations for the density in the picture; ``None`` if not at hand.
        is_judged: whether recordings on the page were judged by them, so that other bounds can be
            tried.
    """
    rule_set = constraints.rule_set
    subjects = Subjects(rule_set)
    ordered = sorted(rule_set.rules, key=lambda rule: (not rule.enabled, len(rule.literals)))
    entries = [_entry(constraints, subjects, rule) for rule in ordered[:_MOST_RULES]]
    body = render(
        'rules.html.j2',
        rules=entries,
        left_out=max(0, len(ordered) - _MOST_RULES),
        guarantee=describe_guarantee(constraints),
        coverage=constraints.coverage,
        is_judged=is_judged,
    )
    page.add(Section('Rules', body, 'rules'))
    page.data['rules'] = rules_data(rule_set, subjects)
    page.data['columns'] = subjects.document()
    words = 'Bounds on each feature'
    if any(len(rule.literals) > 1 for rule in rule_set.rules):
        words += ', and the corner that each rule with conditions forbids'
    try:
        picture = _picture(constraints, samples)
    except MissingDependencyError as missing:
        # The base installation draws no pictures; all else of a page needs none.
        page.add(Section('Picture of the rules', render('note.html.j2', words=missing), 'picture'))
    else:
        page.add(picture_section('Picture of the rules', picture, words, id='picture'))


def add_provenance(page: Page, constraints: Constraints) -> None:
    """Add where the rules come from: recordings with their hashes, settings, versions."""
    facts = {
        **{key: value for key, value in constraints.provenance.items() if key != 'bags'},
        'edited by people': constraints.is_edited,
        **constraints.learner,
    }
    page.add(facts_section('How the rules were learned', facts, id='provenance'))
    bags = constraints.provenance.get('bags', ())
    if bags:
        names = list(dict.fromkeys(name for bag in bags for name in bag))
        rows = [[bag.get(name, '') for name in names] for bag in bags]
        titles = [{'sha256': 'SHA-256'}.get(name, name.replace('_', ' ')) for name in names]
        page.add(table_section('Demonstrations', titles, rows, id='demonstrations'))


def _entry(constraints: Constraints, subjects: Subjects, rule: Rule) -> dict[str, Any]:
    space = constraints.space
    why = why_document(constraints, rule.id)
    return {
        'place': constraints.rules.index(rule),
        'rule': rule,
        'words': rule.words(space),
        'why': why,
        'evidence': describe_why(why),
        'bounds': [
            {
                'place': place,
                'name': literal.name(space),
                'operator': literal.operator,
                'bound': repr(float(literal.bound)),
                'unit': '' if space.features[literal.members[0]].unit == '1'
                else space.features[literal.members[0]].unit,
            }
            for place, literal in enumerate(rule.literals)
        ],
    }  # fmt: skip


def _picture(constraints: Constraints, samples: np.ndarray | None) -> bytes:
    pictures = import_needed('This picture', 'occ_constraints_pkg.learning.rules_picture')
    pyplot = import_needed('This picture', 'matplotlib.pyplot')
    figure = pictures.rules_figure(constraints, samples)
    try:
        stream = io.BytesIO()
        figure.savefig(stream, dpi=_PICTURE_DOTS, format='png')
    finally:
        pyplot.close(figure)
    return stream.getvalue()
