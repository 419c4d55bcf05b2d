# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
import math
import struct
import time

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from occ_constraints_pkg.documents import (
    dump_yaml,
    parse_yaml,
    read_json_object,
    read_text,
    validate,
)
from occ_constraints_pkg.errors import OccError

SCALARS = st.none() | st.booleans() | st.integers() | st.text(max_size=20)
PLAIN = st.recursive(
    SCALARS,
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=8), inner),
    max_leaves=12,
)


@given(st.lists(st.floats(), min_size=1))
def test_floats_come_back_bit_for_bit(numbers):
    back = parse_yaml(dump_yaml({'values': numbers}), 'text')['values']
    assert all(isinstance(value, float) for value in back)
    for one, other in zip(numbers, back, strict=True):
        # YAML has one NaN only.
        same = struct.pack('<d', one) == struct.pack('<d', other)
        assert same or (math.isnan(one) and math.isnan(other))


@given(PLAIN)
def test_plain_values_come_back(document):
    assert parse_yaml(dump_yaml(document), 'text') == document


def test_written_readably():
    bounds = [0.1, np.float32(0.5)]
    text = dump_yaml({'z': (1, 2), 'a': [{'name': 'x', 'low': bounds}, {'low': bounds}]})
    assert text == 'z: [1, 2]\na:\n- name: x\n  low: [0.1, 0.5]\n- low: [0.1, 0.5]\n'


@pytest.mark.parametrize(
    ('text', 'sentence'),
    [
        ('a: [1', 'FILE, line 1 is not valid YAML'),
        ('a: 1\nb: 2\na: 3', 'FILE, line 3 is not valid YAML: found duplicate key "a"'),
        ('a: !!python/object/apply:os.system [true]', 'could not determine a constructor'),
        ('a: &x [1]\nb: *x', 'FILE, line 2: got the alias *x'),
        ('a: 2001-99-99', 'is not valid YAML'),
        ('[' * 1000, 'FILE, line 1: nested too deeply; allowed are 350 levels at most'),
        ('a: [b, "\\ud800"]', "FILE, line 1: got '\\ud800'; allowed are whole characters"),
        ('a: \x00', 'is not valid YAML'),
        ('? [[a]]\n: b', 'is not valid YAML'),
    ],
)
def test_what_is_not_yaml(text, sentence):
    with pytest.raises(OccError) as caught:
        parse_yaml(text, 'FILE')
    assert sentence in str(caught.value)
    assert '\n' not in str(caught.value)


@pytest.mark.parametrize('text', ['[' * 400_000, '{' * 400_000, '[{' * 200_000])
def test_deep_brackets_are_refused_before_they_are_all_looked_at(text):
    begin = time.process_time()
    with pytest.raises(OccError, match='nested too deeply'):
        parse_yaml(text, 'FILE')
    # Seconds before; some hundredths now.
    assert time.process_time() - begin < 0.5


def test_nesting_that_the_validator_cannot_follow():
    schema = {'$defs': {'list': {'type': 'array', 'items': {'$ref': '#/$defs/list'}}}}
    schema['$ref'] = '#/$defs/list'
    document = []
    for _ in range(900):
        document = [document]
    with pytest.raises(OccError, match='FILE is nested too deeply'):
        validate(document, schema, 'FILE')


def test_files_that_cannot_be_read(tmp_path):
    with pytest.raises(OccError, match='No such file'):
        read_text(tmp_path / 'none.yaml')
    (tmp_path / 'latin.yaml').write_bytes(b'\xff\xfe\xfd')
    with pytest.raises(OccError, match='not UTF-8'):
        read_text(tmp_path / 'latin.yaml')
    (tmp_path / 'a.yaml').write_text('a: 1e-3')
    assert read_text(tmp_path / 'a.yaml') == 'a: 1e-3'


@pytest.mark.parametrize(
    ('schema', 'sentence'),
    [
        ({'type': 'array'}, "FILE, line 1: got {'a': {'b': [1, 'x']}}; allowed is a list"),
        (
            {'properties': {'a': {'properties': {'b': {'items': {'type': 'integer'}}}}}},
            "FILE, line 2: a.b[1]: got 'x'; allowed is a whole number",
        ),
        (
            {'properties': {'a': {'properties': {'b': {'maxItems': 1}}}}},
            "FILE, line 2: a.b: got [1, 'x']; allowed is a list no longer than 1",
        ),
    ],
)
def test_sentence_names_line_key_value_and_what_is_allowed(schema, sentence):
    text = "a:\n  b: [1, 'x']\n"
    with pytest.raises(OccError) as caught:
        validate(parse_yaml(text, 'FILE'), schema, 'FILE', text=text)
    assert str(caught.value) == sentence


def test_text_that_looks_like_a_mark_of_yaml_comes_back():
    document = {'k': {'a': '?x', ':b': ':0'}, 'list': ['?x', ': y'], '? z': '?'}
    assert parse_yaml(dump_yaml(document), 'FILE') == document


@pytest.mark.parametrize(
    ('text', 'sentence'),
    [
        ('{"a": 1', 'cannot read FILE: Expecting'),
        ('[1, 2]', 'cannot read FILE: it holds [1, 2]; allowed is a JSON object'),
        ('{"a": ' * 100_000, 'cannot read FILE: it is nested too deeply'),
        ('', 'cannot read FILE: Expecting value'),
    ],
)
def test_json_that_is_no_object_is_refused(tmp_path, monkeypatch, text, sentence):
    monkeypatch.chdir(tmp_path)
    (tmp_path / 'FILE').write_text(text)
    with pytest.raises(OccError) as error:
        read_json_object('FILE')
    assert str(error.value).startswith(sentence)


def test_a_file_that_is_no_text_is_refused_once(tmp_path):
    file = tmp_path / 'latin'
    file.write_bytes(b'\xff{}')
    with pytest.raises(OccError) as error:
        read_json_object(file)
    assert str(error.value) == f'cannot read {file}: it is not UTF-8 text'
