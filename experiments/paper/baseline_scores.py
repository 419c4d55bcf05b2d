# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""How well the baselines that need no training recover the true cost."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from occ_constraints_pkg.rules.constraints_file import load_constraints

from experiments.baselines import HULL, STATIC, HullOfMeans
from experiments.paper.demonstrations import (
    RULES,
    STATES,
    demonstrated,
    load_arrays,
    ratios,
    rule_scores,
)


def score_baselines(folder: Path, needs: Mapping[str, Path], **_: Any) -> dict[str, Any]:
    """Learn from the same demonstrations as the rules were, and judge on the same states.

    Args:
        folder: of the run.
        needs: ``rules`` and ``states``.
        **_: what distinguishes the run.

    Returns:
        Precision, recall and F1 of each method, ``ours`` included, by its name.
    """
    demonstrations, states = demonstrated(needs['rules']), load_arrays(needs['states'] / STATES)
    values, costly = states['values'].astype(np.float64), states['costly']
    found = {
        name: ratios(learn(demonstrations.values)(values), costly) for name, learn in STATIC.items()
    }
    hull = HullOfMeans.of(demonstrations.values, demonstrations.episodes)
    found[HULL] = ratios(hull.flags(values, states['episodes']), costly)
    rule_set = load_constraints(needs['rules'] / RULES).rule_set
    return {'ours': rule_scores(rule_set, needs['states']), **found}
