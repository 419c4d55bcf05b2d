# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Reading of bounded size, and writing that never loses an existing file."""

from __future__ import annotations

import errno
import fcntl
import hashlib
import itertools
import os
import re
import secrets
import stat
import weakref
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

from occ_constraints_pkg.errors import ConfigurationError, DataError, OccError

DOCUMENT_BYTES = 8 << 20
"""Limit of documents that people edit; parsing that much YAML takes minutes already."""


@contextmanager
def open_regular(path: str | Path, what: str = '') -> Iterator[BinaryIO]:
    """Open a regular file for reading; devices and pipes, which may never end, are refused.

    Args:
        path: the file.
        what: description before its name in messages.

    Raises:
        DataError: it cannot be opened, or is no ordinary file.
    """
    named = f'{what} {path}' if what else path
    try:
        # Without O_NONBLOCK, opening a pipe waits for its writer.
        descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    except (OSError, ValueError) as error:
        raise DataError(f'cannot read {named}: {_reason(error)}') from error
    mode = os.fstat(descriptor).st_mode
    if not stat.S_ISREG(mode):
        os.close(descriptor)
        is_what = 'directory' if stat.S_ISDIR(mode) else 'device, a pipe or a socket'
        raise DataError(f'cannot read {named}: it is a {is_what}; allowed is an ordinary file')
    with os.fdopen(descriptor, 'rb') as stream:
        yield stream


def read_bytes(path: str | Path, limit: int = DOCUMENT_BYTES, what: str = '') -> bytes:
    """Return the content of an ordinary file of at most ``limit`` bytes.

    Raises:
        DataError: it cannot be read, is no ordinary file, or is larger.
    """
    with open_regular(path, what) as stream:
        size = os.fstat(stream.fileno()).st_size
        if size > limit:
            raise DataError(f'cannot read {path}: it has {size} bytes; allowed are {limit} at most')
        try:
            # Without anything appended meanwhile.
            return stream.read(size)
        except OSError as error:
            raise DataError(f'cannot read {path}: {_reason(error)}') from error


@dataclass(frozen=True)
class Kind:
    """A type of file that is written here, and how it is recognised.

    Attributes:
        words: its description in messages.
        pattern: found in the first bytes of every such file.
        suffixes: allowed suffixes of a new file; empty: any.
        head: how many of the first bytes are searched.
    """

    words: str
    pattern: re.Pattern[bytes]
    suffixes: tuple[str, ...] = ()
    head: int = 4096


def _kind(words: str, pattern: bytes, *suffixes: str, head: int = 4096) -> Kind:
    return Kind(words, re.compile(pattern, re.MULTILINE), suffixes, head)


PICTURE = _kind('a PNG picture', rb'\A\x89PNG\r\n\x1a\n', '.png')
GIF = _kind('a GIF film', rb'\AGIF8[79]a', '.gif')
MP4 = _kind('an MP4 film', rb'\A[\s\S]{4}ftyp', '.mp4')
CONSTRAINTS = _kind(
    'a constraints file', rb'(?:^|[{,]\s*)["\']?rules["\']?\s*:', head=DOCUMENT_BYTES
)
FEATURE_MAP = _kind('a feature map', rb'(?:^|[{,]\s*)["\']?features["\']?\s*:', head=DOCUMENT_BYTES)
MANIFEST = _kind(
    'a manifest', rb'(?:^|[{,]\s*)["\']?recordings["\']?\s*:', '.yaml', '.yml', head=DOCUMENT_BYTES
)
C_HEADER = _kind('a C header of rules', rb'\A/\* Safety rules learned from demonstrations')
RESULTS = _kind('a file of results (JSON)', rb'\A\s*[{\[]')
COUNTS = _kind('a file of rule counters', rb'\A\s*\{\s*"format":\s*"occ_constraints counts')
ARCHIVE = _kind('a saved policy or training', rb'\APK\x03\x04')
TABLE = _kind('a page of text (Markdown)', rb'\A#\s|^\|[ :|-]*-{3}', head=1 << 16)
EVENTS = _kind(
    'a file of events (JSON or CSV)', rb'\A\{\s*"events":|\Anumber,id,kind,', '.json', '.csv'
)
# Not every page: one of another program, or written by a person, would be lost. The second name
# is that of the demo's first pages.
PAGE = _kind(
    'a page written by occ (HTML)',
    rb'<meta name="generator" content="occ_constraints|<title>occ_constraints demo',
    '.html',
    '.htm',
)


