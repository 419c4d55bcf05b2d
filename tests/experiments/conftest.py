# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
from functools import partial

import pytest


@pytest.fixture
def run_experiment(run_occ, tmp_path, monkeypatch):
    """Return a function that runs ``python -m experiments`` in an empty folder."""
    monkeypatch.chdir(tmp_path)
    return partial(run_occ, module='experiments.commands')
