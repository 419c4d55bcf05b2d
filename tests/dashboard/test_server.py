# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""What the page's server refuses, and what it bears."""

import contextlib
import json
import os
import socket
import threading
import time
from http.client import HTTPConnection

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from occ_constraints_pkg.errors import OccError

TOKEN = 'a-token-of-this-test'
WISH = {'action': 'prune', 'robot': '/a/violation'}
_PATIENCE = 20.0


def connect(site):
    return contextlib.closing(HTTPConnection('127.0.0.1', site.server.port, timeout=_PATIENCE))


def ask(site, path='/', method='GET', body=None, **headers):
    """Return status, headers and body of an answer; headers are named as in Python."""
    with connect(site) as connection:
        named = {key.replace('_', '-'): value for key, value in headers.items()}
        connection.request(method, path, body, named)
        answer = connection.getresponse()
        return answer.status, answer.headers, answer.read()


def control(site, wish=WISH, **headers):
    body = wish if isinstance(wish, bytes) else json.dumps(wish).encode()
    given_headers = {
        'Authorization': f'Bearer {TOKEN}',
        'Content_Type': 'application/json',
        **headers,
    }
    status, _, said = ask(site, '/control', 'POST', body, **given_headers)
    return status, json.loads(said).get('error', '')


def open_socket(site):
    return socket.create_connection(('127.0.0.1', site.server.port), timeout=_PATIENCE)


def stream(site):
    """Return a connection on which the stream has begun."""
    opened = open_socket(site)
    opened.sendall(b'GET /stream HTTP/1.1\r\nHost: localhost\r\n\r\n')
    assert b'200' in opened.recv(4096).partition(b'\r\n')[0]
    return opened


def wait_until(condition):
    end = time.monotonic() + _PATIENCE
    while not condition():
        assert time.monotonic() < end, 'nothing came of waiting'
        time.sleep(0.02)


def memory_mb():
    with open('/proc/self/statm', encoding='ascii') as file:
        return int(file.read().split()[1]) * os.sysconf('SC_PAGE_SIZE') / 1e6


def test_files_are_served_with_a_policy_that_allows_nothing_else(site):
    for path, kind in [
        ('/', 'text/html'),
        ('/style.css', 'text/css'),
        ('/charts.js', 'text/javascript'),
        ('/dashboard.js', 'text/javascript'),
    ]:
        status, headers, body = ask(site, path)
        assert (status, headers['Content-Type'].partition(';')[0]) == (200, kind)
        assert len(body) > 1000
        policy = headers['Content-Security-Policy']
        assert policy.startswith("default-src 'none'; script-src 'self'; ")
        assert 'unsafe' not in policy
        assert headers['X-Content-Type-Options'] == 'nosniff'
        assert headers['X-Frame-Options'] == 'DENY'
        assert 'Access-Control-Allow-Origin' not in headers
        assert 'Server' not in headers
        status, again, nothing = ask(site, path, 'HEAD')
        assert (status, again['Content-Type'], nothing) == (200, headers['Content-Type'], b'')


@pytest.mark.parametrize(
    ('path', 'method', 'status'),
    [
        ('/../../etc/passwd', 'GET', 404),
        ('/%2e%2e/setup.py', 'GET', 404),
        ('/page/index.html', 'GET', 404),
        ('/', 'POST', 405),
        ('/', 'OPTIONS', 405),
        ('/stream', 'DELETE', 405),
        ('/control', 'GET', 405),
        ('/control', 'POST', 403),
    ],
)
def test_nothing_else_is_answered(site, path, method, status):
    got, headers, body = ask(site, path, method)
    assert got == status
    assert json.loads(body)['error']
    assert headers['Content-Security-Policy']


@pytest.mark.parametrize(
    'host',
    [
        'evil.example',
        'localhost.evil.example',
        '127.0.0.1.evil.example:80',
        '',
        '[::1',
        'localhost:x',
    ],
)
def test_another_site_under_the_address_of_this_host_is_refused(site, host):
    status, _, body = ask(site, '/', Host=host)
    assert status in (400, 421)
    assert b'<html' not in body


