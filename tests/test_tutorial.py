# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The output in docs/your_robot.md is what its commands print."""

import os
import re
import shlex
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
# A block of commands, and the block of output after it.
STEPS = re.compile(r'```sh\n(.*?)```\n\n```\n(.*?)```', re.DOTALL)
SHELL_ONLY = ('occ node', 'occ play')


def test_commands_print_what_the_tutorial_shows(occ, tmp_path):
    robots = Path(os.environ.get('OCC_TEST_DATA', ROOT.parent / 'shared' / 'data')) / 'robots'
    if not robots.is_dir():
        pytest.skip(f'no test data at {robots}; set OCC_TEST_DATA')
    pytest.importorskip('matplotlib', reason="needs the extra 'report'")
    (tmp_path / 'bags').symlink_to(robots.resolve())
    text = (ROOT / 'docs' / 'your_robot.md').read_text(encoding='utf-8')
    steps = [item for item in STEPS.findall(text) if not item[0].startswith(SHELL_ONLY)]
    assert len(steps) == 5
    for commands, shown in steps:
        printed = ''.join(occ(line)[1] for line in _lines(commands, tmp_path))
        _assert_shows(shown, printed)
    (shown_map,) = re.findall(r'```yaml\n(.*?)```', text, re.DOTALL)
    _assert_shows(shown_map, (tmp_path / 'my_robot.yaml').read_text())


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
            assert line in lines[place:], f'the tutorial shows {line!r}, but printed is:\n{printed}'
            place = lines.index(line, place) + 1
