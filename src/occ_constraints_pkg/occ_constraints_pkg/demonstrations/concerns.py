# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Doubts about demonstrations, to be raised before rules that rest on them are used."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from occ_constraints_pkg.datasets.dataset import Dataset
from occ_constraints_pkg.features.doubts import value_doubts
from occ_constraints_pkg.learning.edges import MOST_ESTIMATED, MOST_EVEN
from occ_constraints_pkg.learning.learn import grow
from occ_constraints_pkg.learning.likely_families import likely_families
from occ_constraints_pkg.learning.samples import LEAST_EPISODES_TO_HOLD_OUT
from occ_constraints_pkg.learning.settings import OCTreeSettings
from occ_constraints_pkg.learning.trimming import edges_of, make_units
from occ_constraints_pkg.rules.space import FeatureSpace
from occ_constraints_pkg.wording import count_of

# With fewer samples the bounds are little more than the samples themselves.
_FEW_SAMPLES = 100
# More samples than this share beyond an edge, evenly down to contact, are told of.
_FEW_BAD = 0.02
# Share of the bad samples that are looked for in few episodes.
_MOST = 0.75
# What is estimated from samples may be that much larger than the share that was stated.
_SLACK = 0.01
# So many samples suffice to estimate the share of outliers.
_SOME = 20_000


def concerns(
    data: Dataset, space: FeatureSpace, settings: OCTreeSettings, *, families: bool = True
) -> Iterator[str]:
    """Yield a sentence for each thing about the demonstrations that is likely not meant.

    Args:
        data: what is learned from.
        space: its features.
        settings: of the learner.
        families: whether to tell of features that look like a family.
    """
    rows = data.values[space.knows(data.values)]
    yield from _of_cost(data, settings)
    yield from _of_amount(data, len(rows))
    if families and settings.clip == 'mass':
        # Clipping by density knows no families.
        yield from _of_families(rows, space)
    yield from value_doubts(rows, space)
    told = list(_of_edges(data, space, settings))
    yield from told or _of_share(rows, space, settings)


def _of_cost(data: Dataset, settings: OCTreeSettings) -> Iterator[str]:
    costly = 0 if data.true_cost is None else int((data.true_cost > 0.0).sum())
    stated = settings.contamination if settings.clip == 'mass' else None
    share = costly / len(data)
    if not costly or (stated is not None and stated >= share):
        return
    cure = 'leave them out, or learn from episodes that are safe throughout'
    if settings.clip == 'mass':
        cure += f', or state a contamination of at least {_rounded_up(share)}'
    if stated is not None:
        cure += f' (stated is {stated:g})'
    yield f'{costly} of {len(data)} samples ({share:.2%}) have a cost above 0: {cure}'


def _of_amount(data: Dataset, usable: int) -> Iterator[str]:
    if usable < _FEW_SAMPLES:
        verb = 'is' if usable == 1 else 'are'
        yield (
            f'there {verb} {count_of(usable, "usable sample")}; with fewer than {_FEW_SAMPLES} the '
            'rules say little more than that nothing else was seen'
        )
    episodes = len(np.unique(data.episodes))
    if episodes < LEAST_EPISODES_TO_HOLD_OUT:
        hint = "; a column 'episode' tells the episodes of a table apart"
        hint = hint if data.origins is None else ''
        yield (
            ('there is ' if episodes == 1 else 'there are ')
            + count_of(episodes, 'episode')
            + f'; with fewer than {LEAST_EPISODES_TO_HOLD_OUT} none is held out, so nothing tells '
            f'how well the rules fit unseen episodes{hint}'
        )


def _of_families(rows: np.ndarray, space: FeatureSpace) -> Iterator[str]:
    for family in likely_families(rows, space):
        names = [space.names[member] for member in family.features]
        yield (
            f'the {len(names)} features {names[0]} ... {names[-1]} look like one measurement in '
            'several directions; if they are, declare them as one family, so that they get the '
            'same bounds'
        )


def _of_edges(data: Dataset, space: FeatureSpace, settings: OCTreeSettings) -> Iterator[str]:
    """Tell of samples nearer to contact than somebody who keeps a distance would be."""
    if settings.clip != 'mass' or not space.families:
        return
    usable = data.select(space.knows(data.values))
    if not len(usable):
        return
    limits = np.stack([space.lows, space.highs], axis=1)
    for unit in make_units(usable.values, space.families, limits):
        for end, (edge, nearest) in enumerate(
            zip(edges_of(unit), (unit.smallest, unit.largest), strict=True)
        ):
            if edge is None:
                continue
            bound = unit.limits[end] + (-edge.distance if end else edge.distance)
            beyond = nearest > bound if end else nearest < bound
            share = float(beyond.mean())
            first = space.features[unit.features[0]]
            where = (
                f'{share:.1%} of the samples are {"above" if end else "below"} {bound:.4g}'
                f'{"" if first.unit == "1" else " " + first.unit} in a feature of the family '
                f'{first.family!r}'
            )
            if edge.is_even and share > _FEW_BAD:
                yield f'{where}, evenly down to contact, as if nobody kept a distance: ' + (
                    _even_cure(share, settings.contamination) + _worst(usable, beyond)
                )
            elif settings.contamination is None and share > MOST_ESTIMATED:
                yield (
                    f'{where}, where a demonstrator who ignores obstacles would be for '
                    f'{MOST_ESTIMATED:.0%} of the time, so the bound is moved until that many are '
                    'outside; if the others are bad, too, state a contamination of at least '
                    f'{_rounded_up(share)}' + _worst(usable, beyond)
                )


def _even_cure(share: float, stated: float | None) -> str:
    if stated is None and share <= MOST_EVEN:
        return 'they are taken for bad, and the bound is set there'
    if stated is None:
        return f'they are taken for bad, but no more than {MOST_EVEN:.0%} are left outside'
    if stated < share:
        return (
            f'the stated contamination of {stated:g} is less, so the bound is nearer to contact; '
            f'state at least {_rounded_up(share)}, or none'
        )
    return f'they are taken for bad, within the stated contamination of {stated:g}'


def _worst(data: Dataset, bad: np.ndarray) -> str:
    """Say which episodes have most of the bad samples, if most of these are in a few."""
    names, numbers = np.unique(data.episodes, return_inverse=True)
    counts = np.bincount(numbers, bad)
    order = np.argsort(-counts, kind='stable')
    most = 1 + int(np.searchsorted(np.cumsum(counts[order]), _MOST * counts.sum()))
    if len(names) < LEAST_EPISODES_TO_HOLD_OUT or most > len(names) / 2:
        return ''
    row = int(np.flatnonzero(numbers == order[0])[0])
    source = data.sources[0 if data.recordings is None else int(data.recordings[row])]['name']
    return (
        f'; {most} of the {len(names)} episodes have {_MOST:.0%} of them, which are better left '
        f'out, first of all episode {names[order[0]]} ({source})'
    )


def _of_share(rows: np.ndarray, space: FeatureSpace, settings: OCTreeSettings) -> Iterator[str]:
    stated = settings.contamination
    if stated is None or settings.clip != 'mass' or not len(rows):
        return
    some = rows[:: -(-len(rows) // _SOME)]
    tree = grow(some, space, replace(settings, contamination=None))
    share = float(np.mean(~tree.contains(some)))
    if share > stated + _SLACK:
        yield (
            f'the stated contamination is {stated:g}, but the samples look as if {share:.1%} of '
            'them were outliers; without a stated share it is estimated'
        )


def _rounded_up(share: float) -> str:
    """Return a share to three decimal places, none below it."""
    return f'{-(-share * 1000 // 1) / 1000:g}'