@pytest.mark.parametrize(
    'host', ['localhost', 'LOCALHOST:9000', '[::1]:80', '127.0.0.1:1', 'Bot.local']
)
def test_names_of_this_host_are_answered_also_through_a_tunnel(make_site, host):
    site = make_site(hosts=['bot.LOCAL'])
    assert ask(site, '/', Host=host)[0] == 200


def test_two_hosts_or_none_are_refused(site):
    for lines in (
        b'GET / HTTP/1.0\r\n\r\n',
        b'GET / HTTP/1.1\r\nHost: a\r\nHost: localhost\r\n\r\n',
    ):
        with open_socket(site) as opened:
            opened.sendall(lines)
            assert opened.recv(100).split()[1] in (b'400', b'421')


def test_a_wish_needs_permission_token_origin_and_sense(make_site):
    site = make_site(token=TOKEN)
    assert control(site) == (202, '')
    assert [item.action for item in site.wishes] == ['prune']
    site.wishes.clear()
    for status, headers in [
        (401, {'Authorization': ''}),
        (401, {'Authorization': f'Bearer {TOKEN}x'}),
        (401, {'Authorization': TOKEN}),
        (401, {'Authorization': 'Bearer ' + '\xe9' * 20}),
        (403, {'Origin': 'http://evil.example'}),
        (403, {'Origin': 'null'}),
        (403, {'Sec_Fetch_Site': 'cross-site'}),
        (403, {'Sec_Fetch_Site': 'same-site'}),
        (415, {'Content_Type': 'text/plain'}),
        (421, {'Host': 'evil.example'}),
    ]:
        got, reason = control(site, **headers)
        assert (got, bool(reason)) == (status, True), headers
    for wish in [
        b'',
        b'[' * 1000,
        b'\xff',
        [],
        {},
        {**WISH, 'action': 'shutdown'},
        {'action': 'prune'},
        {**WISH, 'robot': 3},
        {**WISH, 'rule': 'R1'},
        {**WISH, 'action': 'enable_rule'},
    ]:
        assert control(site, wish)[0] == 400, wish
    assert control(site, b' ' * 3000)[0] == 413
    own = f'http://127.0.0.1:{site.server.port}'
    assert control(site, Origin=own, Sec_Fetch_Site='same-origin')[0] == 202
    assert len(site.wishes) == 1


def test_without_permission_even_the_token_changes_nothing(site):
    assert control(site)[0] == 403
    assert site.wishes == []


def test_the_stream_is_whole_at_once_and_told_again_at_each_tick(site):
    site.robot('/a')
    site.heard['/a'] = 0.5
    kinds, told = [], {}
    with connect(site) as connection:
        connection.request('GET', '/stream')
        answer = connection.getresponse()
        assert answer.headers['Content-Type'] == 'text/event-stream'
        while kinds.count('now') < 5:
            key, _, value = answer.readline().decode().rstrip().partition(': ')
            if key == 'event':
                kinds.append(value)
            elif key == 'data':
                told = json.loads(value) if kinds[-1] == 'now' else told
    assert set(kinds[:4]) == {'now', 'past', 'rules', 'log'}
    assert [(item['name'], item['standing']) for item in told['robots']] == [('/a', 'SAFE')]
    wait_until(lambda: site.server.streams == 0)


def test_a_client_that_reads_nothing_delays_nobody_and_costs_little(site):
    names = [f'/robot{number}' for number in range(20)]
    for name in names:
        site.robot(name)
        site.heard[name] = 0.5
    with stream(site), stream(site) as reading:
        wait_until(lambda: site.server.streams == 2)
        before, got = memory_mb(), 0
        end = time.monotonic() + 4.0
        while time.monotonic() < end:
            assert reading.recv(1 << 20)
            got += 1
        assert got > 20
        assert memory_mb() - before < 20.0


