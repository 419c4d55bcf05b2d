# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Reads constraints in a process of its own, so that whoever judges meanwhile is not held up.

A thread would not do: what parses is Python, and would share the interpreter with the judging.
``python -m occ_constraints_pkg.nodes.monitor.rules_reader`` is that process.
"""

from __future__ import annotations

import signal
import sys

if __name__ == '__main__':
    # Before anything that takes time: whoever stops all processes of a program means the one that
    # this one works for, with which it ends.
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)

import os
import pickle
import resource
import struct
import subprocess
import threading
import time
from typing import BinaryIO, NamedTuple

import numpy as np

from occ_constraints_pkg.errors import ConfigurationError, OccError
from occ_constraints_pkg.features.feature_map import FeatureMap, map_of
from occ_constraints_pkg.rules import RuleSet
from occ_constraints_pkg.rules.constraints_file import Constraints, parse_constraints
from occ_constraints_pkg.rules.listing import rules_in_force_text

MOST_CHARACTERS = 1_000_000
"""Longest text that is read: ten thousand rules."""

# What reading may take. A newer text does not wait so long for an older one.
_MOST_SECONDS = 60.0
_MOST_SECONDS_IF_OLD = 2.0
_MOST_MEMORY = 2 << 30
_SIZE = struct.Struct('<Q')


class ReadRules(NamedTuple):
    """What became of a text.

    Attributes:
        text: what was offered.
        constraints: what is in it; None if it is refused.
        feature_map: that of the constraints; None if it is refused.
        problem: why it is refused; else empty.
    """

    text: str
    constraints: Constraints | None
    feature_map: FeatureMap | None
    problem: str


class RulesReader:
    """Reads the newest text that was offered; what came of older ones is dropped.

    The process starts with the first text and ends with :meth:`close`, or when this one ends.

    Args:
        where: what errors call the text.
    """

    def __init__(self, where: str) -> None:
        self._where = where
        self._change = threading.Condition()
        self._newest: str | None = None
        self._answer: ReadRules | None = None
        self._process: subprocess.Popen[bytes] | None = None
        # What the process reads, and since when on the steady clock.
        self._under_way: tuple[str, float] | None = None
        self._thread: threading.Thread | None = None
        self._is_closed = False

    @property
    def is_busy(self) -> bool:
        """Whether something was offered of which :meth:`poll` has not returned the answer."""
        return self._newest is not None

    def offer(self, text: str) -> None:
        """Read this text next."""
        with self._change:
            self._newest, self._answer = text, None
            if self._thread is None:
                self._thread = threading.Thread(target=self._work, daemon=True)
                self._thread.start()
            self._change.notify()

    def clear(self) -> None:
        """Drop what was offered."""
        with self._change:
            self._newest = self._answer = None

    def poll(self) -> ReadRules | None:
        """Return what became of the newest text, once; None as long as that is not known.

        Call it now and then: it also ends a reading that takes too long.
        """
        with self._change:
            answer, self._answer = self._answer, None
            if answer is not None:
                self._newest = None
            elif self._under_way is not None:
                text, since = self._under_way
                limit = _MOST_SECONDS if text == self._newest else _MOST_SECONDS_IF_OLD
                if time.monotonic() - since > limit:
                    self._kill()
            return answer

    def close(self) -> None:
        """End the process."""
        with self._change:
            self._is_closed = True
            self._kill()
            self._change.notify()
        if self._thread is not None:
            self._thread.join()

    def _work(self) -> None:
        while True:
            with self._change:
                self._change.wait_for(
                    lambda: self._is_closed or (self._newest is not None and not self._answer)
                )
                if self._is_closed:
                    break
                text = self._newest
                self._under_way = text, time.monotonic()
            answer = self._ask(text)
            with self._change:
                self._under_way = None
                if text == self._newest:
                    self._answer = answer
        self._end()

    def _ask(self, text: str) -> ReadRules:
        try:
            if self._process is None:
                self._process = _start()
            _send(self._process.stdin, pickle.dumps((text, self._where)))
            # From a process of our own, which builds these values out of plain numbers and texts.
            answer = ReadRules(text, *pickle.loads(_receive(self._process.stdout)))
            if answer.constraints is not None:
                # So that whoever judges by them does not wait for their first use.
                _use_once(answer.constraints.rule_set)
            return answer
        except (OSError, EOFError, MemoryError, pickle.UnpicklingError):
            # It was killed, has no memory left, or could not be started.
            self._end()
            return ReadRules(
                text,
                None,
                None,
                f'{self._where} could not be read within {_MOST_SECONDS:g} s and '
                f'{_MOST_MEMORY >> 30} GiB of memory',
            )

    def _kill(self) -> None:
        process = self._process
        if process is not None:
            process.kill()

    def _end(self) -> None:
        process, self._process = self._process, None
        if process is None:
            return
        process.kill()
        for stream in (process.stdin, process.stdout):
            try:
                stream.close()
            except OSError:
                # What was not written yet has no reader any more.
                continue
        process.wait()


def check_size(text: str, where: str) -> None:
    """Refuse a text that is too long to be read.

    Raises:
        OccError: it is.
    """
    if len(text) > MOST_CHARACTERS:
        raise ConfigurationError(
            f'{where} is a text of {len(text)} characters; allowed are {MOST_CHARACTERS} at most'
        )


def _start() -> subprocess.Popen[bytes]:
    return subprocess.Popen(
        [sys.executable, '-m', 'occ_constraints_pkg.nodes.monitor.rules_reader'],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        # Threads of the linear algebra would only take memory.
        env={**os.environ, 'OPENBLAS_NUM_THREADS': '1'},
        # Ctrl-C is meant for the calling process.
        process_group=0,
    )


def _send(stream: BinaryIO, data: bytes) -> None:
    stream.write(_SIZE.pack(len(data)) + data)
    stream.flush()


def _receive(stream: BinaryIO) -> bytes:
    head = stream.read(_SIZE.size)
    if len(head) < _SIZE.size:
        raise EOFError
    (size,) = _SIZE.unpack(head)
    data = stream.read(size)
    if len(data) < size:
        raise EOFError
    return data


def _read(text: str, where: str) -> tuple[Constraints | None, FeatureMap | None, str]:
    try:
        constraints = parse_constraints(text, where)
        feature_map = map_of(constraints, where)
        # What else is asked of rules is tried here, where a failure harms nobody.
        rules_in_force_text(constraints.rule_set)
        _use_once(constraints.rule_set)
        return constraints, feature_map, ''
    except OccError as error:
        return None, None, str(error)
    # Whatever a text brings about is its own fault.
    except Exception as error:
        words = ' '.join(str(error).split())
        return None, None, f'{where} cannot be read: {type(error).__name__} {words}'


def _use_once(rule_set: RuleSet) -> None:
    rule_set.judge(np.zeros((1, len(rule_set.space))))


def main() -> None:
    """Answer texts from stdin on stdout until there are no more."""
    resource.setrlimit(resource.RLIMIT_AS, (_MOST_MEMORY, _MOST_MEMORY))
    answers = sys.stdout.buffer
    while True:
        try:
            text, where = pickle.loads(_receive(sys.stdin.buffer))
            _send(answers, pickle.dumps(_read(text, where)))
        except (EOFError, BrokenPipeError):
            return


if __name__ == '__main__':
    main()
