# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The feature map: which topic and field, or table column, gives each feature."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np

from occ_constraints_pkg.documents import (
    did_you_mean,
    load_schema,
    parse_yaml,
    read_text,
    validate,
)
from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.rules.constraints_file import Constraints
from occ_constraints_pkg.rules.space import Feature, FeatureSpace

SCHEMA = load_schema(__package__, 'feature_map.schema.json')
_MAPS = resources.files(__package__).joinpath('maps')
BUILT_IN_MAPS = tuple(
    sorted(entry.name[:-5] for entry in _MAPS.iterdir() if entry.name.endswith('.yaml'))
)


@dataclass(frozen=True)
class FeatureSource:
    """Where one feature comes from and what is done to it.

    Attributes:
        name: the feature's identifier.
        topic: topic name as written; with or without leading slash is the same.
        field: path of a message field, as ``twist.twist.linear.x``, ``ranges[3]``, ``ranges[0:9]``
            (the end not included); None when ``column`` is set.
        column: name of a table's column; None when ``field`` is set.
        unit: SI unit, or ``1`` for a pure number.
        low: smallest physically possible value, ``-inf`` for none.
        high: largest physically possible value, ``inf`` for none.
        reduce: what makes one number of several: ``min``, ``max``, ``mean``, ``norm`` or None.
        transform: ``abs``, ``yaw`` (of a quaternion, in rad) or None; applied last.
        family: features that measure the same in different places or directions; see
            :class:`~occ_constraints_pkg.rules.space.Feature`.
        missing: meaning of a range that was not measured: ``unknown`` leaves it as it is, so that
            one that is not finite makes the verdict UNKNOWN; ``max_range`` puts the message's
            ``range_max`` where a scanner reports +Inf, NaN or 0, unless all of an array's values
            are NaN or 0: then the scanner is blind, and the value is missing. -Inf, which REP 117
            defines as an object too close to measure, is never replaced.
    """

    name: str
    topic: str
    field: str | None = None
    column: str | None = None
    unit: str = '1'
    low: float = -np.inf
    high: float = np.inf
    reduce: str | None = None
    transform: str | None = None
    missing: str = 'unknown'
    family: str = ''


@dataclass(frozen=True)
class FeatureMap:
    """The features of a rule set and how their topics are aligned in time.

    Attributes:
        pace: the topic of which every message gives one row, or one per robot for a table.
        max_age: seconds; a value held from another topic that is further than this from the pace
            message, by header stamps, or by arrival where one of the two has no stamp, is missing.
        features: the sources, in the order of the feature space.
    """

    pace: str
    max_age: float
    features: tuple[FeatureSource, ...]

    @cached_property
    def names(self) -> tuple[str, ...]:
        """The features' names, in order."""
        return tuple(feature.name for feature in self.features)

    @cached_property
    def topics(self) -> tuple[str, ...]:
        """The topics that are needed, each once, the pace first."""
        topics = {topic_key(self.pace): self.pace}
        for feature in self.features:
            topics.setdefault(topic_key(feature.topic), feature.topic)
        return tuple(topics.values())

    @cached_property
    def space(self) -> FeatureSpace:
        """The feature space that rules over this map speak of."""
        return FeatureSpace(
            tuple(
                Feature(item.name, item.unit, item.low, item.high, item.family)
                for item in self.features
            )
        )

    def to_document(self) -> dict[str, Any]:
        """Return the map as the plain values of its YAML form."""
        return {
            'schema_version': 1,
            'pace': self.pace,
            'max_age': self.max_age,
            'features': [_feature_document(feature) for feature in self.features],
        }

    @classmethod
    def from_document(cls, document: Any, where: str, *, text: str | None = None) -> FeatureMap:
        """Build a map from plain values, for example a part of the constraints file.

        Args:
            document: what :meth:`to_document` returns.
            where: what errors call the document.
            text: the YAML text it came from, for line numbers in errors.

        Raises:
            OccError: the document breaks the schema, or its parts do not fit together.
        """
        validate(document, SCHEMA, where, text=text)
        features = tuple(_feature(entry) for entry in document['features'])
        tables = {topic_key(item.topic) for item in features if item.column is not None}
        for index, feature in enumerate(features):
            _check(feature, f'{where}: features[{index}]')
            if feature.column is None and topic_key(feature.topic) in tables:
                raise OccError(
                    f'{where}: features[{index}].field: got {feature.field!r} of topic '
                    f'{feature.topic!r}, of which another feature is a table column; '
                    'allowed are fields only or columns only'
                )
        result = cls(document['pace'], float(document['max_age']), features)
        if not np.isfinite(result.max_age):
            raise OccError(f'{where}: max_age: got {result.max_age}; allowed is a finite number')
        try:
            # The feature space checks names and bounds.
            _ = result.space
        except OccError as error:
            raise OccError(f'{where}: {error}') from error
        return result


