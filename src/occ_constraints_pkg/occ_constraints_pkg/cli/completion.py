# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""What the shell completes: names and ids beside the commands, options and files of click.

Nothing heavy is imported here, and nothing is ever said: a file that cannot be read has no ids.
"""

from __future__ import annotations

import glob
import os
from collections.abc import Callable, Iterable
from pathlib import Path

import click
from click.shell_completion import CompletionItem, get_completion_class

from occ_constraints_pkg.errors import OccError

SHELLS = ('bash', 'zsh', 'fish')
_DOCUMENTS = ('.yaml', '.yml')

Completer = Callable[[click.Context, click.Parameter, str], list[CompletionItem]]


def node_names(
    _context: click.Context, _parameter: click.Parameter, typed: str
) -> list[CompletionItem]:
    """Complete the name of a node."""
    from occ_constraints_pkg.nodes import NODES

    return _starting(typed, NODES)


def world_names(
    _context: click.Context, _parameter: click.Parameter, typed: str
) -> list[CompletionItem]:
    """Complete the name of a world."""
    from occ_constraints_pkg.worlds.registry import WORLDS

    return _starting(typed, WORLDS)


def feature_maps(
    _context: click.Context, _parameter: click.Parameter, typed: str
) -> list[CompletionItem]:
    """Complete a feature map: a built-in one, or a YAML file."""
    from occ_constraints_pkg.features.feature_map import BUILT_IN_MAPS

    found = _starting(typed, [*BUILT_IN_MAPS, *_documents(typed)])
    # Where nothing fits, it may be a file in a folder yet to be named.
    return found or [CompletionItem(typed, type='file')]


def rule_ids(
    context: click.Context, _parameter: click.Parameter, typed: str
) -> list[CompletionItem]:
    """Complete the id of a rule of the constraints file that stands before it."""
    from occ_constraints_pkg.rules.constraints_file import load_constraints

    # As long as an option lacks its value, click leaves arguments unnamed.
    unnamed = [one for one in context.args if Path(one).suffix in _DOCUMENTS]
    path = context.params.get('constraints') or next(iter(unnamed), None)
    if path is None:
        return []
    try:
        loaded = load_constraints(path)
    except OccError:
        # The command itself will say what is wrong with it.
        return []
    return [
        CompletionItem(rule.id, help=rule.words(loaded.space))
        for rule in loaded.rules
        if rule.id.startswith(typed)
    ]


def print_script(context: click.Context, _parameter: click.Parameter, shell: str | None) -> None:
    """Print what makes a shell complete ``occ``, and end."""
    if shell is None or context.resilient_parsing:
        return
    kind = get_completion_class(shell)
    click.echo(kind(context.command, {}, 'occ', '_OCC_COMPLETE').source())
    context.exit()


def _starting(typed: str, names: Iterable[str]) -> list[CompletionItem]:
    return [CompletionItem(name) for name in names if name.startswith(typed)]


def _documents(typed: str) -> list[str]:
    """Return the YAML files that a path may become, and the folders with any."""
    found = glob.glob(f'{glob.escape(os.path.expanduser(typed))}*')
    return sorted(name for name in found if Path(name).suffix in _DOCUMENTS)
