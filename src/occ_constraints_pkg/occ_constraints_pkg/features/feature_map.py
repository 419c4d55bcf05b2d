# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The feature map: which topic and field, or table column, gives each feature."""

from __future__ import annotations

from dataclasses import dataclass, replace
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
    with_line,
)
from occ_constraints_pkg.errors import ConfigurationError, OccError
from occ_constraints_pkg.features.paths import Selector
from occ_constraints_pkg.features.sources import (
    FeatureSource,
    Reading,
    feature_document,
    features_of,
)
from occ_constraints_pkg.rules.constraints_file import Constraints
from occ_constraints_pkg.rules.space import Feature, FeatureSpace

SCHEMA = load_schema(__package__, 'feature_map.schema.json')
_MAPS = resources.files(__package__).joinpath('maps')
BUILT_IN_MAPS = tuple(
    sorted(entry.name[:-5] for entry in _MAPS.iterdir() if entry.name.endswith('.yaml'))
)


@dataclass(frozen=True)
class Channel:
    """Readings of one topic that come with the same messages and expire together.

    Attributes:
        key: the topic as :func:`topic_key` writes it.
        max_age_ns: how far the values may be from their row, in ns.
        is_by_arrival: whether that is measured by arrival alone.
        names: what a message must name to be one for these readings; others leave them as they
            are, as when an arm and its gripper publish on one topic.
        places: indices of the readings among those of the map.
    """

    key: str
    max_age_ns: int
    is_by_arrival: bool = False
    names: frozenset[Selector] = frozenset()
    places: tuple[int, ...] = ()


