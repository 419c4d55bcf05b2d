# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""``occ report`` and the pages of other commands: what is on them, and what they do not replace."""

import hashlib
import json
import re

import pytest
from synthetic_bags import write_drive


@pytest.fixture
def place(occ, tmp_path):
    """Return an empty folder, now the current one, with two drives and rules learned from one."""
    write_drive(tmp_path / 'drive', robots=3, steps=60)
    write_drive(tmp_path / 'other', robots=2, steps=50)
    assert (
        occ('learn drive -m simple_nav --clip density --alpha 0.5 --depth 2 -o rules.yaml')[0] == 0
    )
    return tmp_path


def sections(text):
    return re.findall(r'<section id="([\w-]+)"', text)


def test_rules_with_density_and_provenance(occ, place):
    code, out, err = occ('report -c rules.yaml --demonstrations drive -o rules.html')
    assert (code, err) == (0, '')
    assert 'Written to rules.html' in out
    text = (place / 'rules.html').read_text()
    assert sections(text)[:2] == ['rules', 'picture']
    assert hashlib.sha256((place / 'rules.yaml').read_bytes()).hexdigest() in text
    assert 'data-bound' not in text.partition('<script')[0]
    text = text.replace('http://www.w3.org/2000/svg', '')
    assert not re.search(r'(?:src|href)="(?!data:|#)|https?://|@import|url\((?!#)', text)


def test_recordings_are_judged_as_by_check(occ, place):
    code, out, _ = occ('report -c rules.yaml drive other -o drives.html --json')
    assert code == 0
    written = json.loads(out)
    assert written['bytes'] == (place / 'drives.html').stat().st_size
    assert written['sections'][0] == 'Recordings'
    text = (place / 'drives.html').read_text()
    checked = json.loads(occ('check -c rules.yaml drive other --json')[1])
    data = json.loads(re.search(r'id="data">(.*?)</script>', text).group(1))
    listed = sum(len(item['violations']) for item in data['recordings'])
    assert listed == len(checked['violations']) > 0
    assert [item['name'] for item in data['recordings']] == ['drive', 'other']
    assert len(re.findall(r'\b[0-9a-f]{64}\b', text)) >= 4


def test_check_writes_the_page_with_its_settings(occ, place):
    code, _, err = occ('check -c rules.yaml other --bridge 0.25 --html other.html')
    assert (code, err) == (1, '')
    text = (place / 'other.html').read_text()
    assert re.search(r'bridge \[s\]</th><td>0.25<', text)
    assert 'recordings' in sections(text)


def test_without_an_enabled_rule_nothing_is_called_safe(occ, place):
    rules = (place / 'rules.yaml').read_text().replace('enabled: true', 'enabled: false')
    (place / 'none.yaml').write_text(rules)
    code, _, err = occ('report -c none.yaml other -o none.html')
    assert code == 0
    assert 'every verdict is UNKNOWN' in err
    text = (place / 'none.html').read_text()
    assert '100.00% UNKNOWN' in text
    assert 'no rule is enabled' in text


@pytest.mark.parametrize('line', ['report -c rules.yaml', 'report -c rules.yaml other'])
def test_a_page_of_somebody_else_is_kept(occ, place, line):
    mine = '<!doctype html>\n<title>mine</title>\n'
    (place / 'mine.html').write_text(mine)
    code, _, err = occ(f'{line} -o mine.html')
    assert code == 2
    assert 'not a page written by occ' in err
    assert (place / 'mine.html').read_text() == mine
    assert occ(f'{line} -o own.html')[0] == 0
    assert occ(f'{line} -o own.html')[0] == 0


@pytest.mark.parametrize(
    ('line', 'words'),
    [
        ('report', 'nothing to report on'),
        ('report other', 'nothing to report on'),
        ('report -c rules.yaml -o rules.yaml', 'allowed is a name that ends in .html'),
        ('report --training drive', 'holds no training'),
        ('report --training nowhere -c rules.yaml', 'holds no training'),
        ('report -c missing.yaml', 'cannot read missing.yaml'),
    ],
)
def test_mistakes_are_one_sentence(occ, place, line, words):
    code, out, err = occ(line)
    assert (code, out) == (2, '')
    assert words in err
    assert err.count('\n') == 1
    assert not (place / 'report.html').exists()


def test_names_and_notes_are_text(occ, place):
    hostile = '</script><img src=x onerror=alert(1)>'
    text = (place / 'rules.yaml').read_text()
    text, count = re.subn(
        r'(?m)^( +)enabled: true(?:\n +note: .*)?$',
        rf"\1enabled: true\n\1note: '{hostile}'",
        text,
        count=1,
    )
    assert count == 1
    (place / 'rules.yaml').write_text(text)
    assert occ('report -c rules.yaml other -o page.html')[0] == 0
    page = (place / 'page.html').read_text()
    assert hostile not in page
    assert '&lt;img src=x' in page


@pytest.mark.slow
def test_a_training_and_an_evaluation(occ, place):
    pytest.importorskip('torch')
    line = 'train simple_nav --steps 1024 --robots 4 --set rollout_steps=128 --processes 1 -o run'
    code, out, err = occ(line)
    assert code == 0, err
    assert 'report.html' in out
    text = (place / 'run' / 'report.html').read_text()
    assert sections(text) == ['training', 'course', 'settings']
    assert 'learner: rollout steps</th><td>128<' in text
    assert occ('report --training run -o run.html')[0] == 0
    assert occ('report --training run -c rules.yaml -o both.html')[0] == 0
    assert sections((place / 'both.html').read_text())[0] == 'rules'
    code, _, err = occ('evaluate run/policy.npz --episodes 2 --html scores.html')
    assert code == 0, err
    text = (place / 'scores.html').read_text()
    assert sections(text) == ['evaluation', 'settings']
    assert 'run/policy.npz' in text


@pytest.mark.parametrize(
    ('name', 'text', 'words'),
    [
        ('summary.json', '{"settings": 3}', 'settings: got 3; allowed are names and values'),
        ('summary.json', '[1]', 'allowed is a JSON object'),
        ('curves.png', 'not a picture', 'curves.png is damaged: it is no PNG'),
        ('constraints.yaml', '', 'allowed is a mapping of keys'),
    ],
)
def test_a_damaged_training_is_told_in_one_sentence(occ, place, name, text, words):
    pytest.importorskip('torch')
    write_training(place / 'run')
    (place / 'run' / name).write_text(text)
    code, out, err = occ('report --training run')
    assert (code, out) == (2, '')
    assert words in err
    assert err.count('\n') == 1


def test_a_limit_of_cost_that_is_no_number_is_shown_as_it_is(occ, place):
    pytest.importorskip('torch')
    write_training(place / 'run')
    (place / 'run' / 'summary.json').write_text('{"settings": {"cost_limit": "<b>"}}')
    assert occ('report --training run')[0] == 0
    assert '&lt;b&gt; allowed' in (place / 'report.html').read_text()


def write_training(folder):
    """Write the metrics of a training of one update."""
    folder.mkdir()
    line = {'updates': 1, 'steps': 512, 'mean_return': 1.0, 'mean_cost': 2.0, 'multiplier': 0.5}
    (folder / 'metrics.jsonl').write_text(json.dumps(line) + '\n')