def check_outputs(
    outputs: Mapping[str | Path, Kind] | Iterable[tuple[str | Path, Kind]],
    inputs: Iterable[str | Path] = (),
) -> None:
    """Refuse outputs that would overwrite other files, before the work is done.

    An output may not be an input or another output, under any name or link, and may not replace a
    file of another type; empty files may be replaced.

    Args:
        outputs: the files to write, and their types.
        inputs: files that the same command reads; directories and missing files are ignored.

    Raises:
        ConfigurationError: one of these; the sentence names the file and says what is allowed.
    """
    pairs = list(outputs.items() if isinstance(outputs, Mapping) else outputs)
    taken = [(path, 'is read by the same command') for path in inputs]
    for path, kind in pairs:
        if kind.suffixes and Path(path).suffix.lower() not in kind.suffixes:
            raise ConfigurationError(
                f'cannot write {path}: {kind.words} is to be written there; allowed is a name that '
                f'ends in {" or ".join(kind.suffixes)}'
            )
        for other, what in taken:
            if _is_same(path, other):
                name = '' if str(path) == str(other) else f' is the same file as {other}, which'
                raise ConfigurationError(
                    f'cannot write {path}: it{name} {what}; allowed is another file'
                )
        check_kind(path, kind)
        taken.append((path, 'is to be written by the same command'))


def check_kind(path: str | Path, kind: Kind) -> None:
    """Refuse to replace a file of another type, a directory or a device.

    Raises:
        ConfigurationError: there is.
    """
    target = Path(path)
    _check_is_file_or_nothing(target)
    try:
        if not target.exists():
            return
        with target.open('rb') as stream:
            head = stream.read(kind.head)
    except OSError as error:
        raise OccError(f'cannot write {path}: {_reason(error)}') from error
    if head and not kind.pattern.search(head):
        raise ConfigurationError(
            f'cannot write {path}: there is a file that is not {kind.words}, which would be lost; '
            'allowed is a new file, or one of that kind'
        )


@contextmanager
def replacing(path: str | Path, kind: Kind, *, durable: bool = True) -> Iterator[Path]:
    """Yield the path of a draft that replaces ``path`` atomically when the block succeeds.

    If the block fails, ``path`` is unchanged and the draft removed. The directory is created if
    missing. The draft is a new empty file with the suffix of ``path``, and is synced to disk before
    it replaces it. It inherits permissions and, if possible, owner and group of an existing file;
    if ``path`` is a link, its target is replaced.

    Args:
        path: the file to write.
        kind: its type; a file of another type is not replaced.
        durable: sync to disk; otherwise a power cut may leave an empty file.

    Raises:
        ConfigurationError: there is a file of another kind.
        OccError: writing failed, for example because the disk is full.
    """
    check_kind(path, kind)
    draft, descriptor = None, -1
    try:
        target = Path(os.path.realpath(path))
        target.parent.mkdir(parents=True, exist_ok=True)
        draft = target.with_name(_draft_name(target))
        flags = os.O_RDWR | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW | os.O_CLOEXEC
        descriptor = os.open(draft, flags, 0o666)
        yield draft
        if not os.path.samestat(os.fstat(descriptor), os.lstat(draft)):
            raise OccError(f'cannot write {path}: another program has replaced the draft {draft}')
        _take_after(descriptor, target)
        if durable:
            os.fsync(descriptor)
        os.replace(draft, target)
        if durable:
            sync_directory(target.parent)
    except OSError as error:
        raise OccError(f'cannot write {path}: {_reason(error)}') from error
    finally:
        if descriptor >= 0:
            os.close(descriptor)
        if draft is not None:
            with suppress(OSError):
                draft.unlink()


def write_text(path: str | Path, kind: Kind, text: str) -> None:
    """Write a text as :func:`replacing` does.

    Raises:
        OccError: as there.
    """
    with replacing(path, kind) as draft:
        draft.write_bytes(text.encode())


def keep_copy(path: str | Path) -> Path:
    """Copy a file to ``FILE.bak`` and return that path; an earlier copy becomes ``FILE.bak.1`` ...

    Raises:
        OccError: that is not possible.
    """
    target = Path(os.path.realpath(path))
    copy = target.with_name(f'{target.name}.bak')
    try:
        content = target.read_bytes()
        if os.path.lexists(copy):
            if copy.is_file() and not copy.is_symlink() and copy.read_bytes() == content:
                return copy
            copy.rename(_free_name(copy))
        with replacing(copy, Kind('a copy', re.compile(b''))) as draft:
            draft.write_bytes(content)
            draft.chmod(stat.S_IMODE(target.stat().st_mode))
    except OSError as error:
        raise OccError(f'cannot write {copy}: {_reason(error)}') from error
    return copy


