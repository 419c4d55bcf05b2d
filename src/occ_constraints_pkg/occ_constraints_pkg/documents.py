# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""YAML documents that people edit: safe parsing, schema validation, readable output."""

from __future__ import annotations

import difflib
import io
import json
import re
from collections.abc import Iterable, Mapping, Sequence
from functools import partial
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from ruamel.yaml import YAML
from ruamel.yaml.error import MarkedYAMLError, YAMLError
from ruamel.yaml.events import (
    AliasEvent,
    CollectionEndEvent,
    CollectionStartEvent,
    ScalarEvent,
)
from ruamel.yaml.parser import Parser
from ruamel.yaml.representer import SafeRepresenter
from ruamel.yaml.scanner import Scanner

from occ_constraints_pkg import simple_yaml
from occ_constraints_pkg.errors import ConfigurationError
from occ_constraints_pkg.files import DOCUMENT_BYTES, read_bytes

if TYPE_CHECKING:
    from jsonschema import ValidationError

# Three for each split of the deepest tree, plus some.
_MOST_LEVELS = 350
_PATH = re.compile(r'(\w+(?:\.\w+|\[\d+\])*): ')
_PATH_STEP = re.compile(r'\.?([A-Za-z_]\w*)|\[(\d+)\]')
_SURROGATE = re.compile(r'[\ud800-\udfff]')


def load_schema(package: str, name: str) -> dict[str, Any]:
    """Return a JSON schema that is stored as package data next to the code that uses it."""
    return json.loads(resources.files(package).joinpath(name).read_text(encoding='utf-8'))


def read_text(path: str | Path, limit: int = DOCUMENT_BYTES) -> str:
    """Return the text of an ordinary UTF-8 file of at most ``limit`` bytes.

    Raises:
        ConfigurationError: there is no such file, it is a device or a pipe, larger, or not text.
    """
    try:
        text = read_bytes(path, limit).decode('utf-8')
    except UnicodeDecodeError as error:
        raise ConfigurationError(f'cannot read {path}: it is not UTF-8 text') from error
    return text.replace('\r\n', '\n').replace('\r', '\n')


def read_json_object(path: str | Path) -> dict[str, Any]:
    """Return the JSON object that a file holds.

    Raises:
        ConfigurationError: it cannot be read or holds something else.
    """
    text = read_text(path)
    try:
        document = json.loads(text)
        if isinstance(document, dict):
            return document
        problem = f'it holds {_show(document)}'
    except RecursionError:
        problem = 'it is nested too deeply'
    except ValueError as error:
        problem = str(error)
    raise ConfigurationError(f'cannot read {path}: {problem}; allowed is a JSON object')


def parse_yaml(text: str, where: str) -> Any:
    """Parse YAML 1.2 into plain Python values; tags that would build other objects are refused.

    Aliases are refused too: a few lines of them can expand to more data than fits in memory.

    Raises:
        ConfigurationError: the text is not such a document; names ``where`` and the line.
    """
    try:
        return simple_yaml.read(text, _load)
    except (simple_yaml.NotSimpleError, *_LOAD_ERRORS):
        # A mistake is looked up in the whole text, for its line.
        pass
    try:
        return _load(text)
    except _RefusedError as error:
        raise ConfigurationError(f'{where}, line {error.line}: {error}') from error
    except MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        line = '' if mark is None else f', line {mark.line + 1}'
        problem = ' '.join((error.problem or error.context or 'unreadable').split())
        raise ConfigurationError(f'{where}{line} is not valid YAML: {problem}') from error
    except _LOAD_ERRORS as error:
        problem = str(error).strip().partition('\n')[0] or type(error).__name__
        raise ConfigurationError(f'{where} is not valid YAML: {problem}') from error


def validate(
    document: Any, schema: Mapping[str, Any], where: str, *, text: str | None = None
) -> None:
    """Check a document against a JSON schema (draft 2020-12).

    Args:
        document: plain Python values.
        schema: the JSON schema.
        where: what the sentence calls the document, usually its file name.
        text: the YAML text the document came from; with it the sentence names the line.

    Raises:
        ConfigurationError: ``WHERE, line N: key.path: got X; allowed ...`` for the most relevant
            error; an unknown key comes first, because its misspelling explains a missing one.
    """
    # Imported late: it takes as long as all the rest, and every command would wait for it.
    from jsonschema import Draft202012Validator
    from jsonschema.exceptions import best_match

    try:
        errors = list(Draft202012Validator(schema).iter_errors(document))
        if not errors:
            return
        unknown = [error for error in errors if error.validator == 'additionalProperties']
        error = unknown[0] if unknown else best_match(errors)
    except RecursionError as deep:
        raise ConfigurationError(
            f'{where} is nested too deeply; allowed are a hundred levels at most'
        ) from deep
    path = list(error.absolute_path)
    sentence = _sentence(error)
    if error in unknown:
        path.append(_unknown_keys(error)[0])
    raise ConfigurationError(f'{locate(path, where, text)}{sentence}')


