# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""What a user may choose about conditional rules."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

from occ_constraints_pkg.errors import ConfigurationError

CONDITIONS = ('pairs', 'triples')


@dataclass(frozen=True)
class ConditionalSettings:
    """Settings of the learner of conditional rules; one default for all data.

    Attributes:
        conditions: ``pairs`` for rules about two features (or gaps of one), ``triples`` for rules
            about three as well.
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
    apart: tuple[tuple[str, str], ...] = ()
    delta: float = 0.005
    most_rules: int = 16
    outside: float | None = 0.005

    def __post_init__(self) -> None:
        if self.conditions not in CONDITIONS:
            raise ConfigurationError(
                f'conditions is {self.conditions!r}; allowed are none, {", ".join(CONDITIONS)}'
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

    def document(self) -> dict[str, Any]:
        """Return the settings as plain values."""
        return {**asdict(self), 'apart': [list(pair) for pair in self.apart]}


def chosen_conditions(
    conditions: str, apart: Sequence[tuple[str, str]]
) -> ConditionalSettings | None:
    """Return the settings that a user chose, ``None`` for ``none``.

    Raises:
        ConfigurationError: a value is not allowed.
    """
    if conditions != 'none':
        return ConditionalSettings(conditions, tuple(apart))
    if apart:
        raise ConfigurationError(
            'apart has no effect with conditions none; allowed with it are pairs and triples'
        )
    return None
