# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""A private ROS domain is nobody else's while it is used."""

import os
import subprocess
import sys
from contextlib import ExitStack

import pytest
from occ_constraints_pkg.demo import processes
from occ_constraints_pkg.errors import OccError


@pytest.fixture
def domains(monkeypatch):
    """Return three domains that are there for this test only."""
    domains = range(1000 * os.getpid(), 1000 * os.getpid() + 3)
    monkeypatch.setattr(processes, '_DOMAINS', domains)
    return domains


def test_domains_in_use_are_not_given_again(domains):
    with ExitStack() as stack:
        given = {stack.enter_context(processes.private_domain()) for _ in domains}
        assert given == set(domains)
        with (
            pytest.raises(OccError, match='all 3 ROS domains .* are in use'),
            processes.private_domain(),
        ):
            pass
    with processes.private_domain() as domain:
        assert domain in domains


HOLD = """
import sys
from occ_constraints_pkg.demo import processes
processes._DOMAINS = range(int(sys.argv[1]), int(sys.argv[2]))
with processes.private_domain() as domain:
    print(domain, flush=True)
    sys.stdin.read()
"""


def test_a_domain_of_another_process_is_free_when_that_is_killed(domains):
    first = domains[0]
    holder = subprocess.Popen(
        [sys.executable, '-c', HOLD, str(first), str(first + 1)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    assert int(holder.stdout.readline()) == first
    with ExitStack() as stack:
        given = {stack.enter_context(processes.private_domain()) for _ in domains[1:]}
        assert given == set(domains[1:])
        holder.kill()
        holder.communicate()
        assert stack.enter_context(processes.private_domain()) == first
