# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The page with robots that only the model knows, served as the node does, without ROS."""

import threading
import time

import numpy as np
from fleets import RULE_SET
from occ_constraints_pkg.fleet.model import Fleet, GateReport, Report, ViolatedRule
from occ_constraints_pkg.rules import Verdict
from occ_constraints_pkg.rules.listing import rules_in_force_text


def report_of(margin, *, reason='', rule='FAST', words='speed above 1 m/s'):
    """Return a verdict: UNKNOWN for a reason, else by its margin."""
    judged = {'rule_set': RULE_SET.fingerprint, 'judged_at_ns': time.time_ns()}
    judged['stamp_ns'] = judged['judged_at_ns'] - 20_000_000
    if reason:
        return Report(Verdict.UNKNOWN, reason=reason, **judged)
    if margin > 0.0:
        return Report(Verdict.SAFE, margin, **judged)
    violated = ViolatedRule(rule, words, margin, f'speed {1.0 - margin:.3g}')
    return Report(Verdict.VIOLATED, margin, rules=(violated,), **judged)


class Site:
    """Serves the page of a fleet, of which each robot that has a margin or a reason is heard.

    Attributes:
        heard: by name, the margin of a robot, or the reason why it is UNKNOWN; who is not in it is
            silent.
        wishes: that the page has asked for.
    """

    def __init__(self, port=0, *, token='', seconds=0.05, hosts=()):
        from occ_constraints_pkg.dashboard.access import access_of
        from occ_constraints_pkg.dashboard.documents import Documents
        from occ_constraints_pkg.dashboard.server import PageServer

        self.fleet, self.heard, self.wishes = Fleet(), {}, []
        self.lock, self._gates = threading.Lock(), {}
        self._documents = Documents(self.fleet, allows_control=bool(token))
        self.server = PageServer(
            access_of('127.0.0.1', hosts, token), lambda wish: self.wishes.append(wish) or True
        )
        self.server.start('127.0.0.1', port)
        self._seconds, self._arrivals, self._is_over = seconds, 0, threading.Event()
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    @property
    def address(self):
        return f'http://127.0.0.1:{self.server.port}/'

    def robot(self, name):
        """Return a robot that has told its rules."""
        with self.lock:
            robot = self.fleet.robot(f'{name}/violation', time.monotonic())
            robot.monitor, robot.publishers = f'{name}/monitor', 1
            robot.hear_rules(rules_in_force_text(RULE_SET), time.monotonic())
        return robot

    def gate(self, name, state='PASS', reason=''):
        """Let a gate say from now on what it does."""
        topics = (f'{name}/violation',)
        with self.lock:
            self._gates[f'{name}/gate'] = GateReport(state, 1.0, reason, time.time_ns(), topics)

    def _run(self):
        while not self._is_over.wait(self._seconds):
            with self.lock:
                messages = self._tick(time.monotonic())
            if self.server.streams:
                self.server.publish(messages)

    def _tick(self, now):
        for name, said in self.heard.items():
            robot = self.fleet.robots[f'{name}/violation']
            is_reason = isinstance(said, str)
            robot.hear(report_of(0.0, reason=said) if is_reason else report_of(said), now)
            if not is_reason:
                robot.hear_features(np.array([[1.0 - said, 2.0]]), RULE_SET.fingerprint, now)
        for name, report in self._gates.items():
            self.fleet.hear_gate(name, report, now)
        self.fleet.tick(now)
        self.fleet.fresh_changes()
        arrivals = self.server.arrivals
        anew, self._arrivals = arrivals != self._arrivals, arrivals
        return self._documents.messages(now, anew=anew)

    def close(self):
        self._is_over.set()
        self._thread.join()
        self.server.close()
