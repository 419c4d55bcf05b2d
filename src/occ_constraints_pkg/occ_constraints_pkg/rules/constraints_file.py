# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The constraints file: rules, the tree they came from, and how they were learned, as YAML."""

from __future__ import annotations

import hashlib
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from occ_constraints_pkg.documents import (
    did_you_mean,
    dump_yaml,
    load_schema,
    locate,
    parse_yaml,
    read_text,
    validate,
)
from occ_constraints_pkg.errors import ConfigurationError, OccError
from occ_constraints_pkg.files import CONSTRAINTS, check_kind, keep_copy, write_text
from occ_constraints_pkg.rules.rule import Literal, Rule
from occ_constraints_pkg.rules.ruleset import RuleSet
from occ_constraints_pkg.rules.space import Feature, FeatureSpace

# 2 has literals about families.
_SCHEMA_VERSION = 2
# Last line of a file that was derived from another one.
_SEAL = re.compile(r'^# not edited since occ wrote it, SHA-256 ([0-9a-f]{64})\n\Z', re.MULTILINE)
_SCHEMA = load_schema(__package__, 'constraints.schema.json')
# Signs of a recording or a table, and of another document, given by mistake.
_DATA_SUFFIXES = ('.mcap', '.db3', '.npz', '.csv', '.parquet')
_OTHER_KINDS = {
    'pace': 'a feature map (-m)',
    'rate': 'a feature map (-m)',
    'recordings': 'a manifest that lists recordings',
    'rosbag2_bagfile_information': 'the metadata of a recording',
}
_Path = tuple[str | int, ...]


class _KeyError(ConfigurationError):
    """A value that is not allowed, and the path of keys to it."""

    def __init__(self, path: _Path, sentence: str) -> None:
        super().__init__(sentence)
        self.path = path


@dataclass(frozen=True, eq=False)
class Constraints:
    """The content of a constraints file.

    Attributes:
        rule_set: features, rules, demonstrated ranges.
        feature_map: the feature map's document, ``None`` when the features come from a plain
            table and no topic is known.
        tree: the OC-tree as nested plain values (see ``learning.tree_document``).
        learner: the learner's settings.
        coverage: shares of training and held-out samples inside the safe set.
        provenance: package version, time, bags with their hashes.
        evidence: which demonstrations support each bound, as learned (see
            ``learning.evidence_document``).
        safe_set: with conditional rules, the box and the trees that they leave (see
            ``learning.conditional.forest``).

    Example:
        >>> constraints = occ.learn('bags/simple_nav_expert', 'simple_nav')
        >>> print(len(constraints.rules), f'{constraints.coverage["held_out"]:.1%}')
        5 100.0%
        >>> constraints.save('nav.yaml')
    """

    rule_set: RuleSet
    feature_map: Mapping[str, Any] | None = None
    tree: Mapping[str, Any] | None = None
    learner: Mapping[str, Any] = field(default_factory=dict)
    coverage: Mapping[str, Any] = field(default_factory=dict)
    provenance: Mapping[str, Any] = field(default_factory=dict)
    evidence: Mapping[str, Any] = field(default_factory=dict)
    safe_set: Mapping[str, Any] = field(default_factory=dict)

    @property
    def rules(self) -> tuple[Rule, ...]:
        """All rules, disabled ones included."""
        return self.rule_set.rules

    @property
    def space(self) -> FeatureSpace:
        """The features that the rules speak of."""
        return self.rule_set.space

    @property
    def is_edited(self) -> bool:
        """Whether a person has edited the rules or written them.

        An edit is a note or a change of the formula: a bound moved, a rule disabled, added or
        removed. A file that does not record what was learned was written by hand.
        """
        noted = any(rule.note for rule in self.rule_set.rules)
        return noted or self.provenance.get('learned_formula') != self.rule_set.fingerprint

    def with_rule_set(self, rule_set: RuleSet) -> Constraints:
        """Return the same file with another rule set over the same features."""
        return replace(self, rule_set=rule_set)

    def with_equal_rules(self, rule_set: RuleSet) -> Constraints:
        """Return the same file with equivalent rules, which is not an edit."""
        provenance = self.provenance
        if provenance.get('learned_formula') == self.rule_set.fingerprint:
            provenance = {**provenance, 'learned_formula': rule_set.fingerprint}
        return replace(self, rule_set=rule_set, provenance=provenance)

    def dumps(self) -> str:
        """Return the YAML text; floats are written so that they read back bit for bit."""
        document: dict[str, Any] = {
            'schema_version': _SCHEMA_VERSION,
            **rule_set_document(self.rule_set),
        }
        for key in (
            'feature_map',
            'tree',
            'safe_set',
            'learner',
            'coverage',
            'provenance',
            'evidence',
        ):
            value = getattr(self, key)
            # An empty tree is a single leaf, which differs from no tree.
            if value or (key == 'tree' and value is not None):
                document[key] = dict(value)
        return dump_yaml(document)

    def save(self, path: str | Path) -> None:
        """Write the file, atomically.

        Raises:
            OccError: the file cannot be written.
        """
        write_text(path, CONSTRAINTS, self.dumps())