def load_feature_map(name_or_path: str | Path) -> FeatureMap:
    """Load a built-in map by its bare name, or one from a YAML file.

    Raises:
        OccError: there is neither such a built-in map nor such a file, or the file is wrong.
    """
    name = str(name_or_path)
    if name in BUILT_IN_MAPS:
        text = _MAPS.joinpath(f'{name}.yaml').read_text(encoding='utf-8')
    elif Path(name_or_path).is_file():
        text = read_text(name_or_path)
    else:
        hint = did_you_mean(name, BUILT_IN_MAPS) or ';'
        raise OccError(
            f'there is no feature map {name!r}{hint} allowed are a YAML file and the built-in '
            f'maps {", ".join(BUILT_IN_MAPS)}'
        )
    return FeatureMap.from_document(parse_yaml(text, name), name, text=text)


def map_of(constraints: Constraints, where: str) -> FeatureMap:
    """Return the feature map that a constraints file carries.

    Args:
        constraints: the file's content.
        where: what errors call it.

    Raises:
        OccError: there is none, it is not valid, or it gives other features than the rules name.
    """
    if constraints.feature_map is None:
        raise OccError(f'{where} has no feature_map, so no topic gives its features')
    feature_map = FeatureMap.from_document(constraints.feature_map, where)
    names = constraints.rule_set.space.names
    if feature_map.names != names:
        raise OccError(
            f'{where}: feature_map gives {", ".join(feature_map.names)}, but the rules speak '
            f'of {", ".join(names)}'
        )
    return feature_map


def topic_key(topic: str) -> str:
    """Return the form in which topic names are compared: without leading slash."""
    return topic.lstrip('/')


def _feature(entry: Mapping[str, Any]) -> FeatureSource:
    values = dict(entry)
    low, high = values.pop('bounds', (None, None))
    return FeatureSource(
        low=-np.inf if low is None else float(low),
        high=np.inf if high is None else float(high),
        **values,
    )


def _check(feature: FeatureSource, where: str) -> None:
    """Refuse what the schema cannot see: keys that exclude or need each other."""
    if feature.column is not None:
        for key, value in (('reduce', feature.reduce), ('missing', feature.missing)):
            if value not in (None, 'unknown'):
                raise OccError(
                    f'{where}.{key}: got {value!r} for a table column, which is one number; '
                    f'allowed is to leave {key} out'
                )
        if feature.transform == 'yaw':
            raise OccError(
                f"{where}.transform: got 'yaw' for a table column; it needs a quaternion field"
            )
    elif feature.transform == 'yaw' and feature.reduce:
        raise OccError(
            f"{where}: got transform 'yaw' with reduce {feature.reduce!r}; allowed is one of them"
        )
    elif ':' in feature.field and not feature.reduce:
        raise OccError(
            f'{where}: the key "reduce" is missing, which field {feature.field!r} needs to '
            'become one number; allowed are min, max, mean, norm'
        )


def _feature_document(feature: FeatureSource) -> dict[str, Any]:
    """Return a feature's keys, those at their defaults left out."""
    source = 'field' if feature.column is None else 'column'
    document = {
        'name': feature.name,
        'topic': feature.topic,
        source: getattr(feature, source),
        'unit': feature.unit,
    }
    bounds = [value if np.isfinite(value) else None for value in (feature.low, feature.high)]
    if bounds != [None, None]:
        document['bounds'] = bounds
    for key in ('reduce', 'transform'):
        if getattr(feature, key) is not None:
            document[key] = getattr(feature, key)
    if feature.missing != 'unknown':
        document['missing'] = feature.missing
    if feature.family:
        document['family'] = feature.family
    return document
