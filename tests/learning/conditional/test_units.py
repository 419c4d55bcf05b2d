# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.learning.conditional.rules import Feature
from occ_constraints_pkg.learning.conditional.units import (
    ABOVE,
    BELOW,
    EQUAL,
    distinct,
    make_units,
    pairs_of,
)


def names_of(units, pairs):
    return {(units[i].name, units[j].name) for i, j in pairs}


def test_few_values_make_a_discrete_unit_and_constants_none():
    rng = np.random.default_rng(0)
    values = np.column_stack(
        [rng.normal(size=500), rng.integers(0, 3, 500), np.full(500, 4.0), rng.integers(0, 20, 500)]
    )
    units = make_units(values, [Feature(name) for name in ('x', 'mode', 'constant', 'count')])
    assert [unit.name for unit in units] == ['x', 'mode', 'count']
    assert [unit.is_discrete for unit in units] == [False, True, False]
    np.testing.assert_array_equal(units[1].kinds, [0, 1, 2])


def test_what_is_discrete_can_be_stated():
    values = np.column_stack([np.arange(300.0) % 20, np.arange(300.0) % 3])
    units = make_units(values, [Feature('gear', discrete=True), Feature('x', discrete=False)])
    assert [unit.is_discrete for unit in units] == [True, False]
    assert len(units[0].kinds) == 20


def test_a_rare_value_far_down_is_not_missed():
    column = np.zeros(100_000)
    column[1] = 5.0
    np.testing.assert_array_equal(distinct(column, 8), [0.0, 5.0])
    column[: 10 * 7 : 7] = np.arange(10)
    assert distinct(column, 8) is None


def test_a_family_has_a_least_and_a_largest_member():
    values = np.random.default_rng(0).uniform(size=(50, 4))
    features = [Feature('v'), *(Feature(f's{number}', family='s') for number in range(3))]
    units = make_units(values, features)
    least, largest = units[-2:]
    np.testing.assert_array_equal(least.of(values), values[:, 1:].min(axis=1))
    np.testing.assert_array_equal(largest.of(values), values[:, 1:].max(axis=1))
    (literal,) = largest.literals(ABOVE, 0.5)
    assert literal.text([]) == 'any s > 0.5'
    np.testing.assert_array_equal(literal.holds(values), largest.of(values) > 0.5)


def test_members_of_a_family_are_not_combined_nor_what_is_apart():
    values = np.random.default_rng(0).uniform(size=(50, 5))
    features = [
        Feature('v'),
        Feature('w'),
        *(Feature(f's{number}', family='s') for number in range(3)),
    ]
    units = make_units(values, features)
    free = names_of(units, pairs_of(units, features, ()))
    assert ('v', 's') in free
    assert ('v', 's1') in free
    assert not {pair for pair in free if all(name.startswith('s') for name in pair)}
    kept = names_of(units, pairs_of(units, features, [('s', 'v'), ('w', 's1')]))
    assert ('v', 'w') in kept
    assert not {pair for pair in kept if pair[0] == 'v' and pair[1].startswith('s')}
    assert ('w', 's0') in kept
    assert ('w', 's1') not in kept


def test_a_name_that_is_not_known_is_told():
    features = [Feature('v'), Feature('w')]
    units = make_units(np.random.default_rng(0).uniform(size=(50, 2)), features)
    with pytest.raises(OccError, match="apart names 'x'; allowed are .* v, w"):
        pairs_of(units, features, [('v', 'x')])


def test_literals_of_discrete_values_include_them():
    (unit,) = make_units(np.arange(30.0)[:, None] % 4, [Feature('mode')])
    texts = [
        ' and '.join(literal.text(['mode']) for literal in unit.literals(side, 2.0))
        for side in (BELOW, EQUAL, ABOVE)
    ]
    assert texts == ['mode <= 2.0', 'mode >= 2.0 and mode <= 2.0', 'mode >= 2.0']
