# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The screen of the live view: panels, keys, and questions before anything is changed."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import lru_cache
from itertools import zip_longest
from typing import ClassVar, Protocol

from rich.cells import cell_len
from rich.segment import Segment
from rich.style import Style
from textual.app import App, ComposeResult
from textual.binding import Binding
from textual.events import Key
from textual.geometry import Region
from textual.strip import Strip
from textual.widget import Widget

from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.fleet.model import Fleet, Robot
from occ_constraints_pkg.stopping import parent_is_gone, stop_request
from occ_constraints_pkg.terminal import printable
from occ_constraints_pkg.watch.lines import LOOK_SECONDS, NOBODY
from occ_constraints_pkg.watch.panels import (
    Line,
    change_lines,
    detail_lines,
    robot_lines,
    rule_lines,
)

# Fits 80 columns.
_KEYS = (
    ('q', 'quit'),
    ('Tab', 'robot'),
    ('↑↓', 'rule'),
    ('Space', 'switch'),
    ('e/d', 'judge'),
    ('p', 'prune'),
    ('r', 'reset'),
    ('l', 'learn'),
    ('c', 'clear'),
)


class Services(Protocol):
    """What can be asked of monitors and learners, see :class:`fleet.calls.Calls`."""

    @property
    def under_way(self) -> list[str]:
        """What is being done."""

    def prune(self, monitor: str) -> None:
        """Prune rules."""

    def reset_stats(self, monitor: str) -> None:
        """Set counters to 0."""

    def enable(self, monitor: str, is_enabled: bool) -> None:
        """Let a monitor judge, or not."""

    def learn(self, learner: str) -> None:
        """Learn rules."""

    def enable_rule(self, monitor: str, rule: str, is_enabled: bool) -> None:
        """Enable or disable a rule."""


class Source(Protocol):
    """Where the fleet is heard, see :class:`fleet.network.Network`."""

    calls: Services

    def poll(self) -> None:
        """Bring the fleet up to date."""

    def forget_lost(self) -> None:
        """Drop what is lost."""

    def learners(self, robot: Robot) -> list[str]:
        """Return the nodes that learn rules for a robot."""


class _Panel(Widget):
    """Some lines of text with a frame; only what has changed is drawn again."""

    def __init__(self, name: str) -> None:
        super().__init__(id=name)
        self._lines: list[Line] = []

    def show(self, lines: list[Line]) -> None:
        """Show these lines instead of those before."""
        before, self._lines = self._lines, lines
        pairs = enumerate(zip_longest(before, lines))
        changed = [y for y, (old, new) in pairs if old != new and y < self.size.height]
        if changed:
            self.refresh(*(Region(0, y, self.size.width, 1) for y in changed))

    def render_line(self, y: int) -> Strip:
        """Return one line for the screen."""
        line = self._lines[y] if y < len(self._lines) else []
        segments = [Segment(text, _style(style)) for text, style in line]
        length = sum(cell_len(text) for text, _ in line)
        strip = Strip(segments, length).adjust_cell_length(self.size.width)
        return strip.apply_style(self.rich_style)


@lru_cache(maxsize=64)
def _style(name: str) -> Style:
    return Style.parse(name)


