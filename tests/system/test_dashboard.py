# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The node ``dashboard`` beside real monitors and gates."""

import json
import re
import signal
import socket
import subprocess
import sys
import threading
import time
from http.client import HTTPConnection

import pytest
from occ_constraints_pkg.demo.processes import environment

SAFE, BROKEN = (0.8, 0.5), (0.8, 0.96)
TOKEN = 'a-token-of-this-test'
_PATIENCE = 60.0


@pytest.fixture(autouse=True)
def _server():
    pytest.importorskip('uvicorn', reason="needs the extra 'dashboard'")


class Page(threading.Thread):
    """Reads the stream of a running node, as a page does."""

    def __init__(self, node):
        super().__init__(daemon=True)
        self.node, self.told, self.port = node, {}, 0

    @property
    def is_open(self):
        """Whether the node's page could be reached; opens it when it is there."""
        if self.port:
            return True
        found = re.search(r'http://127.0.0.1:(\d+)/ ', self.node.log.read_text())
        if found:
            self.port = int(found[1])
            self.start()
        return bool(found)

    def run(self):
        connection = HTTPConnection('127.0.0.1', self.port, timeout=_PATIENCE)
        connection.request('GET', '/stream')
        kind = ''
        for line in connection.getresponse():
            key, _, value = line.decode().rstrip().partition(': ')
            if key == 'event':
                kind = value
            elif key == 'data':
                self.told[kind] = json.loads(value)

    def robot(self, name):
        """Return what was told last of a robot; empty while nothing was."""
        robots = self.told.get('now', {}).get('robots', ())
        return next((robot for robot in robots if robot['name'] == name), {})

    def is_shown(self, name, standing):
        return self.is_open and self.robot(name).get('standing') == standing

    def has_change(self, words, *kinds):
        changes = self.told.get('log', {}).get('changes', ())
        return any(item[2] in kinds and words in item[3] for item in changes)

    def post(self, token=TOKEN, **wish):
        connection = HTTPConnection('127.0.0.1', self.port, timeout=_PATIENCE)
        headers = {'Authorization': f'Bearer {token}', 'Content-Type': 'application/json'}
        connection.request('POST', '/control', json.dumps(wish), headers)
        answer = connection.getresponse()
        answer.read()
        connection.close()
        return answer.status


def test_robots_gates_and_events_are_told_as_they_come_and_go(nodes, observer, robots, rules):
    from occ_constraints_pkg.ros.qos import VERDICTS
    from std_msgs.msg import String

    first = nodes.start('monitor', namespace='/a', constraints_file=rules)
    nodes.start('gate', namespace='/a')
    page = Page(nodes.start('dashboard', port=0))
    robots(lambda: page.is_shown('/a', 'SAFE') and page.robot('/a')['rules'], a=SAFE)
    robots(lambda: page.robot('/a')['gates'][0]['state'] == 'PASS', a=SAFE)
    robots(lambda: page.robot('/a')['rules'][0][2] != '', a=SAFE)
    begin = time.monotonic()
    robots(lambda: page.is_shown('/a', 'VIOLATED'), a=BROKEN)
    assert time.monotonic() - begin < 1.0
    assert page.robot('/a')['why'] == 'R0: y above 0.95'
    robots(lambda: page.robot('/a')['gates'][0]['state'] == 'STOP', a=BROKEN)
    health = page.robot('/a')['health']
    assert health['monitor'] == '/a/monitor'
    assert (health['publishers'], health['subscribers']) == (1, 1)
    assert health['rate'] > 5.0
    # Silence is told by the monitor at first, then nobody is left to tell.
    observer.spin_until(lambda: page.is_shown('/a', 'UNKNOWN'))
    first.send_signal(signal.SIGKILL)
    observer.spin_until(lambda: page.is_shown('/a', 'LOST'))
    recorder = observer.node.create_publisher(String, '/a/events', VERDICTS)
    event = {'id': 'e' * 24, 'kind': 'violation', 'phase': 'began', 'text': 'y above 0.95'}

    def is_told():
        recorder.publish(String(data='not about an event'))
        recorder.publish(String(data=json.dumps(event)))
        observer.spin(0.1)
        return [item['text'] for item in page.told['log']['events']] == ['y above 0.95']

    observer.spin_until(is_told)