def load_constraints(path: str | Path) -> Constraints:
    """Read a constraints file.

    Raises:
        ConfigurationError: it is not valid; the sentence names line, key and value.
        DataError: it cannot be read.

    Example:
        >>> occ.learn('bags/simple_nav_expert', 'simple_nav').save('nav.yaml')
        >>> occ.load_constraints('nav.yaml').space.names
        ('x', 'y')
    """
    if Path(path).is_dir() or Path(path).suffix in _DATA_SUFFIXES:
        found = 'a directory, as recordings are' if Path(path).is_dir() else 'a recording or table'
        raise ConfigurationError(
            f'cannot read {path} as a constraints file: it is {found}; were the arguments swapped?'
        )
    return parse_constraints(read_text(path), str(path))


def save_learned(constraints: Constraints, path: str | Path, *, overwrite: bool = False) -> None:
    """Write newly learned constraints without losing edits.

    Args:
        constraints: what was learned.
        path: the file to write.
        overwrite: replace an edited file; a copy is kept with the suffix ``.bak``.

    Raises:
        ConfigurationError: the file there was edited and ``overwrite`` is off, or is not a
            constraints file.
        OccError: it cannot be written.
    """
    text = _text_there(path)
    _keep_edited(path, _is_edited(text, str(path)), overwrite)
    constraints.save(path)


def save_derived(
    constraints: Constraints, path: str | Path, *, overwrite: bool = False, in_place: bool = False
) -> Path | None:
    """Write constraints derived from a file without losing edits at their destination.

    The file ends with a checksum that shows that nobody has edited it, so that the same command can
    be repeated. A file that was learned and not edited is replaced, too.

    Args:
        constraints: a file's content, counted, pruned or simplified.
        path: the file to write.
        overwrite: replace an edited file; a copy is kept with the suffix ``.bak``.
        in_place: ``path`` is the file that ``constraints`` were derived from, to be changed on
            request; a copy of an edited file is kept likewise.

    Returns:
        The copy of an edited file, if there was one.

    Raises:
        ConfigurationError: the file there was edited and may not be replaced, or is not a
            constraints file.
        OccError: it cannot be written.
    """
    there = _text_there(path)
    copy = _keep_edited(
        path, not _is_sealed(there) and _is_edited(there, str(path)), overwrite or in_place
    )
    text = constraints.dumps()
    write_text(
        path, CONSTRAINTS, f'{text}# not edited since occ wrote it, SHA-256 {_digest(text)}\n'
    )
    return copy


def _text_there(path: str | Path) -> str:
    """Return the text of the constraints file to be replaced, empty if there is none."""
    check_kind(path, CONSTRAINTS)
    return read_text(path) if Path(path).exists() else ''


