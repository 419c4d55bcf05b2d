# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The linters of ament, where they are installed, with the settings of this package.

The order of imports and the format are those of ruff, which the repository checks; docstrings are
in Google's style, which pep257's sections contradict.
"""

from pathlib import Path

import pytest

PACKAGE = Path(__file__).resolve().parents[1]
FOLDERS = [str(PACKAGE / name) for name in ('occ_constraints_pkg', 'launch', 'test')]
# Blank lines and sections in the style of NumPy, sentences that are commands,
# and what looks like a signature.
GOOGLE = [203, 212, 213, 400, 401, 402, *range(404, 412), *range(413, 418)]
# Of special methods, of constructors (the class says it), nested functions, and raw strings.
RUFF = [105, 107, 301]


@pytest.mark.linter
@pytest.mark.flake8
def test_flake8():
    main = pytest.importorskip('ament_flake8.main')
    code, errors = main.main_with_errors(argv=['--config', str(PACKAGE / 'setup.cfg'), *FOLDERS])
    assert code == 0, '\n'.join(errors)


@pytest.mark.linter
@pytest.mark.pep257
def test_pep257():
    main = pytest.importorskip('ament_pep257.main')
    folders = FOLDERS[:2]
    ignored = [f'D{number}' for number in (*GOOGLE, *RUFF)]
    assert main.main(argv=['--add-ignore', *ignored, '--', *folders]) == 0


@pytest.mark.linter
@pytest.mark.xmllint
def test_xmllint():
    main = pytest.importorskip('ament_xmllint.main')
    assert main.main(argv=[str(PACKAGE)]) == 0
