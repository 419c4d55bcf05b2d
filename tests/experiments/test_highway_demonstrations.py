# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
import numpy as np
from occ_constraints_pkg.features.feature_map import load_feature_map

from experiments.highway_demonstrations import traffic_episodes


def test_demonstrations_are_episodes_of_all_vehicles():
    values, episodes = traffic_episodes([0, 1], steps=20)
    assert values.shape == (2 * 21 * 21, 10)
    assert values.dtype == np.float32
    assert (np.bincount(episodes) == 21).all()
    # In the order of time within each episode: positions on the road change little.
    one = values[episodes == 3]
    assert np.abs(np.diff(one[:, 8])).max() < 2.0
    space = load_feature_map('highway').space
    assert ((values >= space.lows) & (values <= space.highs)).all()
