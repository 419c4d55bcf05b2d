# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Benchmarks, one module each: ``python -m benchmarks NAME``.

Each module has ``run(seconds)``, which returns ``metrics`` and ``peers`` (flat: a name with its
unit and a number; peers are what ran beside it) and ``settings``. ``seconds`` has a default.
"""

# The module of the name is imported when it runs, for some need extras.
BENCHMARKS = {
    'learn': 'Learning from a million samples beside an Isolation Forest.',
    'learn_growth': 'Learning from 10^5 to 10^7 samples; takes 6 GB of memory.',
    'loop': 'Training over topics beside training in one process.',
    'train': 'The same for longer, and occ train with the true cost.',
    'rules': 'Judging by rules beside a decision tree of scikit-learn.',
    'monitor': 'The monitor beside a bare relay; takes 4 minutes.',
    'watch': 'The live view of five robots beside a bare listener.',
    'dashboard': 'The page of twenty robots beside a bare listener.',
    'record': 'What a killed recorder of 200 topics loses; takes 5 minutes.',
    'incidents': 'The event_recorder at 60 topics and 20 MB/s, and the monitor beside it.',
    'events': 'What an event store of 10^5 events loses by 50 kills; takes 3 minutes.',
    'gate': 'The gate under random stops, kills and restarts.',
    'soak': 'A day of messages through monitor and gate: memory, latency, losses; 15 minutes.',
    'bags': 'Features of a bag beside its messages deserialized by rosbags.',
    'triage': 'Triage of 200 recordings, ten of them bad; takes 3 minutes.',
    'report': 'The page of fifty recordings of an hour each, in a browser.',
    'highway': 'The world highway beside highway-env.',
    'worlds': 'The Safety-Gym tasks beside a bare loop of MuJoCo steps.',
}
"""Names on the command line, and what they measure."""
