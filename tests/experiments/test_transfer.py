# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""From an expert to trained policies, in small; a second call only compares again."""

import pytest

pytest.importorskip('torch', reason="needs the extra 'train'")

from experiments.transfer import (  # noqa: E402
    TransferSettings,
    demonstrated_constraints,
    run_transfer,
)


def test_rules_keep_to_what_the_expert_demonstrated():
    constraints = demonstrated_constraints('simple_nav', 'expert', 10, explore=False)
    coverage = constraints.coverage
    samples = coverage['training_samples'] + coverage['held_out_samples']
    outside = samples - round(
        coverage['training'] * coverage['training_samples']
        + coverage['held_out'] * coverage['held_out_samples']
    )
    assert coverage['cost_per_episode'] == pytest.approx(outside / 10)
    assert samples > 10 * 30


@pytest.mark.slow
def test_a_transfer_in_small(tmp_path):
    settings = TransferSettings(
        'simple_nav', 'simple_nav', demonstrations=10, steps=17_000, seeds=2, episodes=10
    )
    first = run_transfer(tmp_path, settings)
    assert len(first['trained']) == 2
    assert first['expert']['cost'] == 0.0
    assert first['trained_mean']['return'] < first['expert']['return']
    before = {path: path.stat().st_mtime_ns for path in tmp_path.glob('*.yaml')}
    again = run_transfer(tmp_path, settings)
    assert again['trained'] == first['trained']
    assert {path: path.stat().st_mtime_ns for path in tmp_path.glob('*.yaml')} == before
