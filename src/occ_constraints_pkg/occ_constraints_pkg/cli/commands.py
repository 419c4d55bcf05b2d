# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The commands together, and how a run of one ends: its exit code and the sentence of an error."""

from __future__ import annotations

import errno
import sys
from collections.abc import Sequence

import click

import occ_constraints_pkg
from occ_constraints_pkg.cli import damage, interrupt
from occ_constraints_pkg.cli.common import discard, help_without_command, tell
from occ_constraints_pkg.cli.demo_and_bench import bench, demo
from occ_constraints_pkg.cli.drive import drive
from occ_constraints_pkg.cli.experiments import experiment
from occ_constraints_pkg.cli.export import export
from occ_constraints_pkg.cli.features import features
from occ_constraints_pkg.cli.learning import learn
from occ_constraints_pkg.cli.nodes import node, play, record
from occ_constraints_pkg.cli.rules import check, prune, score, show, simplify
from occ_constraints_pkg.cli.traffic import import_
from occ_constraints_pkg.cli.training import evaluate, train
from occ_constraints_pkg.errors import ConfigurationError, missing_extra


def run_command(argv: Sequence[str] | None = None) -> int:
    """Run a command; return its exit code, see :func:`occ_constraints_pkg.cli.main`."""
    try:
        code = cli.main(args=None if argv is None else list(argv), standalone_mode=False)
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
        tell(f'error: {sentence}')
        return 2


def _stopped() -> int:
    tell('stopped')
    # An interrupt that came while a text was executed, as in the making of a dataclass, is
    # remembered by CPython though it was handled: it would end itself by SIGINT. This resets it.
    exec('')
    return 130


def _sentence(error: Exception) -> str | None:
    """Return what to say of an error; None where it is a mistake of this program."""
    match error:
        case ConfigurationError():
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
        case ImportError() if told := missing_extra('the command', error):
            return str(told)
        case ImportError() if not (error.name or '').startswith(occ_constraints_pkg.__name__):
            return damage(error.name or '', error)
    return None


@click.group(invoke_without_command=True, context_settings={'help_option_names': ['-h', '--help']})
@click.version_option(occ_constraints_pkg.__version__)
@click.pass_context
def cli(context: click.Context) -> None:
    """Learn a robot's safety constraints from demonstrations, monitor them, train within them."""
    help_without_command(context)


for _command in (
    *(features, learn, show, check, score, prune, simplify, export),
    *(train, evaluate, drive),
    *(node, record, play, import_),
    *(demo, bench, experiment),
):
    cli.add_command(_command)
