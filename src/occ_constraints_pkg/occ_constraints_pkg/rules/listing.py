# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""A rule set as plain values: what ``occ show --json`` prints and the topic ``rules`` carries."""

from __future__ import annotations

from typing import Any

from occ_constraints_pkg.rules.ruleset import RuleSet


def rules_document(rule_set: RuleSet) -> dict[str, Any]:
    """Return the fingerprint and a description of each rule, ready for JSON.

    Rules are in the order of the rule set, so their positions are those in ``costs``.
    """
    space = rule_set.space
    return {
        'rule_set': rule_set.fingerprint,
        'rules': [
            {
                'id': rule.id,
                'text': rule.words(space),
                'formula': rule.formula(space),
                'enabled': rule.enabled,
                'note': rule.note,
            }
            for rule in rule_set.rules
        ],
    }
