# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""What two processes find in the ROS domain: each other, and who else is there."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections import Counter
from pathlib import Path
from typing import Any

from occ_constraints_pkg.doctor.findings import NOTE, OK, PROBLEM, Finding
from occ_constraints_pkg.doctor.probe import PUBLISHED_HERE
from occ_constraints_pkg.terminal import printable
from occ_constraints_pkg.wording import count_of

# How long a message may take; how long a process may, rclpy's loading included.
_HEAR_SECONDS, _PROBE_SECONDS = 4.0, 7.0
_AGAIN_SECONDS = 3.0
# The gate trusts no verdict from further ahead or behind.
_MOST_AHEAD, _MOST_BEHIND = 0.1, 0.5
# Simulated time goes on at less than this part of the time that passes: it stands still.
_LEAST_RATE = 1e-3
_MOST_NAMES = 4


def examine_network(end: float) -> list[Finding]:
    """Let two processes talk, and judge what they report.

    Args:
        end: steady time by which it has to be over.
    """
    facts, error = _probe('survey', min(_PROBE_SECONDS, end - time.monotonic()), {})
    if 'rmw' not in facts:
        return [_not_loaded(error)]
    findings = [_loaded(facts)]
    heard = facts.get('heard_after_s')
    if heard is not None:
        text = f'two processes heard each other within {heard:.1f} s'
        findings.append(Finding('discovery', OK, text))
    else:
        findings.append(_not_heard(min(_AGAIN_SECONDS, end - time.monotonic())))
    if 'nodes' in facts:
        findings += [_publishers(facts), _simulated_time(facts), _other_clocks(facts)]
    return findings