def test_what_is_asked_for_with_the_token_is_done(nodes, robots, rules, tmp_path):
    token = tmp_path / 'token'
    token.write_text(f'{TOKEN}\n')
    nodes.start('monitor', namespace='/a', constraints_file=rules)
    page = Page(nodes.start('dashboard', port=0, allow_control=True, token_file=token))
    robots(lambda: page.is_shown('/a', 'SAFE') and page.robot('/a')['rules'], a=SAFE)
    topic = '/a/violation'
    assert page.post('wrong', action='disable', robot=topic) == 401
    assert page.post(action='disable', robot='/b/violation') == 202
    robots(lambda: page.has_change('no monitor is known', 'failed'), a=SAFE)
    assert page.post(action='disable_rule', robot=topic, rule='R9') == 202
    robots(lambda: page.has_change("there is no rule 'R9'", 'failed'), a=SAFE)
    assert page.is_shown('/a', 'SAFE')
    assert page.post(action='disable_rule', robot=topic, rule='R0') == 202
    robots(lambda: page.has_change('disable rule R0: ', 'done'), a=SAFE)
    robots(lambda: page.has_change('1 rule of 2 in force', 'rules'), a=SAFE)
    assert page.post(action='enable_rule', robot=topic, rule='R0') == 202
    robots(lambda: page.has_change('enable rule R0', 'done'), a=SAFE)
    for action, words in [
        ('reset_stats', 'all counters are 0'),
        ('prune', 'prune rules'),
        ('disable', 'disable the monitor: disabled'),
    ]:
        assert page.post(action=action, robot=topic) == 202
        robots(lambda words=words: page.has_change(words, 'done', 'failed'), a=SAFE)
    robots(lambda: page.is_shown('/a', 'UNKNOWN'), a=SAFE)
    assert page.post(action='enable', robot=topic) == 202
    robots(lambda: page.is_shown('/a', 'SAFE'), a=SAFE)
    assert TOKEN not in page.node.log.read_text()


def test_nothing_can_be_asked_for_by_default(nodes, observer):
    page = Page(nodes.start('dashboard', port=0))
    observer.spin_until(lambda: page.is_open)
    assert page.post(action='prune', robot='/a/violation') == 403
    log = page.node.log.read_text()
    assert '(read-only)' in log
    assert '#token=' not in log


def test_it_listens_to_this_computer_only(nodes, observer):
    page = Page(nodes.start('dashboard', port=0))
    observer.spin_until(lambda: page.is_open)
    # As /proc shows it: the address in hexadecimal, and the port; 0A is LISTEN.
    with open('/proc/net/tcp', encoding='ascii') as table:
        lines = [line.split() for line in table]
    listening = [line[1] for line in lines if line[3] == '0A']
    assert f'0100007F:{page.port:04X}' in listening
    assert f'00000000:{page.port:04X}' not in listening


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_it_ends_at_once_though_a_page_is_open(nodes, observer, number):
    page = Page(nodes.start('dashboard', port=0))
    observer.spin_until(lambda: page.is_open and 'now' in page.told)
    begin = time.monotonic()
    nodes.stop(page.node, number=number)
    assert time.monotonic() - begin < 5.0


def test_mistakes_are_one_sentence(nodes, tmp_path):
    short = tmp_path / 'short'
    short.write_text('secret')
    with socket.create_server(('127.0.0.1', 0)) as taken:
        port = taken.getsockname()[1]
        expected = {
            (f'port:={port}',): f'cannot listen to 127.0.0.1 port {port}: ',
            ('host:=no.such.host.invalid',): 'cannot listen to no.such.host.invalid port 8417: ',
            ('hosts:=http_//x',): "hosts: got 'http_//x'; allowed is a name",
            (f'token_file:={short}',): 'token_file is given but nothing may be changed',
            ('allow_control:=true', f'token_file:={short}'): 'got a token of 6 signs',
            ('allow_control:=true', f'token_file:={tmp_path}/none'): f'{tmp_path}/none',
        }
        # All at once, for most of their time goes into imports.
        started = [
            subprocess.Popen(
                [
                    *(sys.executable, '-m', 'occ_constraints_pkg', 'node', 'dashboard'),
                    *(part for item in arguments for part in ('-p', item)),
                ],
                env=environment(nodes.domain),
                stderr=subprocess.PIPE,
                text=True,
            )
            for arguments in expected
        ]
        for process, words in zip(started, expected.values(), strict=True):
            _, text = process.communicate(timeout=_PATIENCE)
            assert process.returncode == 2, text
            (line,) = [line for line in text.splitlines() if 'error: ' in line]
            assert words in line
            assert 'Traceback' not in text
