# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""What commands share: options, progress, warnings, JSON."""

from __future__ import annotations

import json
import math
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import click

from occ_constraints_pkg.errors import OccError

FEATURE_MAP_HELP = 'Feature map: a YAML file, or a built-in name such as PointGoal1.'
DATA = click.argument('paths', metavar='DATA...', nargs=-1, required=True, type=click.Path())
JSON = click.option('--json', 'as_json', is_flag=True, help='Print one JSON object.')


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


def end_tidily() -> None:
    """Let SIGTERM do what Ctrl-C does: a training is saved, the nodes of a demo are ended."""
    signal.signal(signal.SIGTERM, signal.default_int_handler)


def read_data(paths: tuple[str, ...], constraints: Any, where: str, *, max_lag: float = 0.0) -> Any:
    """Read data to judge, and pass on what was wrong with it."""
    from occ_constraints_pkg.bags.demonstrations import read_for_rules

    with progress_bar('reading') as progress:
        data = read_for_rules(paths, constraints, where, max_lag=max_lag, progress=progress)
    for warning in data.warnings:
        warn(warning)
    return data


def needed_cost(data: Any, paths: tuple[str, ...]) -> Any:
    """Return the true cost of data that is to be scored on it."""
    if data.true_cost is None:
        raise OccError(
            f'{", ".join(paths)}: no true cost to score on; needed is a column true_cost in the '
            'pace topic of a recording, or cost or true_cost in a table'
        )
    return data.true_cost


def warn(sentence: str) -> None:
    """Print a warning on stderr."""
    click.echo(f'warning: {sentence}', err=True)


def checked_cost_limit(_context: Any, _parameter: Any, text: str) -> float | str:
    """Return a cost limit given as an option: a number, or ``demonstrations``."""
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
    click.echo(json.dumps(value, indent=2, allow_nan=False, default=_plain))


def _plain(value: Any) -> Any:
    if hasattr(value, 'item'):
        # A NumPy number.
        return value.item()
    raise TypeError(f'cannot write {type(value).__name__} as JSON')


def number(value: float) -> float | None:
    """Return what JSON can hold of a number: None where it is not finite."""
    return float(value) if math.isfinite(value) else None
