# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The page of the demo: its pictures are in it, and what it says is text."""

import io

import numpy as np
import pytest
from occ_constraints_pkg.rules import Feature, FeatureSpace, Literal, Rule, RuleSet
from occ_constraints_pkg.rules.constraints_file import Constraints


def test_the_page_of_the_demo_is_complete_in_itself(tmp_path):
    plt = pytest.importorskip('matplotlib.pyplot')
    from occ_constraints_pkg.demo.page import demo_page

    stream = io.BytesIO()
    figure = plt.figure(figsize=(1, 1))
    figure.savefig(stream, format='png')
    plt.close(figure)
    for name in ('drives.png', 'training.png'):
        (tmp_path / name).write_bytes(stream.getvalue())
    space = FeatureSpace((Feature('speed', 'm/s'),))
    rules = RuleSet(space, (Rule('R1', (Literal(0, '>', 1.0),)),), np.array([[0.0, 1.0]]))
    watched = {'samples': 10, 'costly': 2, 'flagged': 3, 'precision': 2 / 3, 'recall': 1.0}
    page = demo_page(
        tmp_path,
        Constraints(rules),
        {**watched, 'example': {'rule': '<b>R1</b>'}},
        {'expert': {'return': 9.0, 'learned_cost': 1.0, 'true_cost': 2.0}},
        25.0,
        np.linspace(0.0, 1.0, 20)[:, None],
    )
    text = page.html()
    assert text.count('src="data:image/png;base64,') == 3
    assert '.png"' not in text
    assert 'precision of 0.67' in text
    assert '&lt;b&gt;R1' in text
    assert 'speed above 1 m/s' in text
