# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Rules as a picture: a row for each feature or family, a panel for each conditional rule."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap, LogNorm
from matplotlib.figure import Figure, SubFigure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Rectangle

from occ_constraints_pkg.errors import DataError
from occ_constraints_pkg.learning.evidence import why_document
from occ_constraints_pkg.picture_style import FIGURE_WIDTH, NEUTRAL, SAFE, VIOLATED, save_figure
from occ_constraints_pkg.rules.constraints_file import Constraints
from occ_constraints_pkg.rules.rule import Literal, Rule, Subject, subject_label
from occ_constraints_pkg.rules.ruleset import RuleSet
from occ_constraints_pkg.terminal import printable

# From a blue that shows where a single sample lies.
_DENSITY = ListedColormap(mpl.colormaps['Blues'](np.linspace(0.3, 1.0, 128)))
# Text that may lie on lines.
_NOTE: dict[str, Any] = {
    'color': VIOLATED,
    'fontsize': 8,
    'zorder': 5,
    'bbox': {'color': 'white', 'alpha': 0.8, 'pad': 0.5},
}
# Above the bar of a row, whose ends may have texts of their own.
_ABOVE = {**_NOTE, 'ha': 'center', 'va': 'bottom'}
# A bar ends where its data do.
_BUTT: dict[str, Any] = {'solid_capstyle': 'butt'}
# Stretches of a row with a text of their own.
_MOST_GAPS = 2
# What is left out is told in the title.
_MOST_ROWS, _MOST_PANELS = 60, 12
_COLUMNS = 2
# Letters of a title over a panel.
_LETTERS = 52
# Cells of the density along each axis.
_CELLS = 48
# A feature of so few values, a mode or a lane, has a cell for each.
_FEW_VALUES = 8
# How far beyond the demonstrated range, in parts of it, bounds are drawn true to scale: in rows,
# and in panels.
_BEYOND, _REACH = 0.16, 3.0


def draw_rules(path: Path, constraints: Constraints, values: np.ndarray | None = None) -> None:
    """Draw the enabled rules to a file; see :func:`rules_figure`.

    Args:
        path: PNG file to write.
        constraints: the rules and their evidence.
        values: (n, k) demonstrated samples; ``None`` where they are not at hand.

    Raises:
        DataError: none of the samples can be judged.
    """
    save_figure(rules_figure(constraints, values), path)


def rules_figure(constraints: Constraints, values: np.ndarray | None = None) -> Figure:
    """Return a figure of the enabled rules.

    Rules about one number are lines in the row of their feature, on the scale of what was
    demonstrated; a family is one row, of its smallest or largest member. Each rule about several
    has a panel with the density of the demonstrations, the corner that it forbids, and what was
    expected there. Of three numbers or more the panel has the two that are beyond their bounds the
    least often, and those samples in which the rest of the rule is true.

    Args:
        constraints: the rules and their evidence.
        values: (n, k) demonstrated samples; ``None`` leaves the demonstrated ranges.

    Raises:
        DataError: none of the samples can be judged.
    """
    rule_set = constraints.rule_set
    if values is not None:
        values = values[rule_set.space.knows(values)]
        if not len(values):
            raise DataError(
                'no sample of the demonstrations has all features within their physical bounds; '
                'to draw their density, at least one is needed'
            )
    enabled = [rule for rule in rule_set.rules if rule.enabled]
    single = [rule for rule in enabled if len(_by_subject(rule)) == 1]
    rows = _rows(rule_set, single)
    panels = [rule for rule in enabled if len(_by_subject(rule)) > 1]
    shown = _most_certain(constraints, panels)
    heights = [0.4 * min(len(rows), _MOST_ROWS) + 1.5]
    if shown:
        heights.append(3.7 * _lines(shown) + 0.8)
    # Names of features are no formulas, whatever signs are in them.
    with plt.rc_context({'text.parse_math': False}):
        figure = plt.figure(figsize=(FIGURE_WIDTH, sum(heights)), layout='constrained')
        parts = figure.subfigures(len(heights), 1, height_ratios=heights, squeeze=False)[:, 0]
        _draw_rows(parts[0], rule_set, rows, values)
        if shown:
            _draw_panels(parts[1], constraints, shown, len(panels), values)
    return figure


def _by_subject(rule: Rule) -> dict[Subject, list[Literal]]:
    """Return the literals that matter, by what they compare with bounds."""
    found: dict[Subject, list[Literal]] = {}
    for literal in rule.tightest_literals:
        found.setdefault(literal.subject, []).append(literal)
    return found


