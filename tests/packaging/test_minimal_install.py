# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Without any extra, rules can be shown and bags checked."""

import subprocess
import sys

# Imports as an installation without extras would do them.
PROLOGUE = """
import sys
class Absent:
    def find_spec(self, name, path=None, target=None):
        if name.partition('.')[0] in (
            'torch', 'mujoco', 'rclpy', 'matplotlib', 'jinja2', 'sklearn', 'pandas'
        ):
            raise ModuleNotFoundError(f'No module named {name!r}', name=name)
sys.meta_path.insert(0, Absent())
"""


def run(code: str) -> subprocess.CompletedProcess:
    return subprocess.run([sys.executable, '-c', PROLOGUE + code], capture_output=True, text=True)


def test_all_but_pictures_is_imported_without_extras():
    done = run(
        'import importlib, pkgutil, occ_constraints_pkg as top\n'
        "for room in ('rules', 'learning', 'features', 'rosbag', 'datasets', 'checking', 'cli'):\n"
        "    name = f'{top.__name__}.{room}'\n"
        '    room = importlib.import_module(name)\n'
        '    for module in pkgutil.walk_packages(room.__path__, name + "."):\n'
        "        if not module.name.endswith('_picture'):\n"
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
