# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Writing that never costs a user what was there before."""

from __future__ import annotations

import fcntl
import itertools
import os
import weakref
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from occ_constraints_pkg.errors import OccError


@contextmanager
def replacing(path: str | Path) -> Iterator[Path]:
    """Yield the path of a draft that takes the place of ``path`` when the block ends well.

    Until then, and when the block fails, ``path`` stays as it was and no draft is left. Its
    directory is made if it is not there.

    Raises:
        OccError: writing failed, for example because the disk is full.
    """
    target = Path(path)
    check_is_file_or_nothing(target)
    draft = target.parent / f'.{target.name}.{os.getpid()}'
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        yield draft
        os.replace(draft, target)
    except OSError as error:
        raise OccError(f'cannot write {path}: {error.strerror or error}') from error
    finally:
        with suppress(OSError):
            draft.unlink()


def check_is_file_or_nothing(path: Path) -> None:
    """Refuse a path at which there is a directory, a device or a pipe.

    Raises:
        OccError: there is.
    """
    try:
        if path.exists() and not path.is_file():
            raise OccError(
                f'cannot write {path}: it is no ordinary file; allowed is a new or such a one'
            )
    except OSError as error:
        raise OccError(f'cannot write {path}: {error.strerror}') from error


def make_directory(path: str | Path) -> Path:
    """Make a directory with its parents, if it is not there.

    Raises:
        OccError: that is not possible.
    """
    try:
        Path(path).mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OccError(f'cannot write to {path}: {error.strerror}') from error
    return Path(path)


class DirectoryLock:
    """Keeps a directory for one writer, until this object or its process is gone."""

    def __init__(self, directory: Path) -> None:
        """Lock a directory, which may be renamed afterwards.

        Raises:
            OccError: somebody else has locked it.
        """
        try:
            descriptor = os.open(directory, os.O_RDONLY)
        except OSError as error:
            raise OccError(f'cannot write to {directory}: {error.strerror}') from error
        weakref.finalize(self, os.close, descriptor)
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise OccError(
                f'another program is writing to {directory}; allowed is another directory, or this '
                'one when that has ended'
            ) from None
        except OSError:
            # Some file systems of networks know no locks.
            return


def set_aside(directory: Path) -> Path:
    """Rename a directory to the first free of ``NAME.1``, ``NAME.2`` ..., and return that.

    Raises:
        OccError: it cannot be renamed, or the program works in it: what it writes by relative paths
            would then go to the renamed directory.
    """
    source = directory.resolve()
    if Path.cwd().is_relative_to(source):
        raise OccError(
            f'cannot rename {source}, in which this program was started, to make room; allowed is '
            'another directory, or a start from elsewhere'
        )
    for number in itertools.count(1):
        target = source.with_name(f'{source.name}.{number}')
        if not target.exists():
            break
    try:
        source.rename(target)
    except OSError as error:
        raise OccError(f'cannot rename {directory} to {target}: {error.strerror}') from error
    return target
