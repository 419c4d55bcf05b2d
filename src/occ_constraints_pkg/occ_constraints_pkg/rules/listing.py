# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""A rule set as plain values: what ``occ show --json`` prints and the topic ``rules`` carries."""

from __future__ import annotations

import json
from typing import Any

from occ_constraints_pkg.errors import ConfigurationError
from occ_constraints_pkg.rules.constraints_file import read_rule_set, rule_set_document
from occ_constraints_pkg.rules.ruleset import RuleSet

# What a rule has on the topic ``rules`` beyond a constraints file; and there beyond the topic.
_LISTED, _COUNTED = ('formula',), ('evaluated', 'violated')


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


def rules_in_force_text(rule_set: RuleSet) -> str:
    """Return the JSON that the topic ``rules`` carries.

    It has what :func:`rules_document` returns and all that is needed to judge by the rules: the
    features, and the literals of each rule, both as in a constraints file.
    """
    document, whole = rules_document(rule_set), rule_set_document(rule_set)
    for listed, item in zip(document['rules'], whole['rules'], strict=True):
        listed.update({key: value for key, value in item.items() if key not in _COUNTED})
    return json.dumps({**document, 'features': whole['features']})


def read_rules_in_force(text: str, where: str) -> RuleSet:
    """Return the rule set of a message on the topic ``rules``.

    Args:
        text: see :func:`rules_in_force_text`.
        where: names the topic in messages.

    Raises:
        OccError: it is none, or one of an earlier release, which has no literals.
    """
    try:
        document = json.loads(text)
        rules = [
            {key: value for key, value in rule.items() if key not in _LISTED}
            for rule in document['rules']
        ]
        features = document['features']
    # Anybody may publish anything there.
    except (ValueError, TypeError, KeyError, AttributeError, RecursionError) as error:
        raise ConfigurationError(
            f'{where}: got a text without rules and features; allowed is what a monitor of this '
            'release publishes'
        ) from error
    return read_rule_set({'features': features, 'rules': rules}, where)
