# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""``occ watch`` beside real monitors and gates, on a terminal and without one."""

import json
import signal
import subprocess
import sys
import time

import pytest
from occ_constraints_pkg.demo.processes import environment

from benchmarks.terminal import TerminalProcess

WATCH = [sys.executable, '-m', 'occ_constraints_pkg', 'watch']
SAFE, BROKEN = (0.8, 0.5), (0.8, 0.96)
_PATIENCE = 60.0


@pytest.fixture
def lines(nodes, tmp_path):
    """Return a function that starts ``occ watch`` without a terminal, and one for its lines."""
    started = []

    def start(*options, **variables):
        path = tmp_path / f'lines{len(started)}'
        with path.open('wb') as output:
            process = subprocess.Popen(
                [*WATCH, *options],
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=subprocess.STDOUT,
                env={**environment(nodes.domain), **variables},
            )
        started.append(process)

        def text():
            assert process.poll() is None, path.read_text()
            return path.read_text()

        return process, text

    yield start
    for process in started:
        process.kill()
        process.wait()


@pytest.fixture
def screen(nodes):
    """Return a function that starts ``occ watch`` on a terminal."""
    started = []

    def start(**variables):
        own = environment(nodes.domain)
        terminal = TerminalProcess(WATCH, own, columns=100, rows=30, variables=variables)
        started.append(terminal)
        return terminal

    yield start
    for terminal in started:
        terminal.__exit__(None, None, None)


def test_each_change_is_a_plain_line_also_of_robots_that_come_die_and_come_again(
    nodes, robots, lines, rules
):
    process, text = lines()
    first = nodes.start('monitor', namespace='/a', constraints_file=rules)
    robots(lambda: '/a  SAFE: margin' in text(), a=SAFE)
    robots(lambda: '/a  rules: 2 rules in force' in text(), a=SAFE)
    robots(lambda: '/a  VIOLATED: R0: y above 0.95 (y 0.96), margin' in text(), a=BROKEN)
    nodes.start('monitor', namespace='/b', constraints_file=rules)
    robots(lambda: '/a  ended: after' in text() and '/b  SAFE' in text(), a=SAFE, b=SAFE)
    robots(lambda: '/b  UNKNOWN: no new input for' in text(), a=SAFE)
    first.send_signal(signal.SIGKILL)
    robots(lambda: '/a  LOST: not heard from' in text(), b=SAFE)
    said = text().count('/a  SAFE')
    nodes.start('monitor', namespace='/a', constraints_file=rules)
    robots(lambda: text().count('/a  SAFE') > said, a=SAFE, b=SAFE)
    whole = text()
    assert '\x1b' not in whole
    assert all(line[2] == line[5] == ':' and line[8] == '.' for line in whole.splitlines())
    process.send_signal(signal.SIGINT)
    assert process.wait(10) == 0


def test_gates_and_reasons_are_told_to_machines(nodes, robots, lines, rules):
    nodes.start('monitor', namespace='/a', constraints_file=rules)
    nodes.start('gate', namespace='/a')
    process, text = lines('--json')

    def told(kind, words):
        changes = [json.loads(line) for line in text().splitlines() if line.endswith('}')]
        return any(item['kind'] == kind and words in item['text'] for item in changes)

    robots(lambda: told('gate', 'PASS'), a=SAFE)
    robots(lambda: told('gate', 'STOP: VIOLATED: y above 0.95'), a=BROKEN)
    process.send_signal(signal.SIGTERM)
    assert process.wait(10) == 0


def test_it_ends_when_nobody_reads_on(nodes, robots, rules):
    nodes.start('monitor', namespace='/a', constraints_file=rules)
    process = subprocess.Popen(
        WATCH,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        env=environment(nodes.domain),
    )
    process.stdout.readline()
    process.stdout.close()
    places = iter([SAFE, BROKEN] * 1000)
    while process.poll() is None:
        place, end = next(places), time.monotonic() + 1.0
        robots(lambda end=end: time.monotonic() > end or process.poll() is not None, a=place)
    assert (process.returncode, process.stderr.read()) == (0, b'')
    process.stderr.close()


def test_a_monitor_without_rules_is_unknown_for_that_reason(nodes, observer, lines):
    nodes.start('monitor', namespace='/a')
    _, text = lines()
    observer.spin_until(lambda: '/a  UNKNOWN: no rule set yet' in text())
    assert 'SAFE' not in text()


