# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Two runs of a benchmark side by side: a report, whatever it says."""

import json

import pytest

from benchmarks.compare import compare, main


def test_marks_what_changed_notably_and_tells_what_only_one_has():
    before = {'metrics': {'a_ms': 10.0, 'b_ms': 10.0, 'gone': 1.0, 'none': 0.0}, 'machine': 1}
    after = {'metrics': {'a_ms': 11.0, 'b_ms': 15.0, 'new': 1.0, 'none': 0.0}, 'machine': 1}
    a, b, gone, none, new = compare(before, after)
    assert '1.10' in a
    assert not a.endswith('<--')
    assert '1.50' in b
    assert b.endswith('<--')
    assert gone.endswith('only before')
    assert new.endswith('only after')
    assert 'nan' in none
    assert 'machines differ' in compare(before, after | {'machine': 2})[0]


def test_worse_numbers_are_no_error(tmp_path, capsys):
    paths = []
    for name, number in (('before', 1.0), ('after', 100.0)):
        paths.append(str(tmp_path / name))
        (tmp_path / name).write_text(json.dumps({'metrics': {'x_ms': number}}))
    assert main(paths) == 0
    assert '<--' in capsys.readouterr().out


@pytest.mark.parametrize('text', ['', '[]', '{}', '{"metrics": 1}'])
def test_what_is_no_result_is_told_in_a_sentence(tmp_path, capsys, text):
    (tmp_path / 'a').write_text(text)
    assert main([str(tmp_path / 'a')] * 2) == 2
    assert main([]) == 2
    assert main([str(tmp_path / 'none')] * 2) == 2
    assert capsys.readouterr().err.count('error: ') == 3
