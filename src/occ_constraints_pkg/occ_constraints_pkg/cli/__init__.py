# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The command ``occ``: one module for each group of commands.

This module imports next to nothing itself: Ctrl-C and a damaged installation must be answered in
one line from the first moment, and importing the commands takes a good part of a second.
"""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Callable, Sequence
from functools import partial
from importlib import import_module

from occ_constraints_pkg.terminal import printable

_OLDEST_NUMPY = (1, 26)


def main(argv: Sequence[str] | None = None, module: str = f'{__name__}.commands') -> int:
    """Run ``occ``; return 0 (done), 1 (problems were found), 2 (bad input) or 130 (Ctrl-C).

    Args:
        argv: the arguments; default: those of this process.
        module: defines the click command ``cli``. The experiments and the benchmarks of a clone
            are run with commands of their own.
    """
    handlers = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    # A program that was started with SIGINT ignored keeps ignoring it.
    is_interruptible = handlers[signal.SIGINT] is signal.default_int_handler
    try:
        if is_interruptible:
            signal.signal(signal.SIGINT, _leave)
        run = _load(module)
        if is_interruptible:
            signal.signal(signal.SIGINT, interrupt.on_signal)
        return run(argv)
    except _DamagedError as error:
        print(f'error: {error}', file=sys.stderr)
        return 2
    finally:
        if argv is None and is_interruptible:
            # All is done and reported; Ctrl-C while the interpreter shuts down only makes noise.
            handlers[signal.SIGINT] = signal.SIG_IGN
        for number, handler in handlers.items():
            signal.signal(number, handler)


class _DamagedError(Exception):
    """What cannot be imported, in one sentence."""


class _Interrupt:
    """Ctrl-C as an exception that is recognized if a library turns it into another one."""

    def __init__(self) -> None:
        self.made = False

    def on_signal(self, _number: int, _frame: object) -> None:
        self.made = True
        raise KeyboardInterrupt


interrupt = _Interrupt()


def _leave(_number: int, _frame: object) -> None:
    # Nothing has been done that could be lost. An exception would run through the imports, where
    # libraries print it or take it for a damaged installation.
    os.write(2, b'stopped\n')
    os._exit(130)


def _load(module: str) -> Callable[[Sequence[str] | None], int]:
    """Import the commands; return the function that runs one.

    Raises:
        _DamagedError: a package that every command needs is missing, damaged or too old.
    """
    try:
        import numpy

        version = numpy.__version__
    # A damaged package fails in any way.
    except Exception as error:
        raise _DamagedError(damage('numpy', error)) from error
    if tuple(int(part) for part in version.split('.')[:2]) < _OLDEST_NUMPY:
        raise _DamagedError(
            f'NumPy {version} is too old; needed is {".".join(map(str, _OLDEST_NUMPY))} or later: '
            'pip install --upgrade numpy'
        )
    try:
        from occ_constraints_pkg.cli.ending import run_command

        command = import_module(module).cli
    except ImportError as error:
        raise _DamagedError(damage(error.name or '', error)) from error
    return partial(run_command, command)


def damage(package: str, error: Exception) -> str:
    """Return the sentence on a package that cannot be imported."""
    package = package.partition('.')[0]
    reason = next((line.strip() for line in str(error).splitlines() if line.strip()), '')
    return printable(
        f'the package {package} cannot be imported ({reason or type(error).__name__}); '
        f'repair the installation: pip install --force-reinstall {package}'
    )