def _probe(mode: str, seconds: float, variables: dict[str, str]) -> tuple[dict[str, Any], str]:
    """Run both sides; return what the listener reports, and what it writes to stderr."""
    topic = f'/_occ_doctor_{os.getpid()}_{time.monotonic_ns()}'
    command = [sys.executable, '-m', 'occ_constraints_pkg.doctor.probe']
    # Found also where this package is not installed but only on the path.
    path = os.pathsep.join([str(Path(__file__).parents[2]), os.environ.get('PYTHONPATH', '')])
    environment = {**os.environ, **variables, 'PYTHONPATH': path.rstrip(os.pathsep)}
    speaker = subprocess.Popen(
        [*command, 'speak', topic, str(seconds)],
        env=environment,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    listener = subprocess.Popen(
        [*command, mode, topic, str(min(_HEAR_SECONDS, seconds))],
        env=environment,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        errors='replace',
    )
    try:
        out, err = listener.communicate(timeout=max(0.1, seconds))
    except subprocess.TimeoutExpired:
        listener.kill()
        out, err = listener.communicate()
    finally:
        speaker.kill()
        speaker.wait()
    facts: dict[str, Any] = {}
    for line in out.splitlines(keepends=True):
        # The last one may be cut off, and libraries may print others.
        if line.startswith('{') and line.endswith('}\n'):
            facts |= json.loads(line)
    return facts, err


def _loaded(facts: dict[str, Any]) -> Finding:
    text = f'rclpy at {Path(facts["rclpy"]).parent} with {facts["rmw"]}'
    if facts['has_events_executor']:
        return Finding('rclpy', OK, text)
    advice = (
        'install rclpy 7.1.4 or later: sudo apt install --only-upgrade ros-jazzy-rclpy, or pip '
        "install -U 'occ_constraints_pkg[ros]'"
    )
    return Finding('rclpy', PROBLEM, f'{text} is too old for the nodes', advice)


def _not_loaded(error: str) -> Finding:
    lines = [line.strip() for line in error.splitlines() if line.strip()]
    # Of a traceback the last line says what it is about.
    reason = next(
        (line for line in reversed(lines) if 'rror' in line), (lines or ['no answer'])[-1]
    )
    python = f'{sys.version_info[0]}.{sys.version_info[1]}'
    advice = (
        f'use an rclpy for this Python ({python}): /opt/ros/jazzy is for 3.12; in a virtual '
        'environment do not source it'
        if 'module' in reason or 'import' in reason.lower()
        else 'see the other lines; a node fails in the same way'
    )
    return Finding('rclpy', PROBLEM, f'cannot be started: {printable(reason[:300])}', advice)


def _not_heard(seconds: float) -> Finding:
    """Look whether it is the network: within this machine it may work."""
    text = f'two processes on this machine did not hear each other within {_HEAR_SECONDS:g} s'
    if os.environ.get('ROS_AUTOMATIC_DISCOVERY_RANGE') != 'LOCALHOST' and seconds > 1.0:
        facts, _ = _probe('hear', seconds, {'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST'})
        if facts.get('heard_after_s') is not None:
            advice = (
                'with ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST they do: look for a firewall or an '
                'interface without multicast (ip link), or keep that setting for a single computer'
            )
            return Finding('discovery', PROBLEM, text, advice)
    advice = (
        'let UDP ports 7400 to 7700 and multicast pass on the interface lo (sudo ip link set lo '
        'multicast on); unset ROS_DISCOVERY_SERVER and profiles of the middleware for a try'
    )
    return Finding('discovery', PROBLEM, text, advice)


def _publishers(facts: dict[str, Any]) -> Finding:
    """Look for topics of ours that are not published by exactly one node, and for double names."""
    problems, advice = [], []
    for topic, found in sorted(facts['topics'].items()):
        end, publishers = topic.rpartition('/')[2], found['publishers']
        if end == 'cmd_vel':
            gates = [name for name in publishers if 'gate' in name.rpartition('/')[2]]
            if gates and len(publishers) > len(gates):
                others = _some([name for name in publishers if name not in gates])
                problems.append(f'{topic} is commanded past {gates[0]} by {others}')
                advice.append('remap their cmd_vel to cmd_vel_in')
            continue
        if publishers and found['types'] != [PUBLISHED_HERE[end]]:
            problems.append(f'{topic} is of type {", ".join(found["types"])}')
            advice.append(f'{end} of ours is {PUBLISHED_HERE[end]}; remap one of them')
        if len(publishers) > 1:
            problems.append(f'{topic} has {len(publishers)} publishers: {_some(publishers)}')
            advice.append(
                'end one of them, or give it a namespace (-r __ns:=/robot1)'
                + ('; a gate stops until then' if end == 'violation' else '')
            )
    twice = [name for name, count in Counter(facts['nodes']).items() if count > 1]
    if twice:
        problems.append(f'several nodes are called {_some(twice)}')
        advice.append('rename one with -r __node:=NAME')
    if problems:
        return Finding('publishers', PROBLEM, '; '.join(problems), '; '.join(dict.fromkeys(advice)))
    monitors = sum(
        bool(found['publishers']) and topic.rpartition('/')[2] == 'violation'
        for topic, found in facts['topics'].items()
    )
    text = f'{count_of(len(facts["nodes"]), "node")} in this domain, '
    text += f'{count_of(monitors, "topic")} of verdicts'
    return Finding('publishers', OK, text + (', one publisher each' if monitors else ''))


def _simulated_time(facts: dict[str, Any]) -> Finding:
    name, publishers = 'simulated time', facts['clock_publishers']
    simulated = [node for node, value in facts['use_sim_time'].items() if value]
    others = [node for node, value in facts['use_sim_time'].items() if not value]
    if len(publishers) > 1:
        text = f'/clock has {len(publishers)} publishers: {_some(publishers)}'
        return Finding(name, PROBLEM, text, 'end all but one: time jumps between them')
    if not publishers:
        if simulated:
            text = f'{_some(simulated)} have use_sim_time, and nobody publishes /clock'
            advice = 'start what publishes it (occ play --clock 100), or them without use_sim_time'
            return Finding(name, PROBLEM, text, advice)
        return Finding(name, OK, 'nobody publishes /clock; all live in the time of the system')
    if not facts['clock_messages']:
        text = f'{publishers[0]} offers /clock, but nothing comes'
        return Finding(name, NOTE, text, 'let it go on, if it is paused')
    if facts['clock_advanced_s'] <= _LEAST_RATE * facts['clock_took_s']:
        text = f'/clock of {publishers[0]} stands still'
        return Finding(name, NOTE, text, 'let the simulation or the player go on')
    rate = facts['clock_advanced_s'] / facts['clock_took_s']
    text = f'/clock of {publishers[0]} goes on at {rate:.2g} times the time of the system'
    if others:
        advice = f'start with -p use_sim_time:=true: {_some(others)}'
        return Finding(name, NOTE, f'{text}; {count_of(len(others), "node")} ignore it', advice)
    return Finding(name, OK, text)


def _other_clocks(facts: dict[str, Any]) -> Finding:
    name = 'clocks'
    wrong = {
        topic: behind
        for topic, behind in facts['behind_s'].items()
        if not -_MOST_AHEAD <= behind <= _MOST_BEHIND
    }
    if wrong:
        told = [
            f'the clock behind {topic} is {abs(behind):.2f} s {"ahead" if behind < 0 else "behind"}'
            for topic, behind in list(wrong.items())[:_MOST_NAMES]
        ]
        advice = 'synchronize the clocks of both computers (chrony, NTP); a gate stops until then'
        return Finding(name, PROBLEM, '; '.join(told), advice)
    heard = len(facts['behind_s'])
    text = f'{count_of(heard, "topic")} of verdicts in step with this clock'
    return Finding(name, OK, text if heard else 'no verdict came whose time could be compared')


def _some(names: list[str]) -> str:
    more = f' and {len(names) - _MOST_NAMES} more' if len(names) > _MOST_NAMES else ''
    return printable(', '.join(names[:_MOST_NAMES])) + more