def _is_edited(text: str, where: str) -> bool:
    """Return whether a file was edited since it was learned, comments included."""
    if not text:
        return False
    text = _SEAL.sub('', text)
    content = parse_constraints(text, where)
    # We write no comments; texts may contain the character.
    return content.is_edited or ('#' in text and text.count('#') != content.dumps().count('#'))


def _is_sealed(text: str) -> bool:
    seal = _SEAL.search(text)
    return seal is not None and seal[1] == _digest(text[: seal.start()])


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()


def _keep_edited(path: str | Path, is_edited: bool, allowed: bool) -> Path | None:
    """Keep a copy of an edited file, and return its path.

    Raises:
        ConfigurationError: it may not be replaced, or no copy can be written.
    """
    if not is_edited:
        return None
    if not allowed:
        raise ConfigurationError(
            f'{path} was edited since it was learned (rules changed, disabled or noted, or '
            'comments added); choose another file, or allow overwriting (--overwrite), which '
            'keeps a copy'
        )
    return keep_copy(path)


def parse_constraints(text: str, where: str) -> Constraints:
    """Read the text of a constraints file; ``where`` names it in messages.

    Raises:
        ConfigurationError: the text is not valid; the sentence names line, key and value.
    """
    document = parse_yaml(text, where)
    if isinstance(document, dict) and 'rules' not in document:
        for key, kind in _OTHER_KINDS.items():
            if key in document:
                raise ConfigurationError(
                    f'{where} is {kind}, not a constraints file, which has rules'
                )
    _check_version(document, where)
    validate(document, _SCHEMA, where, text=text)
    rule_set = _rule_set(document, where, text)
    return Constraints(
        rule_set,
        document.get('feature_map'),
        document.get('tree'),
        document.get('learner', {}),
        document.get('coverage', {}),
        document.get('provenance', {}),
        document.get('evidence', {}),
        document.get('safe_set', {}),
    )


def rule_set_document(rule_set: RuleSet) -> dict[str, Any]:
    """Return the keys ``features`` and ``rules`` of a constraints file."""
    space = rule_set.space
    return {
        'features': [
            {
                'name': feature.name,
                'unit': feature.unit,
                **({'family': feature.family} if feature.family else {}),
                'bounds': [_finite_or_none(feature.low), _finite_or_none(feature.high)],
                'demonstrated': [float(low), float(high)],
            }
            for feature, (low, high) in zip(space.features, rule_set.demonstrated, strict=True)
        ],
        'rules': [_rule_document(rule, space) for rule in rule_set.rules],
    }


def read_rule_set(document: Any, where: str) -> RuleSet:
    """Return the rule set of what :func:`rule_set_document` returns, as it comes from elsewhere.

    Raises:
        ConfigurationError: it is none; the sentence names key and value.
    """
    content = {'schema_version': _SCHEMA_VERSION, **document}
    validate(content, _SCHEMA, where)
    return _rule_set(content, where)


def _rule_set(document: Mapping[str, Any], where: str, text: str | None = None) -> RuleSet:
    try:
        space = FeatureSpace(tuple(_feature(item) for item in document['features']))
        demonstrated = np.array(
            [item['demonstrated'] for item in document['features']], dtype=np.float64
        )
        rules = tuple(
            _rule(item, ('rules', index), space) for index, item in enumerate(document['rules'])
        )
        rule_set = RuleSet(space, rules, demonstrated)
        _check_units(document)
    except _KeyError as error:
        raise ConfigurationError(f'{locate(error.path, where, text)}{error}') from error
    except (OccError, OverflowError) as error:
        raise ConfigurationError(f'{where}: {error}') from error
    return rule_set


def _check_version(document: Any, where: str) -> None:
    """Refuse a newer file by its version; otherwise its first new key would look like a typo."""
    version = document.get('schema_version') if isinstance(document, dict) else None
    if isinstance(version, int) and version > _SCHEMA_VERSION:
        raise ConfigurationError(
            f'{where}: schema_version: got {version}, written by a newer occ_constraints_pkg; '
            f'allowed here is {_SCHEMA_VERSION}'
        )


