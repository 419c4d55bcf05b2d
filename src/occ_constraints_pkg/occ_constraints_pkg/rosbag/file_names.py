# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""How the files of recordings are named, and which recordings lie in a folder."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from occ_constraints_pkg.rosbag.storage import ZSTD_SUFFIXES

SUFFIXES = ('.mcap', '.db3')
"""What storage files end in, when nothing is compressed."""

SPLIT = re.compile(r'_\d+$')
"""How the names of the files end that a recorder splits a recording into."""


def recordings_in(folder: Path) -> Iterator[Path]:
    """Yield the recordings in a folder and the folders below it, in natural order.

    A folder with a metadata.yaml is one recording, and so is one whose storage files are all named
    after it, as those of a killed recorder; else each storage file is one.
    """
    files = sorted(
        (file for file in folder.iterdir() if is_storage(file)),
        key=lambda file: natural_order(file.name),
    )
    stems = {SPLIT.sub('', bare_name(file)) for file in files}
    if (folder / 'metadata.yaml').is_file() or stems == {folder.resolve().name}:
        yield folder
        return
    below = [path for path in folder.iterdir() if path.is_dir() and not path.name.startswith('.')]
    for path in sorted((*files, *below), key=lambda path: natural_order(path.name)):
        if path.is_dir():
            yield from recordings_in(path)
        else:
            yield path


def is_storage(file: Path) -> bool:
    """Tell by its name whether an ordinary file holds messages."""
    return file.is_file() and storage_suffix(file) in SUFFIXES


def storage_suffix(file: Path) -> str:
    """Return the last ending of a name that is not one of a compressed file; empty without one."""
    suffixes = [suffix for suffix in file.suffixes if suffix not in ZSTD_SUFFIXES]
    return suffixes[-1] if suffixes else ''


def bare_name(file: Path) -> str:
    """Return the name of a storage file without its endings."""
    name = file.name
    for suffix in (*ZSTD_SUFFIXES, *SUFFIXES):
        name = name.removesuffix(suffix)
    return name


def natural_order(name: str) -> list[Any]:
    """Sort key that puts ``bag_10`` after ``bag_9``."""
    return [int(part) if part.isdigit() else part for part in re.split(r'(\d+)', name)]
