# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Output that the documents show is what their commands print."""

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
DOCS = ROOT / 'docs'
# A block of commands, and the block of output after it.
STEPS = re.compile(r'```sh\n([^`]*)```\n\n```\n(.*?)```', re.DOTALL)
SHELL_ONLY = ('occ node', 'occ play', 'occ record', 'python')


def test_readme(occ, tmp_path):
    (tmp_path / 'bags').symlink_to(ROOT / 'bags')
    text = (ROOT / 'README.md').read_text(encoding='utf-8')
    assert len(text.splitlines()) <= 160
    steps = STEPS.findall(text)
    assert len(steps) == 2
    for commands, shown in steps:
        _assert_shows(shown, ''.join(occ(line)[1] for line in _lines(commands, tmp_path)))


def test_data(occ, tmp_path):
    (tmp_path / 'bags').symlink_to(ROOT / 'bags')
    text = (DOCS / 'data.md').read_text(encoding='utf-8')
    (program,) = re.findall(r'```python\n(.*?)```', text, re.DOTALL)
    exec(compile(program, 'data.md', 'exec'), {})
    steps = STEPS.findall(text)
    assert len(steps) == 2
    for commands, shown in steps:
        _assert_shows(shown, ''.join(occ(line)[1] for line in _lines(commands, tmp_path)))


def test_checking(occ, tmp_path):
    pytest.importorskip('matplotlib', reason="needs the extra 'report'")
    (tmp_path / 'bags').symlink_to(ROOT / 'bags')
    text = (DOCS / 'checking.md').read_text(encoding='utf-8')
    check, learn, warn = re.findall(r'```sh\n(.*?)```', text, re.DOTALL)
    (shown,) = re.findall(r'prints:\n\n```\n(.*?)```', text, re.DOTALL)
    (warned,) = re.findall(r'same forecasts:\n\n```\n(.*?)```', text, re.DOTALL)
    printed = [occ(line)[1] for line in _lines(learn + check + warn, tmp_path)]
    _assert_shows(shown, printed[-2])
    assert printed[-1] == printed[-2] + warned


def test_the_comparison_of_two_files(occ, tmp_path):
    (tmp_path / 'bags').symlink_to(ROOT / 'bags')
    _, text = (DOCS / 'constraints_file.md').read_text(encoding='utf-8').split('## What changed')
    ((commands, shown),) = STEPS.findall(text.partition('## What is written')[0])
    *_, printed = [occ(line)[1] for line in _lines(commands, tmp_path)]
    _assert_shows(shown, printed)


def test_the_example_of_the_paper(occ, tmp_path):
    (tmp_path / 'bags').symlink_to(ROOT / 'bags')
    text = (DOCS / 'method.md').read_text(encoding='utf-8')
    _, text = text.split("**The paper's example**")
    text, _ = text.split('## 7.')
    commands, learned, pruned = re.findall(r'```(?:sh)?\n(.*?)```', text, re.DOTALL)
    learn, _, prune = [occ(line)[1] for line in _lines(commands, tmp_path)]
    _assert_shows(learned, learn)
    _assert_shows(pruned, prune)


def test_the_corner_of_the_paper_without_other_options(occ, tmp_path):
    (tmp_path / 'bags').symlink_to(ROOT / 'bags')
    _, text = (DOCS / 'method.md').read_text(encoding='utf-8').split('## 8. Conditional rules')
    ((commands, shown),) = STEPS.findall(text.partition('## Reproducing')[0])
    _assert_shows(shown, ''.join(occ(line)[1] for line in _lines(commands, tmp_path)))


def test_the_table_of_planted_problems_is_that_of_the_results():
    text = (DOCS / 'method.md').read_text(encoding='utf-8')
    results = (DOCS / 'results' / 'planted.md').read_text(encoding='utf-8').splitlines()
    cells = {tuple(row[:3]): row for row in (line.strip('| ').split(' | ') for line in results)}
    table = re.findall(r'^\| ([AB]\d), .*?\| (.*) \|$', text, re.MULTILINE)
    assert len(table) == 12
    for problem, line in table:
        numbers = [cells[problem, size, 'ours'] for size in ('1e4', '1e5')]
        shown = [row[index] for row in numbers for index in (4, 9, 11)]
        shown += [cells[problem, '1e4', method][4] for method in ('box', 'CART')]
        assert line.split(' | ') == shown