def _check_units(document: Mapping[str, Any]) -> None:
    """Refuse a feature whose unit differs from that of the feature map.

    Only checked if both state a unit. The rest of the map is checked where it is used.
    """
    entries = document.get('feature_map', {}).get('features')
    if not isinstance(entries, list):
        return
    for index, item in enumerate(document['features']):
        for entry in entries:
            if not isinstance(entry, dict) or entry.get('unit') is None or 'unit' not in item:
                continue
            name = str(entry.get('name'))
            # Features of sectors have a number or a direction after their common name.
            is_meant = (
                item['name'].startswith(f'{name}_')
                if 'sectors' in entry
                else (item['name'] == name)
            )
            if is_meant and entry['unit'] != item['unit']:
                raise ConfigurationError(
                    f'features[{index}].unit: got {item["unit"]!r}, but feature_map gives '
                    f'{item["name"]} in {entry["unit"]!r}; allowed is the same unit in both, as '
                    'rules mean the numbers that the map gives'
                )


def _feature(item: Mapping[str, Any]) -> Feature:
    low, high = item.get('bounds', (None, None))
    return Feature(
        item['name'],
        item.get('unit', '1'),
        -math.inf if low is None else float(low),
        math.inf if high is None else float(high),
        item.get('family', ''),
    )


def _rule(item: Mapping[str, Any], path: _Path, space: FeatureSpace) -> Rule:
    return Rule(
        item['id'],
        tuple(
            _literal(literal, (*path, 'literals', index), space)
            for index, literal in enumerate(item['literals'])
        ),
        item.get('enabled', True),
        item.get('note', ''),
        item.get('evaluated', 0),
        item.get('violated', 0),
    )


def _literal(item: Mapping[str, Any], path: _Path, space: FeatureSpace) -> Literal:
    subject: int | tuple[int, ...]
    if 'family' in item:
        subject = _members(item['family'], (*path, 'family'), space)
    elif item['feature'] in space.names:
        subject = space.index(item['feature'])
    else:
        hint = did_you_mean(item['feature'], space.names) or ';'
        raise _KeyError(
            (*path, 'feature'),
            f'got {item["feature"]!r}{hint} allowed are {", ".join(space.names)}',
        )
    try:
        return Literal(subject, item['operator'], float(item['bound']))
    except OccError as error:
        raise _KeyError((*path, 'bound'), str(error).removeprefix('bound: ')) from error


def _members(name: str, path: _Path, space: FeatureSpace) -> tuple[int, ...]:
    families = {space.features[members[0]].family: members for members in space.families}
    if name in families:
        return families[name]
    is_single = any(feature.family == name for feature in space.features)
    what = ', a family of one feature' if is_single else did_you_mean(name, families)
    raise _KeyError(
        path,
        f'got {name!r}{what}{"" if what.endswith("?") else ";"} '
        + (
            f'allowed are families of two or more features: {", ".join(families)}'
            if families
            else 'allowed is the key feature instead, as no two features are of one family'
        ),
    )


def literal_documents(rule: Rule, space: FeatureSpace) -> list[dict[str, Any]]:
    """Return the literals of a rule as a constraints file has them."""
    return [
        {
            **(
                {'family': space.features[literal.members[0]].family}
                if literal.is_family
                else {'feature': literal.name(space)}
            ),
            'operator': literal.operator,
            'bound': float(literal.bound),
        }
        for literal in rule.literals
    ]


def _rule_document(rule: Rule, space: FeatureSpace) -> dict[str, Any]:
    document: dict[str, Any] = {
        'id': rule.id,
        'text': rule.words(space),
        'literals': literal_documents(rule, space),
        'enabled': rule.enabled,
    }
    if rule.note:
        document['note'] = rule.note
    document['evaluated'], document['violated'] = rule.evaluated, rule.violated
    return document


def _finite_or_none(number: float) -> float | None:
    return float(number) if math.isfinite(number) else None
