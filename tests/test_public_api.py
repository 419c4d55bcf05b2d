# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""What ``import occ_constraints_pkg as occ`` gives, and that its examples are true."""

import doctest
import inspect
import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import occ_constraints_pkg as occ

ROOT = Path(__file__).parents[1]
HEAVY = {'scipy', 'torch', 'mujoco', 'matplotlib', 'rclpy', 'mcap', 'rosbags', 'sklearn', 'click'}


@pytest.fixture
def beside_bags(tmp_path, monkeypatch):
    """Run in an empty folder with the recordings of this repository."""
    (tmp_path / 'bags').symlink_to(ROOT / 'bags')
    monkeypatch.chdir(tmp_path)


def readme_program():
    (program,) = re.findall(
        r'```python\n(import occ_constraints_pkg.*?)```',
        (ROOT / 'README.md').read_text(encoding='utf-8'),
        re.DOTALL,
    )
    return program


@pytest.mark.parametrize('name', occ.__all__)
def test_each_name_is_documented_by_an_example_that_is_true(name, beside_bags):
    value = getattr(occ, name)
    example = doctest.DocTestParser().get_doctest(
        inspect.getdoc(value), {'occ': occ, 'np': np}, name, None, 0
    )
    assert example.examples
    told = []
    runner = doctest.DocTestRunner(optionflags=doctest.ELLIPSIS)
    assert runner.run(example, out=told.append).failed == 0, ''.join(told)


def test_names_are_sorted_and_listed():
    assert occ.__all__ == sorted(occ.__all__)
    assert set(occ.__all__) <= set(dir(occ))
    with pytest.raises(AttributeError, match="'nothing'"):
        _ = occ.nothing


def loaded_by(code):
    """Return the top-level modules that a program loads, in a new process."""
    done = subprocess.run(
        [sys.executable, '-c', f'{code}\nimport sys; print(*sys.modules)'],
        capture_output=True,
        text=True,
        check=True,
        timeout=60,
    )
    return {name.partition('.')[0] for name in done.stdout.split()}


def test_importing_loads_nothing_and_a_name_what_it_needs():
    assert not loaded_by('import occ_constraints_pkg') & {*HEAVY, 'numpy', 'ruamel'}
    rules = 'from occ_constraints_pkg import RuleSet, Constraints, FeatureMap, OccError'
    assert not loaded_by(rules) & HEAVY
    everything = 'from occ_constraints_pkg import *'
    assert not loaded_by(everything) & {'torch', 'mujoco', 'matplotlib', 'rclpy', 'click'}


def test_the_program_of_the_readme(beside_bags, capsys):
    program = readme_program()
    assert len([line for line in program.splitlines() if line]) <= 12
    exec(compile(program, 'README.md', 'exec'), {})
    printed = capsys.readouterr().out
    assert 'R00b2f x below 0.737 and y above 0.298' in printed
    assert all(shown in printed for shown in re.findall(r'  # (.+)$', program, re.MULTILINE))
    assert Path('nav.yaml').is_file()


def test_the_api_agrees_with_the_command(occ_command, beside_bags):
    occ_command('learn bags/simple_nav_expert -m simple_nav -o nav.yaml')
    by_command = occ.load_constraints('nav.yaml')
    by_program = occ.learn('bags/simple_nav_expert', 'simple_nav')
    assert by_program.rules == by_command.rules
    assert by_program.coverage == by_command.coverage
    printed = occ_command('check bags/simple_nav_straight -c nav.yaml --json')
    report = occ.check('bags/simple_nav_straight', 'nav.yaml')
    assert report.shares == printed['shares_of_time']
    assert [
        (item.rule.id, item.start, item.end, item.margin, item.values) for item in report.violations
    ] == [
        (item['rule'], item['start'], item['end'], item['worst']['margin'], item['worst']['values'])
        for item in printed['violations']
    ]


@pytest.fixture
def occ_command(run_occ):
    """Return a function that runs ``occ`` and returns what it printed, read as JSON if asked."""
    import json

    def run(line):
        code, out, err = run_occ(line)
        assert code in (0, 1), err
        return json.loads(out) if '--json' in line else out

    return run


def test_without_an_enabled_rule_nothing_is_safe(beside_bags):
    constraints = occ.learn('bags/simple_nav_expert', 'simple_nav')
    none = constraints.with_rule_set(
        occ.RuleSet(constraints.space, (), constraints.rule_set.demonstrated)
    )
    with pytest.warns(UserWarning, match='no rule is enabled'):
        report = occ.check('bags/simple_nav_expert', none)
    assert not report.is_safe
    assert report.shares['UNKNOWN'] == 1.0


def test_tables_and_warnings(tmp_path):
    table = tmp_path / 'drives.csv'
    table.write_text('speed,clearance\n' + ''.join(f'{i / 9},{1 + i / 9}\n' for i in range(10)))
    with pytest.warns(UserWarning, match='samples') as told:
        constraints = occ.learn([table])
    assert told[0].filename == __file__
    assert constraints.space.names == ('speed', 'clearance')
    table.write_text('clearance,speed\n1.5,0.5\n1.5,7.0\n')
    report = occ.check(table, constraints)
    assert report.shares == {'SAFE': 0.5, 'VIOLATED': 0.5, 'UNKNOWN': 0.0}
    (violation,) = report.violations
    assert violation.values == {'speed': 7.0, 'clearance': 1.5}
    assert (violation.recording, violation.start, violation.end) == ('drives.csv', 1.0, 2.0)


def test_the_package_says_that_it_is_typed():
    assert (Path(occ.__file__).parent / 'py.typed').is_file()


def test_a_type_checker_understands_the_program_of_the_readme(tmp_path):
    pytest.importorskip('mypy', reason="needs the extra 'dev'")
    program = tmp_path / 'program.py'
    program.write_text(f'{readme_program()}\nreveal_type(report)\nreveal_type(constraints)\n')
    done = subprocess.run(
        [sys.executable, '-m', 'mypy', '--strict', '--config-file=', '--follow-imports=silent']
        + [str(program)],
        capture_output=True,
        text=True,
        check=False,
        timeout=250,
        cwd=tmp_path,
        # Checkers do not follow the hooks of an editable installation.
        env={**os.environ, 'MYPYPATH': str(Path(occ.__file__).parents[1])},
    )
    assert done.returncode == 0, done.stdout
    assert '"occ_constraints_pkg.api.Report"' in done.stdout
    assert '"occ_constraints_pkg.rules.constraints_file.Constraints"' in done.stdout