def _values(subject: Subject, samples: np.ndarray) -> np.ndarray:
    """Return (n,) the number of each sample that is compared with the bound."""
    members, which = subject
    return (np.min if which < 0 else np.max)(samples[:, list(members)], axis=1)


def _demonstrated(subject: Subject, rule_set: RuleSet) -> tuple[float, float]:
    ranges = np.asarray(rule_set.demonstrated)[list(subject[0])]
    return float(ranges[:, 0].min()), float(ranges[:, 1].max())


@dataclass(frozen=True)
class _Row:
    """One row: a feature, or a family of which either end or both are bounded."""

    subjects: tuple[Subject, ...]
    rules: tuple[tuple[Subject, Rule], ...]


def _rows(rule_set: RuleSet, single: Iterable[Rule]) -> list[_Row]:
    """Return a row for each feature and family, members with a rule of their own apart."""
    rules: dict[tuple[int, ...], list[tuple[Subject, Rule]]] = {}
    for rule in single:
        (subject,) = _by_subject(rule)
        rules.setdefault(subject[0], []).append((subject, rule))
    family_of = {member: family for family in rule_set.space.families for member in family}
    rows = []
    for place in range(len(rule_set.space)):
        family = family_of.get(place, ())
        if family and place == family[0]:
            own = rules.get(family, [])
            # Without a rule, both ends are of interest.
            ends = sorted({which for (_, which), _ in own}) or [-1, 1]
            if own or not all((member,) in rules for member in family):
                rows.append(_Row(tuple((family, which) for which in ends), tuple(own)))
        if not family or (place,) in rules:
            rows.append(_Row((((place,), 0),), tuple(rules.get((place,), ()))))
    return rows


def _draw_rows(
    part: SubFigure, rule_set: RuleSet, rows: Sequence[_Row], values: np.ndarray | None
) -> None:
    axis = part.subplots()
    # A stable sort: those with rules first, else in the order of the file.
    shown = sorted(sorted(range(len(rows)), key=lambda row: not rows[row].rules)[:_MOST_ROWS])
    labels = []
    for place, row in enumerate(rows[number] for number in shown):
        low, high = _demonstrated(row.subjects[0], rule_set)
        width = (high - low) or 1.0
        for number, subject in enumerate(row.subjects):
            at = place + (number - (len(row.subjects) - 1) / 2) * 0.36
            if values is None:
                axis.plot(
                    [0.0, (high - low) / width], [at, at], color='#bbbbbb', lw=3, zorder=1, **_BUTT
                )
                continue
            points = np.percentile(_values(subject, values), [0, 1, 25, 75, 99, 100])
            points = (points - low) / width
            axis.plot(points[[0, 5]], [at, at], color='#bbbbbb', lw=2, zorder=1, **_BUTT)
            axis.plot(points[[1, 4]], [at, at], color=SAFE, lw=3, alpha=0.5, zorder=2, **_BUTT)
            axis.plot(points[[2, 3]], [at, at], color=SAFE, lw=7, zorder=3, **_BUTT)
        below = -5 if len(row.subjects) == 1 else -9
        # Beside the lines of bounds, which are likely to be here.
        for share, end, side in ((0.0, low, 'left'), ((high - low) / width, high, 'right')):
            axis.annotate(
                f'{end:.3g}', (share, place), (3 if side == 'left' else -3, below),
                textcoords='offset points', ha=side, va='top', fontsize=7, color=NEUTRAL,
                zorder=5, bbox=_NOTE['bbox'],
            )  # fmt: skip
        gaps = sum(len(_by_subject(rule)[subject]) > 1 for subject, rule in row.rules)
        for subject, rule in row.rules:
            literals = _by_subject(rule)[subject]
            bounds = [(literal, (literal.bound - low) / width) for literal in literals]
            named = len(bounds) == 1 or gaps <= _MOST_GAPS
            _draw_bounds(axis, place, bounds, printable(rule.id) if named else '')
        if gaps > _MOST_GAPS:
            axis.text(0.5, place - 0.14, f'{gaps} rules between two bounds each', **_ABOVE)
        both = 'smallest and ' if len(row.subjects) > 1 else ''
        labels.append(both + subject_label(row.subjects[-1], rule_set.space))
    axis.set_yticks(range(len(shown)), ['\n'.join(textwrap.wrap(each, 30)) for each in labels])
    axis.tick_params(labelsize=8)
    axis.set_ylim(len(shown) - 0.4, -0.6)
    axis.set_xlim(-0.5, 1.5)
    axis.set_xlabel('share of the demonstrated range, whose ends are below each bar', fontsize=9)
    title = 'Rules about one feature or family'
    if len(shown) < len(rows):
        title += f' ({len(shown)} of {len(rows)} rows)'
    axis.set_title(title, fontsize=11)
    if values is None:
        handles = [Line2D([], [], color='#bbbbbb', lw=3, label='demonstrated range')]
    else:
        handles = [
            Line2D([], [], color=SAFE, lw=7, label='middle half of the demonstrations'),
            Line2D([], [], color=SAFE, lw=3, alpha=0.5, label='98%'),
            Line2D([], [], color='#bbbbbb', lw=2, label='all'),
        ]
    handles.append(
        Line2D([], [], color=VIOLATED, lw=2, label='bound: violated beyond (triangle: farther out)')
    )
    part.legend(handles=handles, loc='outside lower center', ncols=4, fontsize=7.5, frameon=False)