def test_verdicts_are_found_under_another_name(nodes, robots, lines, rules, tmp_path):
    parameters = tmp_path / 'p.yaml'
    parameters.write_text(f"/**:\n  ros__parameters:\n    constraints_file: '{rules}'\n")
    arguments = ['-r', '__ns:=/a', '-r', 'violation:=alarms', '-r', '__node:=scan_monitor']
    monitor = subprocess.Popen(
        [*WATCH[:3], 'node', 'monitor', *arguments, '--params-file', str(parameters)],
        env=environment(nodes.domain),
        stderr=subprocess.DEVNULL,
    )
    try:
        _, text = lines()
        robots(lambda: '/a/alarms  VIOLATED: R0' in text(), a=BROKEN)
    finally:
        monitor.send_signal(signal.SIGINT)
        assert monitor.wait(15) == 0


@pytest.mark.parametrize('variables', [{'NO_COLOR': '1'}, {'TERM': 'dumb'}])
def test_a_terminal_that_draws_nothing_gets_plain_lines(screen, variables):
    terminal = screen(**variables)
    assert terminal.read(_PATIENCE, lambda text: b'no monitor is heard' in text)
    assert b'\x1b' not in terminal.output
    terminal.process.send_signal(signal.SIGINT)
    assert terminal.wait() == 0


def test_the_screen_survives_restarts_and_sizes_and_is_left_clean(nodes, robots, screen, rules):
    monitor = nodes.start('monitor', namespace='/a', constraints_file=rules)
    terminal = screen()

    def shown(words):
        def is_there():
            terminal.read(0.0)
            return words in terminal.output

        return is_there

    robots(shown(b'SAFE'), a=SAFE)
    # The values that the rules are about, heard as they were judged.
    robots(shown(b'y 0.5'), a=SAFE)
    robots(shown(b'R0: y above 0.95'), a=BROKEN)
    monitor.send_signal(signal.SIGKILL)
    terminal.output = b''
    robots(shown(b'LOST'), b=SAFE)
    for size in ((60, 20), (20, 5), (160, 50)):
        terminal.resize(*size)
        terminal.process.send_signal(signal.SIGWINCH)
        terminal.read(0.5)
    nodes.start('monitor', namespace='/a', constraints_file=rules)
    terminal.output = b''
    robots(shown(b'VIOLATED'), a=BROKEN)
    terminal.press('\x03')
    assert terminal.wait() == 0
    # The screen of before is back, and the cursor.
    assert b'\x1b[?1049l' in terminal.output
    assert b'\x1b[?25h' in terminal.output
    assert b'Traceback' not in terminal.output


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_the_screen_ends_on_a_signal(screen, number):
    terminal = screen()
    assert terminal.read(_PATIENCE, lambda text: b'no monitor is heard' in text)
    terminal.process.send_signal(number)
    assert terminal.wait() == 0
    assert b'\x1b[?1049l' in terminal.output


def test_keys_change_rules_after_a_question(nodes, observer, robots, screen, rules):
    nodes.start('monitor', namespace='/a', constraints_file=rules)
    nodes.start('tree_learner', namespace='/a', feature_map='simple_nav')
    terminal = screen()

    def shown(words):
        def is_there():
            terminal.read(0.0)
            return words in terminal.output

        return is_there

    def ask(keys, question, answer):
        terminal.output = b''
        terminal.press(keys)
        robots(shown(question), a=SAFE)
        terminal.press('y')
        robots(shown(answer), a=SAFE)

    robots(shown(b'2 rules in force'), a=SAFE)
    ask('\x1b[B ', b'disable R', b'in force; its file stays')
    robots(shown(b'1 rule of 2 in force'), a=SAFE)
    # The disabled one is the last one.
    ask('\x1b[B\x1b[B ', b'enable R', b'2 rules in force')
    ask('r', b'set all counters to 0', b'all counters are 0')
    ask('d', b'judge nothing', b'disable the monitor: disabled')
    robots(shown(b'the monitor is disabled'), a=SAFE)
    ask('e', b'judge again', b'enable the monitor: enabled')
    ask('p', b'rarely violated', b'prune rules: ')
    ask('l', b'learn rules', b'learn rules: ')
    terminal.press('q')
    assert terminal.wait() == 0