def locate(path: Sequence[str | int], where: str, text: str | None = None) -> str:
    """Return how a sentence about a key begins, such as ``c.yaml, line 3: rules[0].id: ``.

    Args:
        path: keys and positions that lead to it.
        where: what the sentence calls the document, usually its file name.
        text: the YAML text the document came from; with it the line is named.
    """
    return f'{_start(path, where, text)}: {_key_path(path)}'


def with_line(sentence: str, where: str, text: str | None) -> str:
    """Return a sentence that begins with a path such as ``features[2].unit: `` with its line.

    Args:
        sentence: see above; without a path it is about the whole document.
        where: what it calls the document.
        text: the YAML text the document came from, to name the line; None where it is not known.
    """
    found = _PATH.match(sentence)
    steps = _PATH_STEP.findall(found[1]) if found else []
    path = [int(index) if index else key for key, index in steps]
    return f'{_start(path, where, text)}: {sentence}'


def _start(path: Sequence[str | int], where: str, text: str | None) -> str:
    line = None if text is None else _line(text, path)
    return where if line is None else f'{where}, line {line}'


def _key_path(path: Iterable[str | int]) -> str:
    """Render a path into a document as ``features[2].bounds: ``, and the top as nothing."""
    text = ''
    for step in path:
        text += f'[{step}]' if isinstance(step, int) else f'.{step}' if text else str(step)
    return f'{text}: ' if text else ''


def did_you_mean(got: str, allowed: Iterable[str]) -> str:
    """Return ``; did you mean 'x'?`` for the allowed word closest to ``got``, or nothing."""
    close = difflib.get_close_matches(str(got), list(allowed), n=1)
    return f'; did you mean {close[0]!r}?' if close else ''


def dump_yaml(document: Any) -> str:
    """Write a document of plain values and NumPy numbers as readable YAML 1.2.

    Floats are exact (shortest repr; ``.inf`` and ``.nan`` in YAML's spelling), keys keep their
    order, the innermost lists and mappings are on one line, and there are no aliases.
    """
    plain = _plain(document)
    text = simple_yaml.write(plain, partial(_dump, allow_unicode=True))
    # Unescaped, these are line breaks to a YAML reader.
    return _dump(plain, allow_unicode=False) if set(text) & set('\x85\u2028\u2029') else text


def _load(text: str) -> Any:
    return _yaml().load(text)


def _dump(plain: Any, *, allow_unicode: bool) -> str:
    yaml, stream = _yaml(), io.StringIO()
    yaml.allow_unicode = allow_unicode
    yaml.dump(plain, stream)
    return stream.getvalue()


class _RefusedError(Exception):
    """A feature of YAML that is not allowed here."""

    def __init__(self, sentence: str, line: int) -> None:
        super().__init__(sentence)
        self.line = line + 1


# Constructors of the YAML library raise various types, for example for a list as a key.
_LOAD_ERRORS = (
    _RefusedError,
    YAMLError,
    ValueError,
    TypeError,
    AttributeError,
    LookupError,
    RecursionError,
)


class _TooDeepError(_RefusedError):
    def __init__(self, line: int) -> None:
        super().__init__(f'nested too deeply; allowed are {_MOST_LEVELS} levels at most', line)


class _Scanner(Scanner):
    """Refuses deep brackets before it looks behind them, which takes the square of their number."""

    def fetch_flow_collection_start(self, *args: Any, **options: Any) -> None:
        super().fetch_flow_collection_start(*args, **options)
        if self.flow_level > _MOST_LEVELS:
            raise _TooDeepError(self.reader.line)


class _Parser(Parser):
    """Refuses aliases, deep nesting and halves of surrogate pairs."""

    _levels = 0

    def get_event(self) -> Any:
        event = super().get_event()
        if isinstance(event, AliasEvent):
            raise _RefusedError(
                f'got the alias *{event.anchor}; write the value out instead, aliases are not '
                'allowed',
                event.start_mark.line,
            )
        if isinstance(event, ScalarEvent) and _SURROGATE.search(event.value):
            raise _RefusedError(
                f'got {_show(event.value)}; allowed are whole characters, not halves of a '
                'surrogate pair',
                event.start_mark.line,
            )
        if isinstance(event, CollectionStartEvent):
            self._levels += 1
            if self._levels > _MOST_LEVELS:
                raise _TooDeepError(event.start_mark.line)
        elif isinstance(event, CollectionEndEvent):
            self._levels -= 1
        return event


