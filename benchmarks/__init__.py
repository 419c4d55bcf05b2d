# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Benchmarks behind ``occ bench NAME``: one module each.

Each module has ``run(seconds)``, which returns one document: ``metrics`` and ``peers`` (flat: a
name with its unit and a number), ``settings``, ``machine`` and ``versions``. ``seconds`` has a
default of its own.
"""

# Name on the command line -> what it measures, in words of the help. The module of that name is
# imported when it runs, for some need extras.
BENCHMARKS = {
    'learn': 'learning from a million samples beside an Isolation Forest',
    'learn_growth': 'time to learn from 10^5 to 10^7 samples; takes some 6 GB of memory',
    'loop': 'training over topics beside training in one process',
    'train': 'the same for longer, and occ train with the true cost',
    'rules': 'judging by rules beside a decision tree of scikit-learn',
    'monitor': 'the node monitor beside a bare relay of the same messages; takes 4 minutes',
    'record': 'what a recorder of 200 topics loses when it is killed; takes 5 minutes',
    'gate': 'random stops, kills and restarts of monitor and gate: commands that should be zero',
    'bags': 'features of a bag beside its messages deserialized by rosbags',
    'highway': 'the world highway beside highway-env',
    'worlds': 'the Safety-Gym tasks beside a bare loop of MuJoCo steps',
}