def test_the_tutorial_on_recordings_of_a_robot(occ, tmp_path):
    robots = Path(os.environ.get('OCC_TEST_DATA', ROOT.parent / 'shared' / 'data')) / 'robots'
    if not robots.is_dir():
        pytest.skip(f'no test data at {robots}; set OCC_TEST_DATA')
    pytest.importorskip('matplotlib', reason="needs the extra 'report'")
    (tmp_path / 'bags').symlink_to(robots.resolve())
    text = (DOCS / 'your_robot.md').read_text(encoding='utf-8')
    steps = [item for item in STEPS.findall(text) if not item[0].startswith(SHELL_ONLY)]
    assert len(steps) == 5
    for commands, shown in steps:
        printed = ''.join(occ(line)[1] for line in _lines(commands, tmp_path))
        _assert_shows(shown, printed)
    (shown_map,) = re.findall(r'```yaml\n(.*?)```', text, re.DOTALL)
    _assert_shows(shown_map, (tmp_path / 'my_robot.yaml').read_text())


def test_the_tutorial_on_a_simulated_arm(occ, tmp_path):
    pytest.importorskip('mujoco', reason="needs the extra 'train'")
    pytest.importorskip('matplotlib', reason="needs the extra 'report'")
    (tmp_path / 'scripts').symlink_to(ROOT / 'scripts')
    text = (DOCS / 'your_arm.md').read_text(encoding='utf-8')
    # The first and the last run live, beside the recorder and the monitor.
    _, recording, _ = re.findall(r'```sh\n(python [^`]*)```', text)
    for line in _lines(recording, tmp_path):
        subprocess.run([sys.executable, *line.split()], cwd=tmp_path, check=True, timeout=120)
    steps = [item for item in STEPS.findall(text) if not item[0].startswith(SHELL_ONLY)]
    assert len(steps) == 6
    for commands, shown in steps:
        _assert_shows(shown, ''.join(occ(line)[1] for line in _lines(commands, tmp_path)))
    (shown_map,) = re.findall(r'```yaml\n(.*?)```', text, re.DOTALL)
    _assert_shows(shown_map, (tmp_path / 'arm.yaml').read_text())


def test_recordings_of_traffic(occ, tmp_path):
    driving = Path(os.environ.get('OCC_TEST_DATA', ROOT.parent / 'shared' / 'data')) / 'driving'
    if not driving.is_dir():
        pytest.skip(f'no test data at {driving}; set OCC_TEST_DATA')
    (tmp_path / 'driving').symlink_to(driving.resolve())
    text = (DOCS / 'driving.md').read_text(encoding='utf-8')
    ((commands, shown),) = STEPS.findall(text)
    _assert_shows(shown, ''.join(occ(line)[1] for line in _lines(commands, tmp_path)))
    table = re.findall(r'^(\| .* \| `.*` \| [^|]* \|)', text, re.MULTILINE)
    assert len(table) == 20
    results = (DOCS / 'results' / 'ngsim.md').read_text(encoding='utf-8').splitlines()
    assert [line for line in table if line not in results] == []


def _lines(commands, folder):
    """Return the arguments of each command, with patterns of file names filled in."""
    for command in commands.replace('\\\n', ' ').strip().splitlines():
        words = []
        for word in shlex.split(command)[1:]:
            found = sorted(str(path.relative_to(folder)) for path in folder.glob(word))
            words += found if '*' in word else [word]
        yield ' '.join(words)


def _assert_shows(shown, printed):
    """Check that all lines are there, in order; others may stand where three dots are."""
    lines, place = printed.splitlines(), 0
    for line in shown.splitlines():
        if line != '...':
            assert line in lines[place:], f'shown is {line!r}, but printed is:\n{printed}'
            place = lines.index(line, place) + 1
