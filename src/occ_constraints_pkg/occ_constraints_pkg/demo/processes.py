# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Nodes as processes of their own, for the demo, the benchmarks and the tests."""

from __future__ import annotations

import errno
import json
import os
import random
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from occ_constraints_pkg.errors import ConfigurationError
from occ_constraints_pkg.stopping import PARENT_VARIABLE

_STOP_SECONDS = 15.0
# Domains above 101 use ports that Linux also hands out by itself.
_DOMAINS = range(1, 102)
_LOOK_SECONDS = 0.05


class NodeProcess:
    """A running node; its output goes to a file.

    Attributes:
        name: the node's name.
        log: the file that takes its output.
        was_killed: whether it was sent SIGKILL, here or for being stuck.

    Args:
        name: of the node.
        parameters: its parameters; a path is given as text.
        directory: where its output goes.
        domain: ROS domain id.
        namespace: of the node and its topics.
        module: what Python runs with the node's arguments; by default the node of that name.
    """

    def __init__(
        self,
        name: str,
        parameters: Mapping[str, Any],
        directory: Path,
        domain: int,
        *,
        namespace: str = '/',
        module: str | None = None,
    ) -> None:
        arguments = ['-r', f'__ns:={namespace}']
        for key, value in parameters.items():
            arguments += ['-p', f'{key}:={_yaml(value)}']
        self.name = name
        self.was_killed = False
        directory.mkdir(parents=True, exist_ok=True)
        self.log = directory / f'{name}.log'
        program = ['occ_constraints_pkg', 'node', name] if module is None else [module]
        with self.log.open('ab') as output:
            self._process = subprocess.Popen(
                [sys.executable, '-m', *program, *arguments],
                stdout=output,
                stderr=subprocess.STDOUT,
                stdin=subprocess.DEVNULL,
                env={**environment(domain), PARENT_VARIABLE: str(os.getpid())},
                start_new_session=True,
            )

    @property
    def is_running(self) -> bool:
        """Whether the process has not ended."""
        return self._process.poll() is None

    @property
    def exit_code(self) -> int | None:
        """The exit code, ``None`` while it runs."""
        return self._process.poll()

    @property
    def pid(self) -> int:
        """The process id."""
        return self._process.pid

    def send_signal(self, number: signal.Signals) -> None:
        """Send a signal to the process."""
        if self.is_running:
            self.was_killed |= number == signal.SIGKILL
            self._process.send_signal(number)

    def wait(self, seconds: float, *others: NodeProcess) -> None:
        """Wait for the end.

        Args:
            seconds: how long.
            *others: nodes that it needs, which may end before it but not with an error.

        Raises:
            OccError: it has not ended in time, or one of them has ended with an error; then the
                end of that one's output is in the sentence.
        """
        end = time.monotonic() + seconds
        while self.is_running and time.monotonic() < end:
            for other in others:
                other.raise_error()
            time.sleep(_LOOK_SECONDS)
        if self.is_running:
            raise ConfigurationError(
                f'node {self.name} did not end within {seconds:g} s; its output is in {self.log}'
            )
        self.raise_error()

    def raise_error(self) -> None:
        """Do nothing unless the node has ended with an error.

        Raises:
            OccError: it has; the end of its output is in the sentence.
        """
        if self.exit_code:
            raise ConfigurationError(
                f'node {self.name} ended with code {self.exit_code}: {self.last_words()}'
            )

    def stop(self) -> int:
        """Ask the node to end, as Ctrl-C does, and return its exit code; kill it if it is stuck."""
        self.send_signal(signal.SIGINT)
        return self.join()

    def join(self) -> int:
        """Return the exit code of a node that was asked to end; kill it if it is stuck."""
        try:
            return self._process.wait(_STOP_SECONDS)
        except subprocess.TimeoutExpired:
            self.send_signal(signal.SIGKILL)
            return self._process.wait()

    def last_words(self) -> str:
        """Return the sentence the node ended with, or else the last line of its output."""
        lines = self.log.read_text(encoding='utf-8', errors='replace').strip().splitlines()
        errors = [line for line in lines if line.startswith('error: ')]
        return (errors or lines or ['(no output)'])[-1]


@contextmanager
def nodes_running(
    nodes: Mapping[str, Mapping[str, Any]], directory: Path, domain: int
) -> Iterator[dict[str, NodeProcess]]:
    """Start nodes with their parameters, and end them all when the block is left.

    Args:
        nodes: node name to parameters, started in this order.
        directory: where their output goes.
        domain: ROS domain id.

    Raises:
        OccError: when the block ends by itself and a node has ended with an error.
    """
    running: dict[str, NodeProcess] = {}
    try:
        for name, parameters in nodes.items():
            running[name] = NodeProcess(name, parameters, directory, domain)
        yield running
    finally:
        for process in running.values():
            process.send_signal(signal.SIGINT)
        for process in running.values():
            process.join()
    for process in running.values():
        process.raise_error()


def environment(domain: int) -> dict[str, str]:
    """Return this process's environment with a ROS domain of its own, on this machine only."""
    return {
        **os.environ,
        'ROS_DOMAIN_ID': str(domain),
        'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST',
        'PYTHONUNBUFFERED': '1',
        # Small matrices: threads of the linear algebra would only wait for one another.
        'OPENBLAS_NUM_THREADS': '1',
    }


@contextmanager
def private_domain() -> Iterator[int]:
    """Yield a ROS domain that nobody else on this machine gets from here until the block is left.

    Raises:
        OccError: all are taken.
    """
    # A socket's abstract name is the kernel's own: it is gone with the process, however that ends,
    # and reaches as far as the domains do (all users, one network namespace).
    with socket.socket(socket.AF_UNIX) as claim:
        # In any order, so that what a node of an earlier domain left behind meets nobody soon.
        for domain in random.SystemRandom().sample(_DOMAINS, len(_DOMAINS)):
            try:
                claim.bind(f'\0occ_constraints ROS domain {domain}')
            except OSError as error:
                if error.errno != errno.EADDRINUSE:
                    raise
                continue
            yield domain
            return
    raise ConfigurationError(
        f'all {len(_DOMAINS)} ROS domains from {_DOMAINS[0]} to {_DOMAINS[-1]} are in use by '
        'demos, benchmarks and tests on this machine; wait for one of them to end'
    )


def _yaml(value: Any) -> str:
    # JSON is YAML, and keeps 1.0 apart from 1.
    return json.dumps(str(value) if isinstance(value, Path) else value, default=str)
