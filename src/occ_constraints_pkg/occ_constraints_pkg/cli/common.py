# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""What commands share: options, reading of data, progress, output."""

from __future__ import annotations

import json
import math
import os
import signal
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import Any, TextIO

import click

from occ_constraints_pkg.errors import ConfigurationError
from occ_constraints_pkg.terminal import printable

FEATURE_MAP_HELP = 'Feature map: a YAML file, or a built-in name such as PointGoal1.'
DATA = click.argument('paths', metavar='DATA...', nargs=-1, required=True, type=click.Path())
OVERWRITE = click.option(
    '--overwrite', is_flag=True, help='Replace a file with edited rules (keeps .bak).'
)


def _search_folder(_context: Any, _parameter: Any, folder: str | None) -> None:
    if folder:
        from occ_constraints_pkg.rosbag.definitions import search_folder

        search_folder(folder)


DEFINITIONS = click.option(
    '--definitions',
    metavar='DIR',
    type=click.Path(exists=True, file_okay=False),
    callback=_search_folder,
    expose_value=False,
    help='Folder with PACKAGE/msg/*.msg or .idl, for types that a recording does not define.',
)
JSON = click.option('--json', 'as_json', is_flag=True, help='Print one JSON object.')
AT_LEAST_0, AT_LEAST_1 = click.IntRange(min=0), click.IntRange(min=1)

NAMESPACE = click.option(
    '--namespace',
    default='',
    metavar='NAME',
    help="Robot of the recordings, as robot1: the map's relative topics are below /robot1.",
)


class Seconds(click.FloatRange):
    """A finite time; click's own range lets ``nan`` and ``inf`` pass."""

    def __init__(self, *, above_zero: bool = True) -> None:
        """Allow 0 only if not ``above_zero``."""
        super().__init__(min=0.0, min_open=above_zero)

    def convert(self, value: Any, param: Any, ctx: Any) -> float:
        """Return the number.

        Raises:
            click.BadParameter: it is none, out of range or not finite.
        """
        seconds = super().convert(value, param, ctx)
        if not math.isfinite(seconds):
            self.fail(f'got {value!r}; allowed is a finite number', param, ctx)
        return seconds


def named_options() -> set[str]:
    """Return the names of the parameters that stand on the command line of the present command."""
    context = click.get_current_context()
    return {
        name
        for name in context.params
        if context.get_parameter_source(name) is click.core.ParameterSource.COMMANDLINE
    }


def refuse_options(names: Iterable[str], why: str) -> None:
    """Refuse options that would do nothing: whoever gave one expects another result.

    Args:
        names: of their parameters.
        why: the end of the sentence, after the option.

    Raises:
        OccError: one of them was given.
    """
    given = named_options()
    for parameter in click.get_current_context().command.params:
        if parameter.name in given.intersection(names):
            raise ConfigurationError(f'{parameter.opts[-1]} {why}')


def end_tidily() -> None:
    """Let SIGTERM do what Ctrl-C does: a training is saved, the nodes of a demo are ended."""
    signal.signal(signal.SIGTERM, signal.default_int_handler)


def read_data(
    paths: tuple[str, ...],
    constraints: Any,
    where: str,
    *,
    max_lag: float = 0.0,
    namespace: str = '',
    provenance: bool = False,
) -> Any:
    """Read data to judge, and pass on what was wrong with it; see ``read_for_rules``."""
    from occ_constraints_pkg.datasets.reading import read_for_rules

    with progress_bar('reading') as progress:
        data = read_for_rules(
            paths,
            constraints,
            where,
            max_lag=max_lag,
            namespace=namespace,
            provenance=provenance,
            progress=progress,
        )
    for warning in data.warnings:
        warn(warning)
    return data


def needed_cost(data: Any, paths: tuple[str, ...]) -> Any:
    """Return the true cost of data that is to be scored on it."""
    if data.true_cost is None:
        raise ConfigurationError(
            f'{", ".join(paths)}: no true cost to score on; needed is a column true_cost in the '
            'trigger topic of a recording (pace), or cost or true_cost in a table'
        )
    return data.true_cost