class WatchApp(App[None]):
    """Shows a fleet; redraws at a fixed rate, however fast messages come.

    Attributes:
        error: what ended the view; None after an ordinary end.

    Args:
        fleet: what is shown.
        source: brings it up to date.
    """

    ENABLE_COMMAND_PALETTE = False
    CSS = """
    _Panel { border: round $secondary; padding: 0; }
    #robots { height: auto; max-height: 40%; }
    #rules { height: 1fr; }
    #changes { height: 25%; min-height: 4; }
    #bar { border: none; height: 1; }
    """
    BINDINGS: ClassVar[list[Binding]] = [
        Binding('ctrl+c,ctrl+q,q', 'quit', priority=True),
        Binding('tab,right', 'robot(1)', priority=True),
        Binding('shift+tab,left', 'robot(-1)', priority=True),
        Binding('down,j', 'rule(1)'),
        Binding('up,k', 'rule(-1)'),
        Binding('space', 'switch_rule'),
        Binding('e', 'enable(True)'),
        Binding('d', 'enable(False)'),
        Binding('p', 'prune'),
        Binding('r', 'reset'),
        Binding('l', 'learn'),
        Binding('c', 'clear'),
    ]

    def __init__(self, fleet: Fleet, source: Source) -> None:
        super().__init__()
        self.error: OccError | None = None
        self._fleet, self._source = fleet, source
        self._topic, self._rule = '', ''
        self._question: tuple[str, Callable[[], None]] | None = None

    def compose(self) -> ComposeResult:
        """Yield the panels."""
        for name in ('robots', 'rules', 'changes', 'bar'):
            yield _Panel(name)

    def on_mount(self) -> None:
        """Begin to listen."""
        self.query_one('#robots').border_title = 'robots'
        self.query_one('#changes').border_title = 'events'
        self._tick()
        self.set_interval(LOOK_SECONDS, self._tick)

    def on_resize(self) -> None:
        """Show what fits now."""
        self._show()

    def on_key(self, event: Key) -> None:
        """Take the answer to a question; while one is open, no other key does anything."""
        if self._question is None:
            return
        event.prevent_default()
        event.stop()
        _, action = self._question
        if event.key in ('y', 'Y'):
            action()
        self._question = None
        self._show()

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        """Allow nothing but to quit while a question is open."""
        return self._question is None or action == 'quit'

    def _tick(self) -> None:
        if stop_request.made or parent_is_gone():
            self.exit()
            return
        try:
            self._source.poll()
        except OccError as error:
            self.error = error
            self.exit()
            return
        # Plain lines are for those without a screen.
        self._fleet.fresh_changes()
        self._show()

    @property
    def _robot(self) -> Robot | None:
        """The robot that is chosen; the first one if that has gone."""
        robots = self._fleet.robots
        if self._topic not in robots:
            self._topic = next(iter(robots), '')
        return robots.get(self._topic)

    def _show(self) -> None:
        if not self.is_mounted:
            return
        now, robot = time.monotonic(), self._robot
        robots, rules = self.query_one('#robots', _Panel), self.query_one('#rules', _Panel)
        changes, bar = self.query_one('#changes', _Panel), self.query_one('#bar', _Panel)
        width = self.size.width - 2
        if robot is None:
            robots.show([[(NOBODY, '')]])
            rules.border_title = 'rules'
            rules.show([])
            robots.styles.height = 3
        else:
            # As many lines as there are robots, up to the largest height of the panel.
            robots.styles.height = len(self._fleet.robots) + 2
            height = robots.size.height
            robots.show(robot_lines(self._fleet, self._topic, width, height, now))
            rules.border_title = f'rules of {printable(robot.name)}'
            details = detail_lines(robot, self._fleet, width, now)
            room = rules.size.height - len(details)
            rules.show(details + rule_lines(robot, self._rule, width, room, now))
        changes.show(change_lines(self._fleet, width, changes.size.height, now))
        bar.show([self._bar()])

    def _bar(self) -> Line:
        if self._question is not None:
            # First of all, for a long question is cut off.
            return [(f'(y/n) {self._question[0]}', 'bold reverse')]
        under_way = self._source.calls.under_way
        if under_way:
            return [(f'{"; ".join(under_way)} ...', 'bold')]
        return [part for key, what in _KEYS for part in ((key, 'bold reverse'), (f' {what} ', ''))]

    def _ask(self, question: str, action: Callable[[], None]) -> None:
        self._question = (printable(question), action)
        self._show()

    def _monitor(self) -> str:
        """Return the monitor of the chosen robot; empty, and said so, where there is none."""
        robot = self._robot
        if robot is None or not robot.monitor:
            self._note('failed', 'no monitor is known that could be asked')
            return ''
        return robot.monitor

    def _note(self, kind: str, text: str) -> None:
        source = self._robot.name if self._robot else '-'
        self._fleet.note(time.monotonic(), source, kind, text)
        self._show()

    def action_robot(self, step: int) -> None:
        """Choose the next robot or the one before."""
        topics = list(self._fleet.robots)
        if topics:
            place = topics.index(self._topic) if self._topic in topics else 0
            self._topic, self._rule = topics[(place + step) % len(topics)], ''
            self._show()

    def action_rule(self, step: int) -> None:
        """Choose the next rule or the one before, in the order shown."""
        robot = self._robot
        if robot is None or robot.rule_set is None:
            return
        order, _ = robot.closeness(time.monotonic())
        ids = [robot.rule_set.rules[index].id for index in order]
        place = ids.index(self._rule) + step if self._rule in ids else 0
        self._rule = ids[max(0, min(place, len(ids) - 1))] if ids else ''
        self._show()

    def action_switch_rule(self) -> None:
        """Enable or disable the chosen rule."""
        robot, monitor = self._robot, self._monitor()
        rules = robot.rule_set.rules if monitor and robot and robot.rule_set else ()
        rule = next((item for item in rules if item.id == self._rule), None)
        if rule is None:
            if monitor:
                self._note('failed', 'no rule is chosen; allowed are the arrows up and down')
            return
        word, space = ('disable', 'enable')[not rule.enabled], robot.rule_set.space
        self._ask(
            f'{monitor}: {word} {rule.id}, {rule.words(space)}?',
            lambda: self._source.calls.enable_rule(monitor, rule.id, not rule.enabled),
        )

    def action_enable(self, is_enabled: bool) -> None:
        """Let the monitor judge, or answer every input by UNKNOWN."""
        monitor = self._monitor()
        if monitor:
            word = 'judge again' if is_enabled else 'judge nothing, so that a gate stops the robot'
            self._ask(
                f'{monitor}: {word}?',
                lambda: self._source.calls.enable(monitor, is_enabled),
            )

    def action_prune(self) -> None:
        """Let the monitor disable rules that were rarely violated."""
        monitor = self._monitor()
        if monitor:
            self._ask(
                f'{monitor}: disable the rules that were rarely violated?',
                lambda: self._source.calls.prune(monitor),
            )

    def action_reset(self) -> None:
        """Let the monitor set its counters to 0."""
        monitor = self._monitor()
        if monitor:
            self._ask(
                f'{monitor}: set all counters to 0?',
                lambda: self._source.calls.reset_stats(monitor),
            )

    def action_learn(self) -> None:
        """Let the learner of the robot's namespace learn, and hand out new rules."""
        robot = self._robot
        learners = self._source.learners(robot) if robot else []
        if len(learners) != 1:
            found = ', '.join(learners) or 'none'
            self._note('failed', f'learn: found {found}; allowed is one tree_learner beside it')
            return
        self._ask(
            f'{learners[0]}: learn rules, by which the monitor then judges?',
            lambda: self._source.calls.learn(learners[0]),
        )

    def action_clear(self) -> None:
        """Drop robots and gates that are lost."""
        self._source.forget_lost()
        self._show()

    async def action_quit(self) -> None:
        """End the view."""
        self.exit()
