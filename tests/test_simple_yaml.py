# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""What is read and written without the YAML library is what the library reads and writes."""

import math

import pytest
from hypothesis import assume, given, reject, settings
from hypothesis import strategies as st
from occ_constraints_pkg.documents import _LOAD_ERRORS, _dump, _load, dump_yaml, parse_yaml
from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.simple_yaml import read
from ruamel.yaml.error import YAMLError

SCALARS = st.none() | st.booleans() | st.integers() | st.text(max_size=20)
WORDS = st.text('aZ09_./^()- <>=:#,"\'?*&!%@`\t\n\u00e9\u2028', max_size=12)
COMMON = (
    WORDS
    | st.sampled_from(['<', '<=', '>', '>=', '1', '', 'null', 'True', 'no', 'v_x above 1.5 m/s'])
    | st.text('ab ', min_size=60, max_size=130)
    | st.floats()
    | st.floats(-3, 3)
    | SCALARS
)


DOCUMENTS = st.recursive(
    COMMON,
    lambda inner: (
        st.lists(inner, max_size=6)
        | st.dictionaries(WORDS | st.sampled_from(['id', 'literals', 'x']), inner, max_size=6)
    ),
    max_leaves=25,
)


@settings(max_examples=150)
@given(DOCUMENTS)
def test_what_is_written_without_the_library_is_what_it_writes(document):
    text = dump_yaml(document)
    if not set(text) & set('\x85\u2028\u2029'):
        assert text in (_dump(document, allow_unicode=True), _dump(document, allow_unicode=False))


@settings(max_examples=60)
@given(DOCUMENTS, st.integers(0, 60), st.booleans())
def test_so_is_what_is_nested_deeply(document, levels, in_lists):
    for _ in range(levels):
        document = {'x': 1, 'y': [document, {'z': [[0]]}] if in_lists else document}
    text = dump_yaml(document)
    if not set(text) & set('\x85\u2028\u2029'):
        assert text in (_dump(document, allow_unicode=True), _dump(document, allow_unicode=False))
    try:
        expected = _load(text)
    except YAMLError:
        # Near the end of a line the library folds keys so that it cannot read them itself.
        reject()
    assert same(parse_yaml(text, 'text'), expected)


def same(one, other):
    """Return whether two documents are equal, types and NaN included."""
    if isinstance(one, dict):
        return (
            isinstance(other, dict)
            and list(one) == list(other)
            and all(same(one[key], other[key]) for key in one)
        )
    if isinstance(one, list):
        return isinstance(other, list) and len(one) == len(other) and all(map(same, one, other))
    if isinstance(one, float) and math.isnan(one):
        return isinstance(other, float) and math.isnan(other)
    return type(one) is type(other) and repr(one) == repr(other)


def assert_reads_as_the_library(text):
    __tracebackhide__ = True
    try:
        expected = _load(text)
    except _LOAD_ERRORS:
        with pytest.raises(OccError):
            parse_yaml(text, 'text')
    else:
        assert same(parse_yaml(text, 'text'), expected)


PIECES = [
    ' ',
    '  ',
    '\n',
    '- ',
    '#',
    ' # ',
    "'",
    '"',
    '{',
    '}',
    '[',
    ']',
    ': ',
    ':',
    ', ',
    '|\n',
    '-',
]
PIECES += [
    '\t',
    '&a ',
    '*a',
    '!!str ',
    '---\n',
    '...\n',
    '%',
    '? ',
    '0',
    '1e3',
    'x: 1\n',
    '\n\n',
    '  y',
]


@settings(max_examples=400)
@given(
    st.dictionaries(st.sampled_from(['a', 'rules', 'note', 'id']), DOCUMENTS, min_size=1),
    st.lists(st.tuples(st.floats(0, 1), st.integers(0, 3), st.sampled_from(PIECES)), max_size=4),
)
def test_any_text_is_read_as_by_the_library(document, changes):
    text = dump_yaml(document)
    for place, removed, piece in changes:
        at = int(place * len(text))
        text = text[:at] + piece + text[at + removed :]
    assume('\ud800' not in text)
    assert_reads_as_the_library(text)


RULE = """\
- id: R1
  text: x above 1.5 m
  literals:
  - {feature: x, operator: '>', bound: 1.5}
  enabled: true
"""


@pytest.mark.parametrize(
    'text',
    [
        f'note: "abc\nrules:\n{RULE}end"\nlast: 1\n',
        f'note: "abc\nrules:\n{RULE}last: "\n',
        f"note: 'abc\nrules:\n{RULE}",
        f'note: [abc,\nrules:\n{RULE}]\n',
        f'note: |\n  abc\n\nrules:\n{RULE}# the end\n',
        f'# first\n\nrules:\n# second\n{RULE}  # third\n  note: x\n\n\n{RULE}',
        f'rules:\n{RULE}rules:\n{RULE}',
        f'rules:\n{RULE}  id: R2\n',
        f'---\nrules:\n{RULE}',
        f'rules:\n{RULE}---\n{RULE}',
        f'%YAML 1.1\n---\nrules:\n{RULE}  note: yes\n',
        'a: b\n c\n',
        'a: b\n\n  c\nd: 1\n',
        'a: 1\n  2\n',
        'a:\n- b\n  c\n- d\n',
        'a:\n- - b\n  - c\n-\n- {}\n',
        'a:\n  - b\n  - {c: 1, c: 2}\n',
        'a:\n    b: 1\n    c: 2\n',
        'a:\nb:\n',
        'a: {b: 1,\n  c: 2}\nd: 012\n',
        'a: 1_000\nb: +1\nc: 0x1F\nd: 1.\ne: .5\nf: 1.5e3\ng: 2001-01-01\n',
        'a: yes\nb: No\nc: NULL\nd: ~\ne: .inf\nf: True\n',
        'null: 1\ntrue: 2\n1: 3\n',
        '- a\n- b\n',
        'a\n',
        '',
        '# nothing\n',
        'a: 1',
        'a: 1 \nb: x  y\n',
        'a: {b: }\nc: { d: 1 }\ne: [1, ]\nf: [ ]\n',
        'a: &x b\nc: *x\n',
        'a: x\u2028b: y\n',
    ],
)
def test_texts_that_are_not_what_they_seem(text):
    assert_reads_as_the_library(text)


def test_the_library_is_asked_only_for_what_is_not_simple():
    asked = []

    def library(text):
        asked.append(text.strip())
        return _load(text)

    text = f'v: 1\nrules:\n{RULE}{RULE}  note: "it\'s"\nlearner: {{alpha: 0.1,\n    nu: null}}\n'
    assert same(read(text, library), _load(text))
    assert asked == ['note: "it\'s"', 'learner: {alpha: 0.1,\n    nu: null}']
