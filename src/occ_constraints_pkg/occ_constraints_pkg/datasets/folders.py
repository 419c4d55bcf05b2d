# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Which recordings or tables a path stands for, where it may be a folder of many."""

from __future__ import annotations

from pathlib import Path

from occ_constraints_pkg.datasets.manifest import Selection, select
from occ_constraints_pkg.datasets.table_files import is_table_file
from occ_constraints_pkg.errors import DataError
from occ_constraints_pkg.rosbag.file_names import bare_name, natural_order, recordings_in


def named_sources(path: str | Path) -> list[tuple[str, Path | Selection]]:
    """Return the recordings or tables that a path stands for, each with its name.

    Args:
        path: a recording, a table, a manifest, or a folder that holds recordings or, if it holds
            none, tables; folders below it count.

    Returns:
        In natural order, or in that of the manifest. The name is the path within the folder,
        without the endings of storage files.

    Raises:
        OccError: there is no such path, a folder holds neither, or a manifest is wrong.
    """
    folder = Path(path)
    if is_table_file(folder):
        return [(folder.name, folder)]
    if not folder.is_dir():
        return [(bare_name(item.path), item) for item in select([folder])]
    found = list(recordings_in(folder)) or sorted(
        filter(is_table_file, folder.rglob('*')), key=lambda file: natural_order(str(file))
    )
    if not found:
        raise DataError(
            f'{path} is no recording, and holds neither a recording nor a table; allowed are '
            'rosbag2 directories, files that end in .mcap or .db3, and tables'
        )
    if found == [folder]:
        return [(folder.resolve().name, folder)]
    return [(str(item.relative_to(folder).with_name(bare_name(item))), item) for item in found]
