# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Damaged bags and documents: a message for each, no hang, no flood of memory.

``python -m fuzz_bags FIRST COUNT`` in ``tests`` runs the same for any numbers.
"""

import pytest
from fuzzing import SECONDS_ALLOWED, watched

FEW, MANY, STEP = 80, 10_000, 2_500


def check(module, first, count):
    result = watched(module, first, count)
    assert not result['problems'], '\n'.join(result['problems'][:5])
    assert result['slowest'] < SECONDS_ALLOWED
    assert result['peak'] < 1 << 30
    assert sum(result['endings'].values()) == count
    # Neither is everything refused nor nothing.
    assert len(result['endings']) > 1


@pytest.mark.parametrize('module', ['fuzz_bags', 'fuzz_documents'])
def test_a_few_damaged_files(module):
    check(module, 0, FEW)


@pytest.mark.slow
@pytest.mark.timeout(1800)
@pytest.mark.parametrize('first', range(0, MANY, STEP))
@pytest.mark.parametrize('module', ['fuzz_bags', 'fuzz_documents'])
def test_many_damaged_files(module, first):
    check(module, first, STEP)
