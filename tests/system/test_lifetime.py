# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Nodes start, wait, and end cleanly however they are asked to."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from occ_constraints_pkg.demo.processes import environment
from occ_constraints_pkg.nodes import NODES

import occ_constraints_pkg

ENDINGS = [signal.SIGINT, signal.SIGTERM]


@pytest.mark.parametrize('number', ENDINGS)
def test_all_nodes_end_cleanly_while_they_wait_for_peers(
    nodes, observer, rules_of, small_bag, number
):
    rules = nodes.folder / 'rules.yaml'
    rules_of['simple_nav'].save(rules)
    parameters = {
        'sim': {'world': 'simple_nav', 'wait_for_subscribers': 99},
        'policy': {'policy': 'expert'},
        'recorder': {'output': nodes.folder / 'bag', 'topics': ['observation']},
        'player': {'bag': small_bag, 'wait_for_subscribers': 99},
        'tree_learner': {'feature_map': 'simple_nav'},
        'monitor': {'constraints_file': rules},
        'gate': {},
        'constrained_learner': {'output': nodes.folder / 'training'},
        'event_recorder': {'store': nodes.folder / 'events'},
        'dashboard': {'port': 0},
    }
    assert set(parameters) == set(NODES)
    for name, values in parameters.items():
        nodes.start(name, **values)

    def all_there():
        assert all(process.is_running for process in nodes.started)
        return set(observer.node.get_node_names()) >= set(NODES)

    observer.spin_until(all_there)
    nodes.stop(number=number)
    assert (nodes.folder / 'bag' / 'metadata.yaml').is_file()


SCRIPTS = Path(occ_constraints_pkg.__file__).parents[1] / 'scripts'


@pytest.mark.skipif(not Path('/proc/self/status').exists(), reason='needs /proc')
@pytest.mark.parametrize('number', ENDINGS)
@pytest.mark.parametrize('program', [['-m', 'occ_constraints_pkg', 'node', 'monitor'], ['script']])
def test_a_node_ends_at_once_and_in_silence_while_it_is_still_being_imported(program, number):
    arguments = program if program != ['script'] else [str(SCRIPTS / 'monitor')]
    process = subprocess.Popen(
        [sys.executable, *arguments],
        env=environment(1),
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    caught = 1 << (signal.SIGTERM - 1)
    folder = Path(f'/proc/{process.pid}')

    def mask():
        return int((folder / 'status').read_text().partition('SigCgt:')[2].split()[0], 16)

    try:
        while process.poll() is None and not mask() & caught:
            time.sleep(0.001)
        process.send_signal(signal.SIGSTOP)
        loaded = (folder / 'maps').read_text()
        process.send_signal(number)
        process.send_signal(signal.SIGCONT)
        output, _ = process.communicate(timeout=10.0)
    finally:
        process.kill()
    assert (process.returncode, output) == (0, '')
    # It listens before it loads what takes long.
    assert 'numpy' not in loaded
    assert 'rclpy' not in loaded


def test_ctrl_c_in_a_terminal_ends_a_whole_group(nodes, observer):
    command = [sys.executable, '-m', 'occ_constraints_pkg', 'node']
    code = f"""
import subprocess, sys
nodes = [subprocess.Popen({command!r} + line) for line in (
    ['sim', '-p', 'world:=simple_nav', '-p', 'wait_for_subscribers:=99'],
    ['policy'],
)]
try:
    for node in nodes:
        node.wait()
except KeyboardInterrupt:
    sys.exit(sum(node.wait() for node in nodes))
"""
    parent = subprocess.Popen(
        [sys.executable, '-c', code],
        env=environment(nodes.domain),
        start_new_session=True,
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        names = {'sim', 'policy'}
        observer.spin_until(lambda: set(observer.node.get_node_names()) >= names)
        os.killpg(parent.pid, signal.SIGINT)
        _, errors = parent.communicate(timeout=15.0)
        assert parent.returncode == 0
        assert 'Traceback' not in errors
    finally:
        if parent.poll() is None:
            os.killpg(parent.pid, signal.SIGKILL)


def test_nodes_end_when_the_program_that_started_them_is_killed(nodes, observer, tmp_path):
    code = f"""
import time
from pathlib import Path
from occ_constraints_pkg.demo.processes import nodes_running
with nodes_running({{'policy': {{}}}}, Path({str(tmp_path)!r}), {nodes.domain}) as running:
    print(running['policy'].pid, flush=True)
    time.sleep(60.0)
"""
    parent = subprocess.Popen([sys.executable, '-c', code], stdout=subprocess.PIPE, text=True)
    pid = int(parent.stdout.readline())
    try:
        observer.spin_until(lambda: 'policy' in observer.node.get_node_names())
        parent.kill()
        parent.wait()
        # Where its farewell gets lost, others forget it after 20 s.
        observer.spin_until(lambda: 'policy' not in observer.node.get_node_names())
    finally:
        parent.kill()
        if Path(f'/proc/{pid}').exists():
            os.kill(pid, signal.SIGKILL)
    assert 'Traceback' not in (tmp_path / 'policy.log').read_text()


@pytest.mark.skipif(not Path('/proc/self/task').exists(), reason='needs /proc')
def test_an_observer_leaves_no_threads_behind(nodes):
    from occ_constraints_pkg.demo.observer import Observer

    def threads():
        return len(os.listdir('/proc/self/task'))

    # The first one may load what stays for good.
    with Observer(nodes.domain):
        pass
    before = threads()
    with Observer(nodes.domain) as observer:
        observer.spin(0.1)
        assert threads() > before
    assert threads() == before