def _draw_bounds(
    axis: Axes, place: int, bounds: Sequence[tuple[Literal, float]], rule_id: str
) -> None:
    """Draw one or two bounds of a rule at shares of the demonstrated range.

    Args:
        axis: where.
        place: of the row.
        bounds: the literals, each with the share.
        rule_id: for the text beside them; empty for no text, of two bounds.
    """
    texts = [f'{literal.operator} {literal.bound:.4g}' for literal, _ in bounds]
    shares = [min(max(at, -_BEYOND), 1.0 + _BEYOND) for _, at in bounds]
    for (_, at), share in zip(bounds, shares, strict=True):
        if at == share:
            axis.plot([share, share], [place - 0.38, place + 0.38], color=VIOLATED, lw=2, zorder=4)
        else:
            # Too far away to be drawn true to scale.
            marker = '<' if at < share else '>'
            axis.plot(share, place, marker, color=VIOLATED, ms=6, zorder=4)
    text = f'{rule_id}: {" and ".join(texts)}'
    if len(bounds) > 1:
        span = min(shares), max(shares)
        _draw_box(axis, [span, (place - 0.38, place + 0.38)], color=VIOLATED, alpha=0.35, lw=0)
        if rule_id:
            axis.text(sum(span) / 2, place - 0.14, text, **_ABOVE)
    else:
        is_left = bounds[0][0].is_upper
        axis.annotate(
            # Above the bar, which may reach beyond the bound.
            text, (shares[0], place), (-5 if is_left else 5, 4), textcoords='offset points',
            ha='right' if is_left else 'left', va='bottom', **_NOTE,
        )  # fmt: skip


def _most_certain(constraints: Constraints, panels: Sequence[Rule]) -> list[Rule]:
    """Return the rules to draw, in their order; if there are too many, those best proved."""
    if len(panels) <= _MOST_PANELS:
        return list(panels)
    proofs = [why_document(constraints, rule.id).get('evidence', 0.0) for rule in panels]
    best = sorted(range(len(panels)), key=lambda place: -proofs[place])[:_MOST_PANELS]
    return [panels[place] for place in sorted(best)]