@dataclass(frozen=True)
class FeatureMap:
    """The features of a rule set and how their topics are aligned in time.

    The latest value of a topic is used (zero-order hold), as long as it is not older than
    ``max_age``.

    Attributes:
        pace: the topic of which every message gives one row, or one per robot for a table; empty
            when ``rate`` is set.
        max_age: seconds; a latest value that is further than this from the message that gives the
            row, by header stamps, or by arrival where one of the two has no stamp, is missing.
        features: the sources, in the order of the feature space.
        rate: rows per second instead of a pace topic: the first message in each period gives a
            row. Header stamps tell the time; messages without one give rows only as long as no
            message with one has come.
        apart: pairs of features or families that no learned rule combines, because geometry or
            dynamics ties them together anyway.

    Example:
        >>> feature_map = occ.load_feature_map('simple_nav')
        >>> print(feature_map.pace, *feature_map.names)
        observation x y
    """

    pace: str
    max_age: float
    features: tuple[FeatureSource, ...]
    rate: float | None = None
    apart: tuple[tuple[str, str], ...] = ()

    @cached_property
    def names(self) -> tuple[str, ...]:
        """The features' names, in order."""
        return tuple(feature.name for feature in self.features)

    @cached_property
    def readings(self) -> tuple[tuple[str, Reading], ...]:
        """What is read: ``(feature, reading)`` of each feature, then of each that is subtracted."""
        own = [(feature.name, feature.reading) for feature in self.features]
        minus = [(item.name, item.minus) for item in self.features if item.minus is not None]
        return (*own, *minus)

    def max_age_ns(self, reading: Reading) -> int:
        """Return how far a reading's value may be from its row, in ns."""
        return round((self.max_age if reading.max_age is None else reading.max_age) * 1e9)

    @cached_property
    def channels(self) -> tuple[Channel, ...]:
        """The readings of each topic that come and expire together, the pace topic's first."""
        places: dict[Channel, list[int]] = {}
        if self.pace:
            # Also where nothing of it is read, for each of its messages gives a row.
            places[Channel(topic_key(self.pace), round(self.max_age * 1e9))] = []
        for place, (_, reading) in enumerate(self.readings):
            channel = Channel(
                topic_key(reading.topic),
                self.max_age_ns(reading),
                reading.age_by == 'arrival',
                frozenset(reading.selectors),
            )
            places.setdefault(channel, []).append(place)
        return tuple(replace(channel, places=tuple(at)) for channel, at in places.items())

    @cached_property
    def topics(self) -> tuple[str, ...]:
        """The topics that are needed, each once, the pace first."""
        topics = {topic_key(self.pace): self.pace} if self.pace else {}
        for _, reading in self.readings:
            topics.setdefault(topic_key(reading.topic), reading.topic)
        return tuple(topics.values())

    @cached_property
    def table_topics(self) -> frozenset[str]:
        """Those of :attr:`topics` that are read by column."""
        keys = {topic_key(item.topic) for _, item in self.readings if item.column is not None}
        return frozenset(topic for topic in self.topics if topic_key(topic) in keys)

    @cached_property
    def space(self) -> FeatureSpace:
        """The feature space that rules over this map speak of."""
        return FeatureSpace(
            tuple(
                Feature(item.name, item.unit, item.low, item.high, item.family)
                for item in self.features
            )
        )

    def in_namespace(self, namespace: str) -> FeatureMap:
        """Return the map with the topics that one robot's messages have in recordings.

        As ROS resolves names: a topic that is written without leading slash lies below the
        namespace, any other one stays. In the namespace ``''`` or ``/`` nothing changes.

        Args:
            namespace: such as ``/robot1``, with or without leading slash.
        """
        space = namespace.strip('/')
        if not space:
            return self

        def resolved(topic: str) -> str:
            return topic if topic.startswith('/') or not topic else f'/{space}/{topic}'

        features = tuple(
            replace(
                item,
                topic=resolved(item.topic),
                minus=item.minus and replace(item.minus, topic=resolved(item.minus.topic)),
            )
            for item in self.features
        )
        return replace(self, pace=resolved(self.pace), features=features)

    def to_document(self) -> dict[str, Any]:
        """Return the map as the plain values of its YAML form, with each sector written out."""
        return {
            'schema_version': 1,
            'pace': self.pace if self.rate is None else {'rate': self.rate},
            'max_age': self.max_age,
            'features': [feature_document(feature) for feature in self.features],
            **({'apart': [list(pair) for pair in self.apart]} if self.apart else {}),
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
        if isinstance(document, dict) and document.get('features') == []:
            what = (
                'features: the map has no feature, so nothing could be judged; add one, such as '
                'one of those in the comments of a suggested map'
            )
            raise ConfigurationError(with_line(what, where, text))
        validate(document, SCHEMA, where, text=text)
        try:
            return cls._from_valid(document)
        except OverflowError as error:
            raise ConfigurationError(
                f'{where}: a number is too large; allowed are 64-bit floats'
            ) from error
        except OccError as error:
            raise ConfigurationError(with_line(str(error), where, text)) from error

    @classmethod
    def _from_valid(cls, document: Any) -> FeatureMap:
        features: list[FeatureSource] = []
        entries: list[int] = []
        for index, entry in enumerate(document['features']):
            found = features_of(entry, f'features[{index}]')
            features += found
            entries += [index] * len(found)
        given = document['pace']
        pace, rate = (given, None) if isinstance(given, str) else ('', float(given['rate']))
        apart = tuple((one, other) for one, other in document.get('apart', ()))
        result = cls(pace, float(document['max_age']), tuple(features), rate, apart)
        for key, value in (('max_age', result.max_age), ('pace.rate', rate or 1.0)):
            if not np.isfinite(value):
                raise ConfigurationError(f'{key}: got {value}; allowed is a finite number')
        tables = {topic_key(topic) for topic in result.table_topics}
        for index, feature in zip(entries, features, strict=True):
            for reading in feature.readings:
                if reading.column is None and topic_key(reading.topic) in tables:
                    raise ConfigurationError(
                        f'features[{index}].field: got {reading.field!r} of topic '
                        f'{reading.topic!r}, of which another feature is a table column; '
                        'allowed are fields only or columns only'
                    )
        # The feature space checks names and bounds.
        _ = result.space
        known = {name for item in features for name in (item.name, item.family) if name}
        for index, name in enumerate(name for pair in apart for name in pair):
            if name not in known:
                hint = did_you_mean(name, sorted(known)) or ';'
                raise ConfigurationError(
                    f'apart[{index // 2}]: got {name!r}{hint} allowed are names of '
                    'features and families'
                )
        return result


def load_feature_map(name_or_path: str | Path) -> FeatureMap:
    """Load a built-in map by its bare name, or one from a YAML file.

    Raises:
        OccError: there is neither such a built-in map nor such a file, or the file is wrong.

    Example:
        >>> occ.load_feature_map('PointGoal1').topics
        ('observation',)
    """
    name = str(name_or_path)
    if name in BUILT_IN_MAPS:
        text = _MAPS.joinpath(f'{name}.yaml').read_text(encoding='utf-8')
    elif Path(name_or_path).is_file():
        text = read_text(name_or_path)
    elif Path(name_or_path).is_dir():
        raise ConfigurationError(
            f'{name} is a directory, as recordings are, not a feature map; were the arguments '
            'swapped?'
        )
    else:
        hint = did_you_mean(name, BUILT_IN_MAPS) or ';'
        raise ConfigurationError(
            f'there is no feature map {name!r}{hint} allowed are a YAML file and the built-in '
            f'maps {", ".join(BUILT_IN_MAPS)}'
        )
    document = parse_yaml(text, name)
    if isinstance(document, dict) and 'rules' in document:
        raise ConfigurationError(f'{name} is a constraints file (-c), not a feature map')
    return FeatureMap.from_document(document, name, text=text)


def map_of(constraints: Constraints, where: str) -> FeatureMap:
    """Return the feature map that a constraints file carries.

    Args:
        constraints: the file's content.
        where: what errors call it.

    Raises:
        OccError: there is none, it is not valid, or it gives other features than the rules name.
    """
    if constraints.feature_map is None:
        raise ConfigurationError(f'{where} has no feature_map, so no topic gives its features')
    feature_map = FeatureMap.from_document(constraints.feature_map, where)
    names = constraints.rule_set.space.names
    if feature_map.names != names:
        raise ConfigurationError(
            f'{where}: feature_map gives {", ".join(feature_map.names)}, but the rules speak '
            f'of {", ".join(names)}'
        )
    return feature_map


def topic_key(topic: str) -> str:
    """Return the form in which topic names are compared: without leading slash."""
    return topic.lstrip('/')
