# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The parts of the screen as lines of styled text, cut to a width.

Each state is written out, so that no colour is needed to read it.
"""

from __future__ import annotations

import math
import time
from collections import Counter
from collections.abc import Sequence

from occ_constraints_pkg.fleet.margins import BUCKET_SECONDS
from occ_constraints_pkg.fleet.model import Fleet, Robot, RuleRow, Standing
from occ_constraints_pkg.terminal import printable

Span = tuple[str, str]
"""Text and the name of its style: empty, or as ``bold red``."""
Line = list[Span]

_BARS = '▁▂▃▄▅▆▇█'
_STYLES = {
    'SAFE': 'green',
    'VIOLATED': 'bold red',
    'UNKNOWN': 'bold yellow',
    'LOST': 'bold yellow',
    'failed': 'bold red',
    'done': 'green',
    'STOP': 'bold red',
    'SLOW': 'yellow',
    'PASS': 'green',
}
_SPARK_WIDTH = 24
_LEGEND = 'x violated, ? unknown'


def robot_lines(fleet: Fleet, chosen: str, width: int, height: int, now: float) -> list[Line]:
    """Return a line for each robot: standing, margin now and over time, gate, and why.

    Where not all fit, the chosen one is among those shown, and the last line counts the others.

    Args:
        fleet: the robots.
        chosen: topic of the one that is marked.
        width: characters in a line.
        height: lines.
        now: the time.
    """
    longest = max((len(robot.name) for robot in fleet.robots.values()), default=0)
    name_width = min(max(longest, 5), max(12, width // 4))
    spark = _SPARK_WIDTH if width >= 90 else 12 if width >= 60 else 0
    lines = []
    shown = _around(list(fleet.robots), chosen, height)
    for topic in shown:
        robot = fleet.robots[topic]
        standing = robot.standing(now)
        margin = f'{robot.report.margin:7.3f}' if standing < Standing.UNKNOWN else '      -'
        gates = fleet.gates_of(robot)
        gate = ' '.join(item.words for item in gates)
        line: Line = [
            ('> ' if topic == chosen else '  ', 'bold'),
            (f'{shortened(robot.name, name_width):{name_width}} ', 'bold'),
            (f'{standing.name:8} ', _STYLES[standing.name]),
            (f'{margin} ', ''),
        ]
        if spark:
            line += [*_sparkline(robot.margins(spark, now)), (' ', '')]
        if gates:
            line.append((f'gate {gate}  ', _STYLES.get(gate.partition(' ')[0], 'bold yellow')))
        line.append((_remark(robot, now), ''))
        lines.append(cut(line, width))
    hidden = [robot for topic, robot in fleet.robots.items() if topic not in shown]
    if hidden:
        counts = Counter(robot.standing(now) for robot in hidden)
        line = [(f'  {len(hidden)} more:', 'dim')]
        for standing in sorted(counts, reverse=True):
            line.append((f' {counts[standing]} {standing.name}', _STYLES[standing.name]))
        lines.append(cut(line, width))
    return lines[: max(height, 0)]


def detail_lines(robot: Robot, fleet: Fleet, width: int, now: float) -> list[Line]:
    """Return what is known of one robot beside its rules: why, the gates, the margin over time."""
    standing = robot.standing(now)
    lines: list[Line] = [
        [(standing.name, _STYLES[standing.name]), (_after(': ', robot.why(now)), '')]
    ]
    lines += [
        [
            (f'gate {gate.name}: ', ''),
            (gate.words, _STYLES.get(gate.report.state, '') if not gate.is_lost else 'bold yellow'),
            ('' if gate.is_lost else _after(': ', gate.report.reason), ''),
        ]
        for gate in fleet.gates_of(robot)
    ]
    count = max(10, width - 36)
    label = f'margin, {count * BUCKET_SECONDS:.0f} s '
    lines.append([(label, ''), *_sparkline(robot.margins(count, now)), (f' {_LEGEND}', 'dim')])
    if robot.problem:
        lines.append([(robot.problem, 'bold yellow')])
    return [cut(line, width) for line in lines]


def rule_lines(robot: Robot, chosen: str, width: int, height: int, now: float) -> list[Line]:
    """Return the rules, the closest first, as many as fit; the chosen one is among them.

    Args:
        robot: whose rules.
        chosen: id of the marked rule; empty for none.
        width: characters in a line.
        height: lines, the head included.
        now: the time.
    """
    order, margins = robot.closeness(now)
    if not len(order):
        return [[('no rules have been heard of yet', 'dim')]][:height]
    ids = [robot.rule_set.rules[index].id for index in order]
    room = max(1, height - 1)
    place = ids.index(chosen) if chosen in ids else 0
    first = max(0, min(place - room + 1, len(ids) - room))
    rows = [robot.rule_row(index, margins, now) for index in order[first : first + room]]
    counted = width >= 90
    id_width = min(max(len(row.id) for row in rows), 16)
    left = width - id_width - 12 - (18 if counted else 0)
    value_width = min(max((len(row.values) for row in rows), default=0), max(left // 3, 8))
    value_width = max(value_width, len('values'))
    hidden = len(ids) - len(rows)
    head = f'  {"rule":{id_width}}  margin  {"values":{value_width}}  violation'
    head += f' ({hidden} more)' if hidden else ''
    lines: list[Line] = [cut([(head, 'dim')], width)]
    for row in rows:
        line = _rule_line(row, row.id == chosen, id_width, value_width)
        if counted and row.counted is not None:
            counts = f'{row.counted[0]} of {row.counted[1]}'
            line = [*cut(line, width - 18, fill=True), (f'{counts:>18}', 'dim')]
        lines.append(cut(line, width))
    return lines


def change_lines(fleet: Fleet, width: int, height: int, now: float) -> list[Line]:
    """Return the newest changes, the newest first, as many as fit."""
    lines = []
    for change in fleet.changes():
        if len(lines) == height:
            break
        clock = time.strftime('%H:%M:%S', time.localtime(time.time() - (now - change.time)))
        line: Line = [
            (f'{clock} ', 'dim'),
            (f'{printable(change.source)} ', 'bold'),
            (change.kind, _STYLES.get(change.kind, '')),
            (f': {printable(change.text)}', ''),
        ]
        lines.append(cut(line, width))
    return lines


def cut(line: Line, width: int, *, fill: bool = False) -> Line:
    """Return a line with at most ``width`` characters, or just as many."""
    result, left = [], width
    for text, style in line:
        if len(text) > left:
            text = shortened(text, left)
        if text:
            result.append((text, style))
        left -= len(text)
    if fill and left > 0:
        result.append((' ' * left, ''))
    return result


def shortened(text: str, width: int) -> str:
    """Return text with at most ``width`` characters; an ellipsis shows that there was more."""
    return text if len(text) <= width else f'{text[: width - 1]}…' if width > 0 else ''


def _around(items: list[str], chosen: str, height: int) -> list[str]:
    """Return the items that fit, the chosen one among them, with a line left for the others."""
    if len(items) <= height:
        return items
    room = max(height - 1, 0)
    place = items.index(chosen) if chosen in items else 0
    first = max(0, min(place - room + 1, len(items) - room))
    return items[first : first + room]


def _rule_line(row: RuleRow, is_chosen: bool, id_width: int, value_width: int) -> Line:
    if not row.enabled:
        margin, style = '     off', 'dim'
    elif math.isnan(row.margin):
        margin, style = '       ?', 'bold yellow'
    else:
        margin, style = f'{row.margin:8.3f}', 'bold red' if row.margin <= 0.0 else ''
    rest = 'dim' if not row.enabled else ''
    return [
        ('> ' if is_chosen else '  ', 'bold'),
        (f'{shortened(printable(row.id), id_width):{id_width}}', rest),
        (margin, style),
        (f'  {shortened(printable(row.values), value_width):{value_width}}', rest),
        (f'  {row.words}', rest),
    ]


def _remark(robot: Robot, now: float) -> str:
    remarks = []
    if robot.publishers > 1:
        remarks.append(f'{robot.publishers} publishers of verdicts')
    if robot.is_recorded:
        remarks.append('played back, not live')
    why = robot.why(now)
    if why:
        remarks.append(why)
    elif robot.report is not None and robot.report.next_rule:
        report = robot.report
        remarks.append(f'next {report.next_rule} in {report.seconds:.1f} s (estimate)')
    return '; '.join(remarks)


def _sparkline(margins: Sequence[float | None]) -> list[Span]:
    """Draw margins; ``x`` where violated, ``?`` where unknown, a blank where nothing came."""
    largest = max((item for item in margins if item is not None and item > 0.0), default=1.0)
    if not math.isfinite(largest):
        largest = 1.0
    spans: list[Span] = []
    for margin in margins:
        if margin is None:
            span = (' ', '')
        elif math.isnan(margin) or margin == -math.inf:
            span = ('?', 'bold yellow')
        elif margin <= 0.0:
            span = ('x', 'bold red')
        else:
            level = min(int(margin / largest * len(_BARS)), len(_BARS) - 1)
            span = (_BARS[level], 'green')
        if spans and spans[-1][1] == span[1]:
            spans[-1] = (spans[-1][0] + span[0], span[1])
        else:
            spans.append(span)
    return spans


def _after(mark: str, text: str) -> str:
    return f'{mark}{text}' if text else ''