class _Representer(SafeRepresenter):
    """Quotes text that the dumper would leave unquoted although it has another meaning."""

    def represent_str(self, data: str) -> Any:
        style = "'" if data[:1] in simple_yaml.QUOTED_STARTS else None
        return self.represent_scalar('tag:yaml.org,2002:str', data, style=style)


_Representer.add_representer(str, _Representer.represent_str)


def _yaml() -> YAML:
    yaml = YAML(typ='safe', pure=True)
    yaml.Scanner = _Scanner
    yaml.Parser = _Parser
    yaml.Representer = _Representer
    yaml.default_flow_style = None
    yaml.sort_base_mapping_type_on_output = False  # type: ignore[assignment]
    yaml.width = 100
    return yaml


def _plain(value: Any) -> Any:
    """Copy ``value`` into dicts, lists and Python scalars for the safe dumper."""
    if isinstance(value, Mapping):
        return {_plain(key): _plain(item) for key, item in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        return _plain(value.tolist())
    if isinstance(value, Sequence) and not isinstance(value, str | bytes):
        return [_plain(item) for item in value]
    return value


def _sentence(error: ValidationError) -> str:
    """Describe one jsonschema error: what was found and what is allowed."""
    got, rule = error.instance, error.validator_value
    match error.validator:
        case 'additionalProperties':
            names = list(error.schema.get('properties', {}))
            key = _unknown_keys(error)[0]
            hint = did_you_mean(key, names) or ';'
            return f'unknown key{hint} allowed keys are {", ".join(names)}'
        case 'required':
            missing = [key for key in rule if key not in got]
            return f'the key {missing[0]!r} is missing; required are {", ".join(rule)}'
        case 'type':
            kinds = [rule] if isinstance(rule, str) else rule
            return f'got {_show(got)}; allowed is {" or ".join(_KINDS[kind] for kind in kinds)}'
        case 'enum':
            hint = did_you_mean(got, rule) if isinstance(got, str) else ''
            return f'got {_show(got)}{hint or ";"} allowed are {", ".join(map(str, rule))}'
        case 'const':
            return f'got {_show(got)}; allowed is {_show(rule)}'
        case 'oneOf' | 'anyOf' if all('required' in branch for branch in rule):
            keys = [key for branch in rule for key in branch['required']]
            found = [key for key in keys if key in got]
            number = 'exactly' if error.validator == 'oneOf' else 'at least'
            return f'got {", ".join(found) or "none"} of the keys {", ".join(keys)}; ' + (
                f'{number} one of them is allowed'
            )
    limit = _LIMITS.get(error.validator)
    allowed = f'{limit} {_show(rule)}' if limit else error.schema.get('description', error.message)
    return f'got {_show(got)}; allowed is {allowed}'


_KINDS = {
    'object': 'a mapping of keys',
    'array': 'a list',
    'string': 'text',
    'number': 'a number',
    'integer': 'a whole number',
    'boolean': 'true or false',
    'null': 'null',
}
_LIMITS = {
    'minimum': 'a number of at least',
    'maximum': 'a number of at most',
    'exclusiveMinimum': 'a number above',
    'exclusiveMaximum': 'a number below',
    'minItems': 'a list no shorter than',
    'maxItems': 'a list no longer than',
    'minLength': 'text no shorter than',
    'maxLength': 'text no longer than',
}


def _unknown_keys(error: ValidationError) -> list[str]:
    return [key for key in error.instance if key not in error.schema.get('properties', {})]


def _show(value: Any) -> str:
    text = 'null' if value is None else repr(value)
    return text if len(text) <= 60 else f'{text[:57]}...'


def _line(text: str, path: Sequence[str | int]) -> int | None:
    """Return the line, from 1, of the key at ``path``, or of the closest place above it."""
    try:
        node = _yaml().compose(text)
        line = node.start_mark.line
    except (YAMLError, AttributeError):
        return None
    for step in path:
        try:
            if isinstance(step, int):
                node = node.value[step]
                line = node.start_mark.line
            else:
                key, node = next(pair for pair in node.value if pair[0].value == str(step))
                line = key.start_mark.line
        except (AttributeError, IndexError, StopIteration, TypeError):
            break
    return line + 1
