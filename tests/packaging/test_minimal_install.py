# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Without any extra, rules can be learned and shown, bags checked, and pages written."""

import subprocess
import sys
from pathlib import Path

import pytest

# Imports as an installation without extras would do them.
PROLOGUE = """
import sys
class Absent:
    def find_spec(self, name, path=None, target=None):
        if name.partition('.')[0] in (
            'torch', 'mujoco', 'rclpy', 'matplotlib', 'textual', 'sklearn', 'pandas'
        ):
            raise ModuleNotFoundError(f'No module named {name!r}', name=name)
sys.meta_path.insert(0, Absent())
"""


def run(code: str, folder: Path | None = None) -> subprocess.CompletedProcess:
    return subprocess.run(
        [sys.executable, '-c', PROLOGUE + code], cwd=folder, capture_output=True, text=True
    )


def test_all_but_pictures_is_imported_without_extras():
    done = run(
        'import importlib, pkgutil, occ_constraints_pkg as top\n'
        "for room in ('rules', 'learning', 'features', 'rosbag', 'datasets', 'checking', 'report', "
        "'cli'):\n"
        "    name = f'{top.__name__}.{room}'\n"
        '    room = importlib.import_module(name)\n'
        '    for module in pkgutil.walk_packages(room.__path__, name + "."):\n'
        "        if not module.name.endswith(('_picture', 'report.training')):\n"
        '            importlib.import_module(module.name)\n'
    )
    assert done.returncode == 0, done.stderr


def test_the_estimator_names_the_extra_it_needs():
    done = run(
        'from occ_constraints_pkg.errors import OccError\n'
        'from occ_constraints_pkg.learning.estimator import OCTreeClassifier\n'
        'try:\n'
        '    OCTreeClassifier(max_depth=2)\n'
        'except OccError as error:\n'
        '    print(error)\n'
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout == (
        "OCTreeClassifier needs the module 'sklearn', which is not installed: "
        "pip install 'occ_constraints_pkg[dev]'\n"
    )


def test_show_and_check_explain_themselves_without_extras():
    for command in ('show', 'check'):
        done = run(
            'from occ_constraints_pkg.cli import main\n'
            f"sys.argv = ['occ', '{command}', '--help']\n"
            'sys.exit(main())\n'
        )
        assert done.returncode == 0, done.stderr
        assert 'Usage' in done.stdout


def occ(line: str, folder: Path) -> subprocess.CompletedProcess:
    code = (
        'from occ_constraints_pkg.cli import main\n'
        f"sys.argv = ['occ', *{line.split()!r}]\n"
        'sys.exit(main())\n'
    )
    return run(code, folder)


@pytest.fixture
def learned(tmp_path):
    rows = '\n'.join(f'{step // 9},{step % 7},{step % 5}' for step in range(90))
    (tmp_path / 'rows.csv').write_text(f'episode,x,y\n{rows}\n')
    assert occ('learn rows.csv -o rules.yaml', tmp_path).returncode == 0
    return tmp_path


def test_a_page_is_one_command_away_from_the_first_rules(learned):
    done = occ('report rows.csv -c rules.yaml -o page.html', learned)
    assert (done.returncode, done.stderr) == (0, '')
    page = (learned / 'page.html').read_text()
    assert 'data-bound' in page
    assert "pip install 'occ_constraints_pkg[report]'" in page.replace('&#39;', "'")
    assert '<img' not in page


def test_density_in_a_picture_that_cannot_be_drawn_is_refused(learned):
    done = occ('report -c rules.yaml --demonstrations rows.csv -o page.html', learned)
    assert done.returncode == 2
    assert "--demonstrations needs the module 'matplotlib'" in done.stderr
    assert not (learned / 'page.html').exists()