def test_no_more_streams_than_allowed(site):
    from occ_constraints_pkg.dashboard.application import MOST_STREAMS

    with contextlib.ExitStack() as stack:
        for _ in range(MOST_STREAMS):
            stack.enter_context(stream(site))
        status, headers, _ = ask(site, '/stream')
        assert (status, headers['Retry-After']) == (503, '5')
        # Files are served all the same.
        assert ask(site)[0] == 200
    wait_until(lambda: site.server.streams == 0)
    stream(site).close()


def test_a_thousand_connections_do_not_keep_a_page_away(site):
    before = memory_mb()
    with contextlib.ExitStack() as stack, stream(site) as page:
        for number in range(1000):
            opened = stack.enter_context(open_socket(site))
            # Some say nothing, some begin to say something.
            if number % 2:
                with contextlib.suppress(OSError):
                    opened.sendall(b'GET / HTTP/1.1\r\nHost: loc')
        assert ask(site)[0] == 200
        assert memory_mb() - before < 30.0
        for _ in range(10):
            assert page.recv(65536)
    assert ask(site)[0] == 200


def test_who_says_nothing_for_long_is_left_and_the_stream_is_not(make_site, monkeypatch):
    pytest.importorskip('uvicorn', reason="needs the extra 'dashboard'")
    monkeypatch.setattr('occ_constraints_pkg.dashboard.server.IDLE_SECONDS', 1.0)
    site = make_site()
    with stream(site) as page, open_socket(site) as silent, open_socket(site) as slow:
        slow.sendall(b'GET / HTTP/1.1\r\nHost: localhost\r\nX: ')
        for opened in (silent, slow):
            with contextlib.suppress(ConnectionResetError):
                assert opened.recv(100) == b''
        end = time.monotonic() + 2.0
        while time.monotonic() < end:
            assert page.recv(65536)


@pytest.mark.parametrize('path', ['/', '/control', '/stream', '/nothing'])
def test_a_hundred_megabytes_are_not_taken(make_site, path):
    site = make_site(token=TOKEN)
    before, size = memory_mb(), 100_000_000
    head = f'POST {path} HTTP/1.1\r\nHost: localhost\r\nContent-Length: {size}\r\n\r\n'
    chunk = bytes(1_000_000)
    with open_socket(site) as opened:
        opened.settimeout(3.0)
        with contextlib.suppress(OSError):
            opened.sendall(head.encode())
            for _ in range(size // len(chunk)):
                opened.sendall(chunk)
    assert memory_mb() - before < 20.0
    assert ask(site)[0] == 200


def test_a_header_without_end_is_refused(site):
    with open_socket(site) as opened, contextlib.suppress(ConnectionError):
        opened.sendall(b'GET / HTTP/1.1\r\nHost: localhost\r\nX: ' + b'x' * 1_000_000)
        assert opened.recv(100).split()[1] == b'400'
    assert ask(site)[0] == 200


@settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    st.binary(max_size=300),
    st.sampled_from([b'', b'GET / HTTP/1.1\r\nHost: localhost\r\n', b'POST /control HTTP/1.1\r\n']),
)
def test_nonsense_is_survived(site, noise, before):
    with open_socket(site) as opened, contextlib.suppress(ConnectionError):
        opened.sendall(before + noise)
        opened.shutdown(socket.SHUT_WR)
        opened.recv(100)
    assert ask(site)[0] == 200


def test_a_port_that_is_taken_is_one_sentence(site, make_site):
    with pytest.raises(OccError, match='cannot listen to 127.0.0.1 port'):
        make_site(site.server.port)


def test_it_ends_at_once_with_clients_there(make_site):
    site = make_site()
    with stream(site), open_socket(site):
        begin = time.monotonic()
        site.close()
        assert time.monotonic() - begin < 3.0
    assert not any(thread.name == 'page' for thread in threading.enumerate())
