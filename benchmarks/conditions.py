# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Under which conditions something was measured: machine, versions, and data beside the project."""

from __future__ import annotations

import os
import platform
from collections.abc import Iterable
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from occ_constraints_pkg.documents import read_json_object
from occ_constraints_pkg.errors import OccError


def machine() -> dict[str, Any]:
    """Describe the machine as far as it matters for speed."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, 'sched_getaffinity') else os.cpu_count()
    return {'cores': cores, 'processor': platform.machine(), 'system': platform.system()}


def versions(packages: Iterable[str]) -> dict[str, str]:
    """Return the versions of Python and of those packages that are installed."""
    found = {'python': platform.python_version()}
    for package in packages:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            continue
    return found


def data_folder(name: str) -> Path:
    """Return where data of others is looked for: in OCC_TEST_DATA or beside the project."""
    return Path(os.environ.get('OCC_TEST_DATA', '../shared/data')) / name


def earlier_results(file: Path) -> dict[str, Any]:
    """Return what an earlier run of an experiment wrote; empty if there was none.

    Raises:
        OccError: the file is none of an experiment.
    """
    if not file.exists():
        return {}
    document = read_json_object(file)
    if not isinstance(document.get('settings'), dict):
        raise OccError(f'{file} holds no results of an experiment; allowed is another directory')
    return document