def _lines(shown: Sequence[Rule]) -> int:
    """Return how many lines of panels there are."""
    return -(-len(shown) // _COLUMNS)


def _draw_panels(
    part: SubFigure,
    constraints: Constraints,
    shown: Sequence[Rule],
    total: int,
    values: np.ndarray | None,
) -> None:
    title = 'Rules with conditions'
    if len(shown) < total:
        title += f' ({len(shown)} of {total}: those with the most evidence, else the first)'
    part.suptitle(title, fontsize=11)
    axes = np.ravel(part.subplots(_lines(shown), _COLUMNS, squeeze=False))
    others = False
    for axis, rule in zip(axes, shown, strict=False):
        others |= _draw_panel(axis, constraints, rule, shown, values)
    for axis in axes[len(shown) :]:
        axis.remove()
    handles: list[Patch | Line2D] = [
        Patch(fc=(*mpl.colors.to_rgb(VIOLATED), 0.25), ec=VIOLATED, hatch='///', lw=0,
              label='forbidden corner'),
        Line2D([], [], color=VIOLATED, lw=1.5, label='bound'),
    ]  # fmt: skip
    if others:
        handles.append(Patch(fc='none', ec=VIOLATED, ls=':', label='corner of another rule'))
    if values is None:
        handles.append(Patch(fc='none', ec=SAFE, ls='--', label='demonstrated ranges'))
    else:
        handles.append(Patch(color=SAFE, label='demonstrations (darker: more time)'))
    part.legend(handles=handles, loc='outside lower center', ncols=4, fontsize=8, frameon=False)


def _draw_panel(
    axis: Axes,
    constraints: Constraints,
    rule: Rule,
    shown: Sequence[Rule],
    values: np.ndarray | None,
) -> bool:
    """Draw one rule in two dimensions; return whether a corner of another rule is there, too."""
    rule_set = constraints.rule_set
    space, literals = rule_set.space, _by_subject(rule)
    drawn = _drawn_subjects(literals, values)
    rest = [subject for subject in literals if subject not in drawn]
    if values is not None:
        values = values[_hold((one for subject in rest for one in literals[subject]), values)]
    scales = [_Scale.of(subject, literals[subject], rule_set, values) for subject in drawn]
    if values is None:
        ranges = [_demonstrated(subject, rule_set) for subject in drawn]
        _draw_box(axis, ranges, fc='none', ec=SAFE, ls='--', lw=1.0)
    elif len(values):
        x, y = (scale.edges for scale in scales)
        points = np.stack([_values(subject, values) for subject in drawn], axis=1)
        counts = np.histogramdd(points, bins=[x, y])[0]
        shade = LogNorm(vmin=1.0, vmax=max(2.0, counts.max()))
        axis.pcolormesh(x, y, np.where(counts > 0, counts, np.nan).T, cmap=_DENSITY, norm=shade)
    corner = [
        scale.covered(literals[subject]) for scale, subject in zip(scales, drawn, strict=True)
    ]
    _draw_box(axis, corner, fc=(*mpl.colors.to_rgb(VIOLATED), 0.25), ec=VIOLATED, hatch='///',
              lw=0)  # fmt: skip
    others = [_by_subject(other) for other in shown if other is not rule]
    others = [other for other in others if other.keys() == literals.keys() and not rest]
    for other in others:
        spans = [
            scale.covered(other[subject]) for scale, subject in zip(scales, drawn, strict=True)
        ]
        _draw_box(axis, spans, fc='none', ec=VIOLATED, ls=':', lw=1.0)
    for vertical, subject, span in zip((True, False), drawn, corner, strict=True):
        _draw_limits(axis, literals[subject], span, vertical=vertical)
    axis.set_xlim(scales[0].low, scales[0].high)
    axis.set_ylim(scales[1].low, scales[1].high)
    for scale, which in zip(scales, (axis.xaxis, axis.yaxis), strict=True):
        if scale.kinds:
            which.set_ticks(scale.kinds, [f'{kind:g}' for kind in scale.kinds])
    axis.set_xlabel(subject_label(drawn[0], space), fontsize=8)
    axis.set_ylabel(subject_label(drawn[1], space), fontsize=8)
    axis.tick_params(labelsize=8)
    condition = [one for subject in rest for one in literals[subject]]
    axis.set_title(_title(constraints, rule, condition), fontsize=8, loc='left', pad=14)
    return bool(others)


def _drawn_subjects(
    literals: dict[Subject, list[Literal]], values: np.ndarray | None
) -> list[Subject]:
    """Return the two subjects to draw: those that are beyond their bounds the least often.

    Modes and the like come last: an axis of three values shows little.
    """
    subjects = list(literals)
    if len(subjects) == 2 or values is None:
        return subjects[:2]
    order = sorted(
        subjects,
        key=lambda subject: (
            bool(_kinds(_values(subject, values))),
            float(_hold(literals[subject], values).mean()),
        ),
    )
    return [subject for subject in subjects if subject in order[:2]]


def _hold(literals: Iterable[Literal], values: np.ndarray) -> np.ndarray:
    """Return (n,) bool, whether all literals hold in (n, k) samples."""
    held = np.ones(len(values), dtype=bool)
    for literal in literals:
        held &= literal.holds(literal.values(values))
    return held


def _kinds(points: np.ndarray) -> list[float]:
    """Return the distinct values if they are few, else none."""
    # Most features have many, which shows in their first samples.
    if len(np.unique(points[: 50 * _FEW_VALUES])) > _FEW_VALUES:
        return []
    kinds = np.unique(points)
    return kinds.tolist() if 1 < len(kinds) <= _FEW_VALUES else []


@dataclass(frozen=True)
class _Scale:
    """One axis of a panel.

    Attributes:
        edges: of the cells of the density, ascending; the first and last are those of the axis.
        kinds: the distinct values of a mode or the like, one in each cell; else empty.
    """

    edges: np.ndarray
    kinds: list[float]

    @classmethod
    def of(
        cls,
        subject: Subject,
        literals: Iterable[Literal],
        rule_set: RuleSet,
        values: np.ndarray | None,
    ) -> _Scale:
        """Return the axis that shows the demonstrations and all bounds of a rule."""
        points = np.array(_demonstrated(subject, rule_set))
        if values is not None and len(values):
            points = _values(subject, values)
        bounds = [literal.bound for literal in literals]
        kinds = _kinds(points) if values is not None else []
        if kinds and kinds[0] <= min(bounds) and max(bounds) <= kinds[-1]:
            ends = [kinds[0] - (kinds[1] - kinds[0]), *kinds, kinds[-1] + (kinds[-1] - kinds[-2])]
            return cls((np.array(ends[1:]) + np.array(ends[:-1])) / 2, kinds)
        # A bound far from all that was shown would leave the demonstrations no room.
        reach = _REACH * (float(np.ptp(points)) or 1.0)
        near = [bound for bound in bounds if points.min() - reach <= bound <= points.max() + reach]
        low, high = min([points.min(), *near]), max([points.max(), *near])
        room = 0.12 * (high - low) or 1.0
        # Physical limits end the axis, unless a corner would have no room.
        limits = rule_set.space.finite_bounds[:, subject[0][0]]
        begin, end = max(low - room, limits[0]), min(high + room, limits[1])
        begin = begin if begin < min(near, default=np.inf) else low - room
        end = end if end > max(near, default=-np.inf) else high + room
        return cls(np.linspace(begin, end, _CELLS + 1), [])

    @property
    def low(self) -> float:
        """Where the axis begins."""
        return float(self.edges[0])

    @property
    def high(self) -> float:
        """Where the axis ends."""
        return float(self.edges[-1])

    def covered(self, literals: Sequence[Literal]) -> tuple[float, float]:
        """Return from where to where all literals of this axis hold, as far as it is drawn.

        Of a mode, these are whole cells.
        """
        held = [
            place
            for place, kind in enumerate(self.kinds)
            if all(literal.holds(np.array([kind]))[0] for literal in literals)
        ]
        if held:
            return float(self.edges[held[0]]), float(self.edges[held[-1] + 1])
        low = max([literal.bound for literal in literals if not literal.is_upper], default=self.low)
        high = min([literal.bound for literal in literals if literal.is_upper], default=self.high)
        # One number alone is as wide as a cell.
        room = (self.edges[1] - self.edges[0]) / 2 if low == high else 0.0
        left, right = np.clip([low - room, high + room], self.low, self.high)
        return float(left), float(right)


def _draw_box(axis: Axes, spans: Sequence[tuple[float, float]], **style: Any) -> None:
    (left, right), (bottom, top) = spans
    axis.add_patch(Rectangle((left, bottom), right - left, top - bottom, **style))


def _draw_limits(
    axis: Axes, literals: Sequence[Literal], span: tuple[float, float], *, vertical: bool
) -> None:
    """Draw the ends of a corner that are bounds as lines, with the bounds outside the axes."""
    for literal in literals:
        at = span[1] if literal.is_upper else span[0]
        text = f'{literal.operator} {literal.bound:.4g}'
        style: dict[str, Any] = {'color': VIOLATED, 'fontsize': 8}
        # Two of them grow away from each other.
        is_single = len(literals) == 1
        if vertical:
            axis.axvline(at, color=VIOLATED, lw=1.5)
            side = 'center' if is_single else 'left' if literal.is_upper else 'right'
            across = axis.get_xaxis_transform()
            axis.text(at, 1.01, text, ha=side, va='bottom', transform=across, **style)
        else:
            axis.axhline(at, color=VIOLATED, lw=1.5)
            side = 'center' if is_single else 'bottom' if literal.is_upper else 'top'
            across = axis.get_yaxis_transform()
            axis.text(1.01, at, text, ha='left', va=side, transform=across, **style)


def _title(constraints: Constraints, rule: Rule, condition: Sequence[Literal]) -> str:
    """Return id and words of a rule, what was expected and seen, and what is not on the axes."""
    space = constraints.rule_set.space
    lines = textwrap.wrap(f'{printable(rule.id)}: {rule.words(space)}', _LETTERS)
    why = why_document(constraints, rule.id)
    if 'expected' in why:
        lines.append(
            f'there: expected {why["expected"]:.2%}, seen {why["seen"]:.2%}, '
            f'evidence {why["evidence"]:.0f}'
        )
    if condition:
        words = Rule(rule.id, tuple(condition)).words(space)
        lines += textwrap.wrap(f'drawn where {words}', _LETTERS)
    return '\n'.join(lines)
