# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Pictures are written and hold what they should."""

import numpy as np
import pytest
from occ_constraints_pkg.rules import Feature, FeatureSpace, Literal, Rule, RuleSet

pytest.importorskip('matplotlib')
pytest.importorskip('mujoco')

from matplotlib import image as mpl_image
from occ_constraints_pkg.demo.pictures import draw_rules


def shades(path):
    """Return how many colours a picture has; an empty one has very few."""
    pixels = (mpl_image.imread(path)[..., :3] * 255).astype(np.uint8).reshape(-1, 3)
    return len(np.unique(pixels, axis=0))


def test_rules_are_drawn_with_their_bounds(tmp_path):
    space = FeatureSpace((Feature('v_x', 'm/s'), Feature('still')))
    rules = (Rule('R1', (Literal(0, '>', 1.5),)), Rule('R2', (Literal(1, '<', 0.0),), False))
    rule_set = RuleSet(space, rules, np.array([[0.0, 2.0], [0.0, 0.0]]))
    values = np.column_stack([np.linspace(0.0, 2.0, 50), np.zeros(50)])
    draw_rules(tmp_path / 'rules.png', rule_set, values)
    draw_rules(tmp_path / 'none.png', RuleSet(space, (), rule_set.demonstrated), values)
    assert shades(tmp_path / 'rules.png') > shades(tmp_path / 'none.png') > 10