def say(sentence: str) -> None:
    """Print one line on stdout, whatever is in the sentence.

    Raises:
        OccError: it cannot be written.
    """
    say_lines(printable(sentence))


def say_lines(text: str, *, nl: bool = True) -> None:
    """Print text of several lines on stdout; other control characters are written out.

    When the reader has gone, as in ``occ check | head``, the rest is dropped: what the command
    found is still reported by its exit code.

    Raises:
        OccError: it cannot be written.
    """
    try:
        click.echo(printable(text, keep_lines=True), nl=nl)
    except BrokenPipeError:
        discard(sys.stdout)
    except OSError as error:
        discard(sys.stdout)
        raise ConfigurationError(
            f'cannot write to the standard output: {error.strerror}'
        ) from error


def report(sentence: str) -> None:
    """Print one line on stderr, whatever is in the sentence."""
    try:
        click.echo(printable(sentence), err=True)
    except OSError:
        # Nowhere is left to say it; the exit code stays what it is.
        discard(sys.stderr)


def discard(stream: TextIO) -> None:
    """Send what is left in a stream nowhere, so that the end of the process does not fail on it."""
    with open(os.devnull, 'wb') as nowhere:
        os.dup2(nowhere.fileno(), stream.fileno())


def help_without_command(context: click.Context) -> None:
    """Print the help of a group that was given no command: it is a question, not a mistake."""
    if context.invoked_subcommand is None:
        say_lines(context.get_help())


def warn(sentence: str) -> None:
    """Print a warning on stderr."""
    report(f'warning: {sentence}')


def seed_option(text: str | None = None, *, default: int = 0) -> Callable[..., Any]:
    """Return the option ``--seed``, with a text where the name alone does not say it."""
    return click.option('--seed', default=default, type=AT_LEAST_0, show_default=True, help=text)


def cost_limit_option(default: str) -> Callable[..., Any]:
    """Return the option ``--cost-limit``: a number, or ``demonstrations``."""
    return click.option(
        '--cost-limit',
        default=default,
        show_default=True,
        metavar='NUMBER',
        callback=_checked_cost_limit,
        help="Mean cost per episode; 'demonstrations': the learned cost of the demonstrations.",
    )


def _checked_cost_limit(_context: Any, _parameter: Any, text: str) -> float | str:
    if text == 'demonstrations':
        return text
    try:
        return float(text)
    except ValueError:
        raise click.BadParameter(f"got {text!r}; allowed is a number or 'demonstrations'") from None


@contextmanager
def progress_bar(label: str, *, detail: bool = False) -> Iterator[Callable[..., None]]:
    """Show a bar on stderr, only on a terminal; yields ``update(done, total, text='')``."""
    hidden = not sys.stderr.isatty()
    with click.progressbar(
        length=1,
        label=label,
        file=sys.stderr,
        hidden=hidden,
        item_show_func=(lambda text: text) if detail else None,
    ) as bar:

        def update(done: int, total: int, text: str = '') -> None:
            if hidden:
                return
            bar.length = total
            bar.update(done - bar.pos, text)

        yield update


def print_json(value: Any) -> None:
    """Print plain values and NumPy numbers as JSON."""
    text = json.dumps(value, indent=2, allow_nan=False, default=_plain)
    # All but this control character are written out already.
    say_lines(text.replace('\x7f', '\\u007f'))


def _plain(value: Any) -> Any:
    if hasattr(value, 'item'):
        # A NumPy number.
        return value.item()
    raise TypeError(f'cannot write {type(value).__name__} as JSON')


def number(value: float) -> float | int | None:
    """Return what JSON can hold of a number: None where it is not finite; counts stay whole."""
    if isinstance(value, int):
        return value
    return float(value) if math.isfinite(value) else None
