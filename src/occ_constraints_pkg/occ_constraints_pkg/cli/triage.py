# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""``occ triage``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from occ_constraints_pkg.cli.common import (
    AT_LEAST_1,
    DATA,
    DEFINITIONS,
    FEATURE_MAP_HELP,
    JSON,
    Seconds,
    end_tidily,
    print_json,
    progress_bar,
    refuse_options,
    say,
    say_lines,
    seed_option,
    warn,
)
from occ_constraints_pkg.cli.report import HTML, named_title
from occ_constraints_pkg.errors import ConfigurationError, OccError, import_needed
from occ_constraints_pkg.files import MANIFEST, PAGE, check_outputs, make_directory, write_text

if TYPE_CHECKING:
    from occ_constraints_pkg.checking.triage import Triage
    from occ_constraints_pkg.checking.triage_text import Way


@click.command()
@DATA
@DEFINITIONS
@click.option('-m', '--map', 'map_name', help=f'{FEATURE_MAP_HELP} Recordings need one.')
@click.option(
    '--above',
    type=click.FloatRange(min=0.0, min_open=True),
    default=1.5,
    show_default=True,
    help='Score from which on a recording stands out.',
)
@click.option(
    '--top', type=AT_LEAST_1, default=12, show_default=True, help='List at least so many.'
)
@click.option(
    '--conditions',
    type=click.Choice(['none', 'pairs', 'triples']),
    default='triples',
    show_default=True,
    help='As of `occ learn`.',
)
@click.option('--no-families', is_flag=True, help='As of `occ learn`.')
@click.option(
    '--clips',
    metavar='DIR',
    type=click.Path(),
    help='Write the moments around the worst of those that stand out as bags to a new folder.',
)
@click.option(
    '--clip-seconds',
    type=Seconds(),
    default=3.0,
    show_default=True,
    help='With --clips: before and after the worst moment.',
)
@click.option(
    '--url',
    metavar='BASE',
    help='Where the present folder is served; prints a link for each that stands out, which opens '
    'Foxglove at the moment.',
)
@click.option(
    '--manifest',
    type=click.Path(),
    help='Write a manifest for `occ learn` that leaves out what stands out.',
)
@HTML
@click.option(
    '--processes', type=AT_LEAST_1, help='How many work at a time; default: one for each core.'
)
@seed_option('Chooses which recordings are learned from together.')
@JSON
def triage(
    paths: tuple[str, ...],
    map_name: str | None,
    above: float,
    top: int,
    conditions: str,
    no_families: bool,
    clips: str | None,
    clip_seconds: float,
    url: str | None,
    manifest: str | None,
    html: str | None,
    processes: int | None,
    seed: int,
    as_json: bool,
) -> int:
    """Rank recordings by how far and how long they leave rules learned from the others.

    DATA are recordings, folders or manifests of them; or tables, whose episodes are ranked. A
    recording that cannot be read is named and the others go on. Exit code 1 when any stands out or
    cannot be read.

    \b
    Example: occ triage bags/ -m my_robot.yaml
             occ triage bags/ -m my_robot.yaml --clips clips --manifest good.yaml
    """
    import numpy as np

    from occ_constraints_pkg.checking.triage import triage as rank
    from occ_constraints_pkg.checking.triage_files import manifest_without, read_units
    from occ_constraints_pkg.checking.triage_text import describe_triage, triage_document
    from occ_constraints_pkg.datasets.dataset import joined
    from occ_constraints_pkg.datasets.each import usable_cores
    from occ_constraints_pkg.demonstrations.families import take_families
    from occ_constraints_pkg.features.feature_map import load_feature_map
    from occ_constraints_pkg.learning.conditional import ConditionalSettings
    from occ_constraints_pkg.learning.settings import OCTreeSettings

    end_tidily()
    if clips is None:
        refuse_options(('clip_seconds',), 'needs --clips')
    if url is not None and not url.startswith(('http://', 'https://')):
        raise ConfigurationError(
            f'--url got {url!r}; allowed is an address that begins with http:// or https://'
        )
    outputs = [(path, kind) for path, kind in ((manifest, MANIFEST), (html, PAGE)) if path]
    check_outputs(outputs, [*paths, *([map_name] if map_name else [])])
    pages = html and import_needed('occ triage --html', 'occ_constraints_pkg.report.triage')
    if clips and Path(clips).exists() and (not Path(clips).is_dir() or any(Path(clips).iterdir())):
        raise ConfigurationError(f'--clips got {clips}, which exists; allowed is a new folder')
    feature_map = None if map_name is None else load_feature_map(map_name)
    processes = processes or usable_cores()
    with progress_bar('reading') as progress:
        found = read_units(paths, feature_map, processes=processes, progress=progress)
    if found.are_tables and (clips or url or manifest):
        raise ConfigurationError(
            'got tables with --clips, --url or --manifest; allowed with these are recordings'
        )
    for name, _, sentence in found.unreadable:
        warn(f'{name} is put aside: {sentence}')
    space, conditional = found.space, ConditionalSettings(conditions)
    if feature_map is not None:
        conditional = conditional.keeping_apart(feature_map.apart)
    elif found.units and not no_families:
        data = joined([unit.data for unit in found.units])
        space, sentences = take_families(data, space, OCTreeSettings())
        for sentence in sentences:
            warn(sentence)
    with progress_bar('judging') as progress:
        result = rank(
            found.units,
            space,
            conditional,
            peaks=found.peaks,
            unreadable=found.unreadable,
            above=above,
            processes=processes,
            rng=np.random.default_rng(seed),
            progress=progress,
        )
    ways = _ways(result, clips, clip_seconds, url)
    if manifest:
        write_text(
            manifest, MANIFEST, manifest_without(found, result, Path(manifest).resolve().parent)
        )
    if pages:
        pages.write_triage_page(html, f'Triage of {named_title(paths)}', result, ways)
    if as_json:
        print_json(triage_document(result, ways))
    else:
        say_lines(describe_triage(result, ways, top))
        if manifest:
            say(f'Written to {manifest}; learn with: occ learn {manifest} -m {map_name}')
    return 1 if result.found or result.unreadable else 0


def _ways(result: Triage, clips: str | None, seconds: float, url: str | None) -> dict[str, Way]:
    """Write clips and make links, of those that stand out."""
    from occ_constraints_pkg.checking.triage_files import clip_of, file_at, foxglove_link
    from occ_constraints_pkg.checking.triage_text import Way, key_of

    if clips is None and url is None:
        return {}
    folder = None if clips is None else make_directory(clips)
    ways = {}
    with progress_bar('clips') as progress:
        for rank, item in enumerate(result.found, start=1):
            if item.log_time_ns is None:
                continue
            try:
                clip = folder and clip_of(item, rank, folder, seconds)
                shown = clip or file_at(item)
            except OccError as error:
                warn(f'{item.name}: {error}')
                continue
            link = foxglove_link(url, shown, item.log_time_ns) if url else ''
            ways[key_of(item)] = Way(str(clip or ''), link)
            progress(rank, len(result.found))
    return ways
