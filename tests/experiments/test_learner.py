# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Trainings in small; a second call adds what the first has left out."""

import pytest

pytest.importorskip('torch', reason="needs the extra 'train'")

from experiments.learner import run_learner  # noqa: E402


def test_trainings_are_judged_on_the_way_and_continued(tmp_path):
    settings = {'worlds': ['simple_nav'], 'costs': ['true'], 'limits': [2.0], 'steps': 8192}
    first = run_learner(tmp_path, **settings, seeds=[0], points=2)
    (line,) = first['lines'].values()
    assert [point['steps'] >= 4096 for point in line['curve']] == [True, True]
    assert line['mean']['episodes'] == line['sampled']['episodes'] == 200
    assert (tmp_path / 'learner.png').stat().st_size > 1000
    asked = []
    both = run_learner(
        tmp_path, **settings, seeds=[0, 1], points=2, progress=lambda *done: asked.append(done)
    )
    assert asked == [(2, 2)]
    assert both['lines']['simple_nav, true, 2, 8192, 0'] == line
    table = (tmp_path / 'learner.md').read_text(encoding='utf-8')
    assert '| simple_nav | true | 2 | 0.008192e6 |' in table
