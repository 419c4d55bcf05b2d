# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""What a user may choose about conditional rules."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

from occ_constraints_pkg.errors import ConfigurationError
from occ_constraints_pkg.learning.settings import OCTreeSettings

CONDITIONS = ('none', 'pairs', 'triples')


@dataclass(frozen=True)
class ConditionalSettings:
    """Settings of the learner of conditional rules; one default for all data.

    Attributes:
        conditions: ``triples`` for rules about two or three features (or gaps of one), ``pairs``
            for those about two only; ``none`` for none, and the box as the tree learner found it.
        apart: pairs of names, of features or families, that no rule may combine.
        delta: chance that there is any false rule, over everything that is looked at.
        most_rules: conditional rules at most.
        outside: share of the time that a safe episode may spend beyond a bound at the
            demonstrated minimum or maximum, over all bounds; they are moved outward for that.
            ``None`` moves none.

    Raises:
        ConfigurationError: a value is not allowed.
    """

    conditions: str = 'triples'
    apart: tuple[tuple[str, ...], ...] = ()
    delta: float = 0.005
    most_rules: int = 16
    outside: float | None = 0.005

    def __post_init__(self) -> None:
        if self.conditions not in CONDITIONS:
            raise ConfigurationError(
                f'conditions is {self.conditions!r}; allowed are {", ".join(CONDITIONS)}'
            )
        if not 0.0 < self.delta < 1.0:
            raise ConfigurationError(f'delta is {self.delta}; allowed is 0 < delta < 1')
        if self.most_rules < 0:
            raise ConfigurationError(f'most_rules is {self.most_rules}; allowed is 0 or more')
        if self.outside is not None and not 0.0 < self.outside < 1.0:
            raise ConfigurationError(f'outside is {self.outside}; allowed is 0 < outside < 1')
        for pair in self.apart:
            if len(pair) != 2:
                raise ConfigurationError(f'apart names {pair}; allowed are pairs of names')

        if self.apart and not self.looks:
            raise ConfigurationError(
                'apart has no effect with conditions none; allowed with it are pairs and triples'
            )

    @property
    def looks(self) -> bool:
        """Whether conditional rules are looked for at all."""
        return self.conditions != 'none'

    def keeping_apart(self, pairs: Sequence[tuple[str, ...]]) -> ConditionalSettings:
        """Return settings that keep more pairs apart; the same where nothing is combined."""
        return replace(self, apart=(*self.apart, *pairs)) if self.looks else self

    def document(self) -> dict[str, Any]:
        """Return the settings as plain values."""
        return {**asdict(self), 'apart': [list(pair) for pair in self.apart]}


def chosen_conditions(
    conditions: str | None, apart: Sequence[tuple[str, ...]]
) -> ConditionalSettings | None:
    """Return the settings that a user chose, ``None`` for the default.

    Args:
        conditions: one of :data:`CONDITIONS`, ``None`` if the user did not say.
        apart: pairs of names, of features or families.

    Raises:
        ConfigurationError: a value is not allowed.
    """
    if conditions is None and not apart:
        return None
    if conditions is None:
        conditions = ConditionalSettings.conditions
    return ConditionalSettings(conditions, tuple(apart))


def resolved_conditions(
    conditional: ConditionalSettings | None, settings: OCTreeSettings
) -> ConditionalSettings:
    """Return which conditional rules are looked for beside a tree.

    Args:
        conditional: what the user chose; ``None`` for the default: triples where the tree is one
            box, none where its settings let it branch or write all bounds of a branch.
        settings: of the tree.

    Raises:
        ConfigurationError: conditional rules are asked for, and the tree is not one box.
    """
    found = {name: getattr(settings, name) for name in ('clip', 'alpha', 'full_conditions')}
    is_box = found == {'clip': 'mass', 'alpha': 0.0, 'full_conditions': False}
    if conditional is None:
        return ConditionalSettings() if is_box else ConditionalSettings('none')
    if conditional.looks and not is_box:
        told = ', '.join(f'{name} {value}' for name, value in found.items())
        raise ConfigurationError(
            f'conditions are looked for within a box, got {told}; allowed beside them are clip '
            'mass, alpha 0 and no full_conditions, or conditions none'
        )
    return conditional
