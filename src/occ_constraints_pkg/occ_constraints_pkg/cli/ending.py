# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""How a command ends: its exit code and the sentence of an error."""

from __future__ import annotations

import errno
import sys
from collections.abc import Sequence

import click

import occ_constraints_pkg
from occ_constraints_pkg.cli import damage, interrupt
from occ_constraints_pkg.cli.common import discard, report
from occ_constraints_pkg.errors import OccError, missing_extra


def run_command(command: click.Command, argv: Sequence[str] | None = None) -> int:
    """Run a command; return its exit code, see :func:`occ_constraints_pkg.cli.main`."""
    try:
        code = command.main(args=None if argv is None else list(argv), standalone_mode=False)
        return code if isinstance(code, int) else 0
    except (click.Abort, KeyboardInterrupt):
        return _stopped()
    except SystemExit:
        # This is how click says that the reader of a help text has gone, as in `occ --help | head`.
        discard(sys.stdout)
        return 0
    except Exception as error:
        if interrupt.made:
            # Ctrl-C in the middle of what an import or a callback turned into another error.
            return _stopped()
        sentence = _sentence(error)
        if sentence is None:
            raise
        report(f'error: {sentence}')
        return 2


def _stopped() -> int:
    report('stopped')
    return 130


def _sentence(error: Exception) -> str | None:
    """Return what to say about an error; None where it is a mistake of this program."""
    match error:
        case OccError():
            return str(error)
        case click.ClickException():
            context = getattr(error, 'ctx', None)
            hint = f"; see '{context.command_path} --help'" if context else ''
            return f'{error.format_message().rstrip(".")}{hint}'
        case MemoryError():
            return 'there is not enough memory for this'
        case OSError() if error.errno in (errno.ENOSPC, errno.EIO) and error.filename is None:
            # Of the standard output, which click writes help to.
            discard(sys.stdout)
            return f'cannot write: {error.strerror}'
        case OSError():
            where = '' if error.filename is None else f' {error.filename}'
            return f'cannot use{where}: {error.strerror or error}'
        case ImportError() if missing := missing_extra('the command', error):
            return str(missing)
        case ImportError() if not (error.name or '').startswith(occ_constraints_pkg.__name__):
            return damage(error.name or '', error)
    return None
