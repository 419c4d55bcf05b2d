# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Edits of a rule set: rules enabled or disabled, bounds moved."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

from occ_constraints_pkg.documents import did_you_mean
from occ_constraints_pkg.errors import ConfigurationError, OccError
from occ_constraints_pkg.rules.rule import Literal, Rule
from occ_constraints_pkg.rules.ruleset import RuleSet
from occ_constraints_pkg.rules.space import FeatureSpace

_BOUND = re.compile(r'\s*(\S+)\s*:\s*(any\s+\S+|\S+)\s*(<=|>=|<|>)\s*(\S+)\s*')
_BOUND_FORM = (
    "'RULE: FEATURE OPERATOR NUMBER', such as 'R41297: d_l2 > 0.9' or, for a family, "
    "'R41297: any d_l > 0.9'"
)


@dataclass(frozen=True)
class MovedBound:
    """Another bound for the literal of a rule with this feature and operator.

    Attributes:
        rule: the rule's id.
        feature: the feature's name; ``any`` and a family's name for a literal about that.
        operator: as in the rule.
        bound: the new bound.
    """

    rule: str
    feature: str
    operator: str
    bound: float


@dataclass(frozen=True)
class RuleEdits:
    """Edits to apply to a rule set as loaded.

    Attributes:
        disabled: ids of rules to disable.
        enabled: ids of rules to enable.
        bounds: bounds to move.

    Raises:
        ConfigurationError: a rule is to be both enabled and disabled, or a bound to be moved twice.
    """

    disabled: tuple[str, ...] = ()
    enabled: tuple[str, ...] = ()
    bounds: tuple[MovedBound, ...] = ()

    def __post_init__(self) -> None:
        both = sorted(set(self.disabled) & set(self.enabled))
        if both:
            raise ConfigurationError(
                f'rule {both[0]!r} is to be enabled and disabled; allowed is one of them'
            )
        moved = [(item.rule, item.feature, item.operator) for item in self.bounds]
        twice = next((one for one in moved if moved.count(one) > 1), None)
        if twice is not None:
            rule, feature, operator = twice
            raise ConfigurationError(
                f'the bound {feature} {operator} of rule {rule!r} is to be moved twice; allowed is '
                'once'
            )

    @classmethod
    def parse(
        cls, disabled: Sequence[str], enabled: Sequence[str], bounds: Sequence[str]
    ) -> RuleEdits:
        """Read the edits; each of ``bounds`` is like ``R41297: d_l2 > 0.9``.

        Raises:
            ConfigurationError: a text is of another form, or the edits contradict each other.
        """
        return cls(tuple(disabled), tuple(enabled), tuple(_bound(text) for text in bounds))

    def apply(self, rule_set: RuleSet) -> RuleSet:
        """Return the rule set with these changes; the same object if there are none.

        Raises:
            ConfigurationError: there is no such rule or literal, or a rule could never be true.
        """
        if self == RuleEdits():
            return rule_set
        ids = [rule.id for rule in rule_set.rules]
        for name in (*self.disabled, *self.enabled, *(item.rule for item in self.bounds)):
            if name not in ids:
                hint = did_you_mean(name, ids) or ';'
                raise ConfigurationError(
                    f'there is no rule {name!r}{hint} the rules are {", ".join(ids)}'
                )
        rules = tuple(self._rule(rule, rule_set.space) for rule in rule_set.rules)
        return replace(rule_set, rules=rules)

    def within(self, rule_set: RuleSet) -> RuleEdits:
        """Return those of the edits that can be applied to a rule set."""
        literals = {
            (rule.id, literal.name(rule_set.space), literal.operator)
            for rule in rule_set.rules
            for literal in rule.literals
        }
        ids = {rule.id for rule in rule_set.rules}
        return RuleEdits(
            tuple(name for name in self.disabled if name in ids),
            tuple(name for name in self.enabled if name in ids),
            tuple(
                item for item in self.bounds if (item.rule, item.feature, item.operator) in literals
            ),
        )

    def _rule(self, rule: Rule, space: FeatureSpace) -> Rule:
        is_enabled = (rule.enabled or rule.id in self.enabled) and rule.id not in self.disabled
        literals = rule.literals
        for item in self.bounds:
            if item.rule == rule.id:
                literals = _moved(rule.id, literals, item, space)
        return replace(rule, enabled=is_enabled, literals=literals)


def _moved(
    name: str, literals: tuple[Literal, ...], item: MovedBound, space: FeatureSpace
) -> tuple[Literal, ...]:
    fits = [
        literal.name(space) == item.feature and literal.operator == item.operator
        for literal in literals
    ]
    if not any(fits):
        own = ', '.join(f'{one.name(space)} {one.operator}' for one in literals)
        raise ConfigurationError(
            f'rule {name!r} has no literal {item.feature} {item.operator}; it has {own}'
        )
    return tuple(
        replace(literal, bound=item.bound) if fit else literal
        for literal, fit in zip(literals, fits, strict=True)
    )


def _bound(text: str) -> MovedBound:
    found = _BOUND.fullmatch(text)
    try:
        if found is None:
            raise ValueError(text)
        rule, feature, operator, number = found.groups()
        bound = Literal(0, operator, float(number)).bound
        return MovedBound(rule, ' '.join(feature.split()), operator, bound)
    except (ValueError, OccError):
        raise ConfigurationError(f'a moved bound is {text!r}; allowed is {_BOUND_FORM}') from None
