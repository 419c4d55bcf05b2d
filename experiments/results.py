# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Where an experiment finds its data, and how it writes and continues its results."""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from occ_constraints_pkg.documents import read_json_object
from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.files import RESULTS, TABLE, make_directory, write_text


def data_folder(name: str) -> Path:
    """Return the folder of data that are not part of the repository.

    It is looked for in ``OCC_TEST_DATA``, or beside the repository in ``../shared/data``.
    """
    return Path(os.environ.get('OCC_TEST_DATA', '../shared/data')) / name


def earlier_results(file: Path, settings: Mapping[str, Any]) -> dict[str, Any]:
    """Return what an earlier run of the same settings wrote; empty if there was none.

    Raises:
        OccError: the file holds no results of an experiment, or those of other settings.
    """
    if not file.exists():
        return {}
    document = read_json_object(file)
    found = document.get('settings')
    if not isinstance(found, dict):
        raise OccError(f'{file} holds no results of an experiment; allowed is another directory')
    if found != settings:
        raise OccError(
            f'{file} holds results of other settings ({found}); allowed are these, or another '
            'directory'
        )
    return document


def write_results(output: Path, name: str, document: Mapping[str, Any], page: str = '') -> None:
    """Write ``name.json`` and, unless the page is empty, ``name.md``.

    Args:
        output: directory of the files; made if needed.
        name: of the experiment.
        document: plain values.
        page: Markdown.
    """
    make_directory(output)
    text = json.dumps(document, indent=1, ensure_ascii=False, allow_nan=False)
    write_text(output / f'{name}.json', RESULTS, f'{text}\n')
    if page:
        write_text(output / f'{name}.md', TABLE, page)


def markdown_table(heads: Sequence[str], rows: Iterable[Iterable[object]]) -> str:
    """Return a Markdown table, without a line break at its end."""
    lines = [f'| {" | ".join(map(str, row))} |' for row in (heads, *rows)]
    return '\n'.join([lines[0], '|---' * len(heads) + '|', *lines[1:]])
