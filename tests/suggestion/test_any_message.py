# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Whatever messages hold, a map is written, and it loads if some feature is in use."""

import numpy as np
import pytest
from occ_constraints_pkg.documents import parse_yaml
from occ_constraints_pkg.features.feature_map import FeatureMap
from occ_constraints_pkg.rosbag.recording import Recording
from occ_constraints_pkg.suggestion.suggest import suggest_each
from occ_constraints_pkg.suggestion.text import suggestion_text

from experiments.robot_kinds.messages import STORE, write_messages

PACKAGES = {
    *('std_msgs', 'sensor_msgs', 'geometry_msgs', 'nav_msgs', 'trajectory_msgs', 'control_msgs'),
    *('px4_msgs', 'unitree_go', 'vesc_msgs', 'irobot_create_msgs', 'demo_msgs', 'ackermann_msgs'),
}
TYPES = sorted(name for name in STORE.fielddefs if name.partition('/')[0] in PACKAGES)
DTYPES = {'bool': bool, 'byte': np.uint8, 'char': np.uint8, 'octet': np.uint8}


def number(kind, rng):
    if kind == 'bool':
        return bool(rng.random() < 0.5)
    if 'float' in kind:
        odd = rng.choice([0.0, 1.0, np.nan, np.inf], p=[0.95, 0.02, 0.02, 0.01])
        return float(odd or rng.normal() * 10.0 ** rng.integers(-2, 3))
    return int(rng.integers(0, 100))


def filled(msgtype, rng, *, varies):
    fields = {name: value(node, rng, varies=varies) for name, node in STORE.fielddefs[msgtype][1]}
    return STORE.types[msgtype](**fields)


def value(node, rng, *, varies):
    kind, what = node
    if kind.name == 'BASE':
        return 'elbow' if 'string' in what[0] else number(what[0], rng)
    if kind.name == 'NAME':
        return filled(what, rng, varies=varies)
    (inner, name), length = what
    count = length if kind.name == 'ARRAY' else int(rng.integers(0, 5)) if varies else 3
    if inner.name == 'BASE' and 'string' in name[0]:
        return [f'joint_{place}' for place in range(count)]
    items = [value((inner, name), rng, varies=varies) for _ in range(count)]
    if inner.name == 'BASE':
        return np.array(items, dtype=DTYPES.get(name[0], name[0]))
    return items


@pytest.mark.parametrize('seed', range(3))
def test_any_message(tmp_path, seed):
    rng = np.random.default_rng(seed)
    messages = [
        (step / 10, f'/topic_{place}', filled(msgtype, rng, varies=bool(place % 2)))
        for place, msgtype in enumerate(rng.choice(TYPES, 12, replace=False).tolist())
        for step in range(20)
    ]
    recording = Recording(write_messages(tmp_path / 'any.mcap', iter(messages)))
    for suggestion in suggest_each(recording):
        text = suggestion_text(suggestion)
        document = parse_yaml(text, 'map')
        if suggestion.used:
            feature_map = FeatureMap.from_document(document, 'map', text=text)
            assert len(feature_map.names) == len(suggestion.seen.features)
        told = {item.topic.name for item in suggestion.candidates}
        told |= {topic.name for topic, reason in suggestion.unused if reason}
        assert told == set(recording.topics)