def _check_is_file_or_nothing(path: Path) -> None:
    """Refuse the path of a directory, a device or a pipe.

    Raises:
        ConfigurationError: there is.
    """
    try:
        if path.exists() and not path.is_file():
            raise ConfigurationError(
                f'cannot write {path}: it is no ordinary file; allowed is a new file or an '
                'ordinary one'
            )
    except OSError as error:
        raise OccError(f'cannot write {path}: {error.strerror}') from error


def make_directory(path: str | Path) -> Path:
    """Create a directory and its parents if missing.

    Raises:
        OccError: that is not possible.
    """
    try:
        Path(path).mkdir(parents=True, exist_ok=True)
    except FileExistsError:
        raise ConfigurationError(
            f'cannot write to {path}: it is a file; allowed is a new directory or an existing one'
        ) from None
    except OSError as error:
        raise OccError(f'cannot write to {path}: {error.strerror}') from error
    return Path(path)


class DirectoryLock:
    """Exclusive lock of a directory for the lifetime of this object or its process."""

    def __init__(self, directory: Path) -> None:
        """Lock a directory, which may be renamed afterwards.

        Raises:
            ConfigurationError: somebody else has locked it.
        """
        try:
            descriptor = os.open(directory, os.O_RDONLY)
        except OSError as error:
            raise OccError(f'cannot write to {directory}: {error.strerror}') from error
        self._close = weakref.finalize(self, os.close, descriptor)
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise ConfigurationError(
                f'another program is writing to {directory}; allowed is another directory, or this '
                'one when that has ended'
            ) from None
        except OSError:
            # Some network file systems have no locks.
            return

    def release(self) -> None:
        """Unlock it before the object ends."""
        self._close()


def set_aside(directory: Path) -> Path:
    """Rename a directory to the first free of ``NAME.1``, ``NAME.2`` ..., and return that.

    Raises:
        ConfigurationError: it is the working directory: relative paths would then lead to the
            renamed directory.
        OccError: it cannot be renamed.
    """
    source = directory.resolve()
    if Path.cwd().is_relative_to(source):
        raise ConfigurationError(
            f'cannot rename {source}, in which this program was started, to make room; allowed is '
            'another directory, or a start from elsewhere'
        )
    target = _free_name(source)
    try:
        source.rename(target)
    except OSError as error:
        raise OccError(f'cannot rename {directory} to {target}: {error.strerror}') from error
    return target


def _draft_name(target: Path) -> str:
    # Movie writers choose the format by the suffix; names are limited to 255 bytes.
    suffix = target.suffix if len(target.suffix) < 10 else ''
    return f'.{target.name[:40]}.{secrets.token_hex(8)}{suffix}'


def _take_after(descriptor: int, target: Path) -> None:
    """Give a draft the owner, group and permissions of the file it replaces, if there is one."""
    try:
        old = target.stat()
    except FileNotFoundError:
        return
    new = os.fstat(descriptor)
    for owner, group in ((-1, old.st_gid), (old.st_uid, -1)):
        if (owner, group) not in ((-1, new.st_gid), (new.st_uid, -1)):
            # Only an administrator or a member of the group may change these.
            with suppress(PermissionError):
                os.fchown(descriptor, owner, group)
    os.fchmod(descriptor, stat.S_IMODE(old.st_mode))


def sync_directory(directory: Path) -> None:
    """Sync the names in a directory to disk, as after a renaming."""
    descriptor = os.open(directory, os.O_RDONLY | os.O_CLOEXEC)
    try:
        os.fsync(descriptor)
    except OSError as error:
        # Some network file systems cannot.
        if error.errno not in (errno.EINVAL, errno.ENOTSUP):
            raise
    finally:
        os.close(descriptor)


def _is_same(path: str | Path, other: str | Path) -> bool:
    """Return whether two paths lead to the same file, existing or not, through any links."""
    try:
        if os.path.isdir(other):
            return False
        if os.path.realpath(path) == os.path.realpath(other):
            return True
        return os.path.samefile(path, other)
    except (OSError, ValueError):
        return False


def _reason(error: OSError | ValueError) -> str:
    return getattr(error, 'strerror', None) or str(error)


def _free_name(path: Path) -> Path:
    """Return the first of ``NAME.1``, ``NAME.2`` ... that is free."""
    names = (path.with_name(f'{path.name}.{number}') for number in itertools.count(1))
    return next(name for name in names if not os.path.lexists(name))


def sha256_of(files: Iterable[Path]) -> str:
    """Return the SHA-256 over the contents of files, one after the other, in hex."""
    digest = hashlib.sha256()
    for file in files:
        with file.open('rb') as stream:
            hashlib.file_digest(stream, lambda: digest)
    return digest.hexdigest()
