# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Write docs/claims.md: each claim, the tests that hold it, and the figure measured last.

Usage: python scripts/claims.py. A test sees that the page is up to date and that the tests exist.
"""

from __future__ import annotations

import ast
import json
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
TARGET = ROOT / 'docs' / 'claims.md'
_RESULTS = ROOT / 'docs' / 'results'


@dataclass(frozen=True)
class Figure:
    """Numbers of a file of results, in words.

    Attributes:
        file: below docs/results.
        words: a format string of the file's ``metrics``.
        command: what measures it.
    """

    file: str
    words: str
    command: str

    def text(self) -> str:
        """Return the words with the numbers."""
        metrics = json.loads((_RESULTS / self.file).read_text(encoding='utf-8'))['metrics']
        return f'{self.words.format(**metrics)} (`{self.command}`, [record](results/{self.file}))'


@dataclass(frozen=True)
class Claim:
    """A claim in one sentence.

    Attributes:
        text: the sentence.
        tests: each ``FILE::FUNCTION``, below tests.
        figure: what was measured last; None for a claim that holds or does not.
    """

    text: str
    tests: tuple[str, ...]
    figure: Figure | None = None

    def missing(self) -> list[str]:
        """Return those tests that are not there."""
        return [test for test in self.tests if not _exists(*test.split('::'))]

    def row(self) -> str:
        """Return the line of the table."""
        tests = ', '.join(f'`{test}`' for test in self.tests)
        return f'| {self.text} | {tests} | {self.figure.text() if self.figure else ""} |'


def _exists(file: str, function: str) -> bool:
    path = ROOT / 'tests' / file
    if not path.is_file():
        return False
    tree = ast.parse(path.read_text(encoding='utf-8'))
    return any(isinstance(node, ast.FunctionDef) and node.name == function for node in tree.body)


CLAIMS = (
    Claim(
        'Rules are true exactly outside the safe set that was learned, bounds included.',
        (
            'learning/test_extraction.py::test_rules_are_the_complement_of_any_tree',
            'learning/test_simplification.py::test_any_rules_mean_the_same_when_simplified',
        ),
    ),
    Claim(
        'Every way of judging gives the same verdicts as a plain loop over literals, also in C.',
        (
            'rules/test_evaluation.py::test_all_ways_agree_with_a_loop',
            'rules/test_export_c.py::test_any_rule_set',
        ),
    ),
    Claim(
        'Offline equals online: `occ check` and the monitor give the same rows.',
        (
            'system/test_offline_online.py::test_a_made_up_bag',
            'system/test_offline_online.py::test_a_real_bag',
        ),
    ),
    Claim(
        'The gate lets no command through that no fresh verdict allows.',
        (
            'system/test_gate.py::test_verdicts_that_prove_nothing_about_now_never_open_it',
            'system/test_gate.py::test_two_publishers_stop_it_whatever_they_say',
            'system/test_gate.py::test_a_paused_gate_does_not_drive_on_what_it_heard_before',
            'system/test_gate.py::test_a_recorded_monitor_that_is_played_back_opens_nothing',
        ),
        Figure(
            'gate_soak.json',
            '{breaches:.0f} breaches in {interleavings:.0f} random stops, kills and restarts, with '
            '{commands_not_zero:.0f} commands that were not zero',
            'python -m benchmarks gate --seconds 720',
        ),
    ),
    Claim(
        'Missing, late, future or impossible input is UNKNOWN, and UNKNOWN costs 1.',
        (
            'system/test_monitor.py::test_numbers_that_are_none_are_unknown_and_cost',
            'system/test_fails_closed.py::'
            'test_a_bridge_that_falls_behind_is_late_until_it_has_caught_up',
        ),
    ),
    Claim(
        'A day of messages: nothing is lost (tested shortly); nodes do not grow (measured only).',
        ('benchmarks/test_soak.py::test_a_short_soak_counts_all_that_it_sent',),
        Figure(
            'soak.json',
            '{messages:.0f} messages ({hours_at_10hz:.0f} h at 10 Hz): {lost_messages:.0f} lost, '
            'monitor {monitor_growth_memory_mb:+.1f} MB, gate {gate_growth_memory_mb:+.1f} MB, '
            '{monitor_growth_descriptors:+.0f} and {gate_growth_descriptors:+.0f} open files',
            'python -m benchmarks soak',
        ),
    ),
    Claim(
        'A faulty rule set on `constraints` is refused, and the one before stays.',
        (
            'system/test_bad_rules.py::'
            'test_what_cannot_be_used_is_refused_with_the_reason_and_the_rules_stay',
        ),
    ),
    Claim(
        'Monitor and gate load nothing that apt lacks.',
        ('system/test_apt_only.py::test_monitor_and_gate_work_without_anything_else',),
    ),
    Claim(
        'A recorder that is killed loses at most half a second.',
        (
            'rosbag/test_writer.py::test_a_killed_recorder_loses_no_more_than_it_promises',
            'system/test_recorder.py::test_a_recorder_of_many_topics_loses_next_to_nothing',
        ),
    ),
    Claim(
        'A re-learn never silently replaces what a person has edited.',
        (
            'rules/test_constraints_file.py::test_a_relearn_never_silently_replaces_an_edit',
            'rules/test_constraints_file.py::test_edits_are_noticed',
        ),
    ),
    Claim(
        'With `--false-alarm P`, a fresh safe episode raises an alarm with probability at most P.',
        (
            'learning/test_calibration.py::test_fresh_episodes_raise_no_more_alarms_than_promised',
            'learning/test_calibration.py::test_the_promise_holds_for_conditional_rules',
        ),
    ),
    Claim(
        'A training survives the death of any of its nodes; a resumed one gives the same curve.',
        (
            'system/test_training.py::test_training_survives_the_death_of_any_node',
            'agents/test_training.py::test_a_resumed_training_gives_the_same_curve',
        ),
    ),
    Claim(
        'A mistake in the input of a node is told in one sentence, with exit code 2.',
        ('system/test_mistakes.py::test_a_mistake_is_told_in_one_sentence',),
    ),
    Claim(
        'A launch starts nothing on a mistake, and ends with its work or the first node that dies.',
        (
            'launching/test_arguments.py::test_a_mistake_starts_nothing',
            'launching/test_ends.py::test_a_node_that_dies_ends_the_launch',
        ),
    ),
)

_HEAD = """\
# Claims

What this package claims, the tests (below `tests/`) that fail where it is not so, and, where a
claim is a number, the one measured last, with its command and its record. Written by
`python scripts/claims.py`; speeds are in [speed.md](speed.md).

| claim | tests | measured |
|---|---|---|
"""


def page() -> str:
    """Return the text of the page."""
    return _HEAD + ''.join(f'{claim.row()}\n' for claim in CLAIMS)


if __name__ == '__main__':
    TARGET.write_text(page(), encoding='utf-8')
