# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""``occ doctor``: each fault has its line and its advice, in a bounded time, without ROS too."""

import json
import os
import shutil
import subprocess
import sys
import time
from collections import namedtuple
from datetime import UTC, datetime
from pathlib import Path

import pytest
from occ_constraints_pkg.doctor import examination, local, network
from occ_constraints_pkg.doctor.findings import NOTE, OK, PROBLEM, Finding, examined
from occ_constraints_pkg.errors import ConfigurationError


@pytest.fixture(autouse=True)
def _plain_environment(monkeypatch):
    for name in (
        'ROS_DOMAIN_ID',
        'ROS_AUTOMATIC_DISCOVERY_RANGE',
        'ROS_LOCALHOST_ONLY',
        'ROS_STATIC_PEERS',
        'ROS_DISCOVERY_SERVER',
        'RMW_IMPLEMENTATION',
        'ROS_LOG_DIR',
        'ROS_HOME',
        'FASTRTPS_DEFAULT_PROFILES_FILE',
    ):
        monkeypatch.delenv(name, raising=False)


def absent(monkeypatch, *names):
    there = local.find_spec
    monkeypatch.setattr(local, 'find_spec', lambda name: None if name in names else there(name))


VARIABLES = [
    ({}, OK, 'ROS_DOMAIN_ID 0'),
    ({'ROS_DOMAIN_ID': '7'}, OK, 'ROS_DOMAIN_ID 7'),
    ({'ROS_DOMAIN_ID': '150'}, NOTE, 'ports of domains above 101'),
    ({'ROS_DOMAIN_ID': '233'}, PROBLEM, '0 to 232'),
    ({'ROS_DOMAIN_ID': 'robot'}, PROBLEM, "'robot'"),
    ({'ROS_AUTOMATIC_DISCOVERY_RANGE': 'OFF'}, PROBLEM, 'no node hears another'),
    ({'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LAN'}, PROBLEM, 'SUBNET, LOCALHOST'),
    ({'ROS_STATIC_PEERS': '10.0.0.9'}, OK, '10.0.0.9'),
    ({'FASTRTPS_DEFAULT_PROFILES_FILE': '/nowhere.xml'}, PROBLEM, '/nowhere.xml'),
]


@pytest.mark.parametrize(('variables', 'level', 'words'), VARIABLES)
def test_variables_of_ros(monkeypatch, variables, level, words):
    for name, value in variables.items():
        monkeypatch.setenv(name, value)
    finding = examined('domain', local.domain)
    assert finding.level == level
    assert words in f'{finding.text} {finding.advice}'
    assert (finding.advice == '') == (level == OK)


def test_without_rclpy_it_says_how_to_get_it(monkeypatch):
    absent(monkeypatch, 'rclpy', 'std_srvs')
    monkeypatch.setattr(local, '_JAZZY', Path('/nowhere'))
    finding = local.ros_packages()
    assert (finding.level, finding.text) == (
        PROBLEM,
        'rclpy, std_srvs not installed; nodes need them',
    )
    assert finding.advice == "pip install 'occ_constraints_pkg[ros]'"
    monkeypatch.setattr(local, '_JAZZY', Path(__file__))
    assert local.ros_packages().advice.startswith(f'source {__file__}')


def test_an_extra_that_is_not_installed_is_a_note(monkeypatch):
    absent(monkeypatch, 'torch')
    finding = local.extra('train')
    assert (finding.level, finding.advice) == (NOTE, "pip install 'occ_constraints_pkg[train]'")
    assert finding.text.startswith('torch not installed')


@pytest.mark.parametrize(
    ('version', 'level'), [((3, 10, 1), PROBLEM), ((3, 12, 3), OK), ((3, 14, 0), NOTE)]
)
def test_versions_of_python(monkeypatch, version, level):
    monkeypatch.setattr(sys, 'version_info', version)
    assert local.python().level == level


@pytest.mark.parametrize(
    ('moment', 'level'),
    [
        (datetime(2026, 6, 1, tzinfo=UTC), OK),
        (datetime(2020, 1, 1, tzinfo=UTC), PROBLEM),
        (datetime(2040, 1, 1, tzinfo=UTC), PROBLEM),
    ],
)
def test_the_clock_of_the_system(monkeypatch, moment, level):
    monkeypatch.setattr(time, 'time', moment.timestamp)
    assert examined('clock', local.clock).level == level


@pytest.mark.parametrize(('gib', 'level'), [(0.5, PROBLEM), (5, NOTE), (50, OK)])
def test_the_disk_that_recordings_go_to(monkeypatch, tmp_path, gib, level):
    usage = namedtuple('usage', 'total used free')
    free = usage(0, 0, int(gib * 2**30))
    monkeypatch.setattr(shutil, 'disk_usage', lambda path: free if path.exists() else None)
    finding = local.disk(tmp_path / 'not' / 'yet')
    assert finding.level == level
    assert f'{gib:.1f} GiB' in finding.text


def test_folders_that_cannot_be_written_to(monkeypatch, tmp_path):
    monkeypatch.setattr(os, 'access', lambda *_: False)
    monkeypatch.setenv('ROS_LOG_DIR', str(tmp_path / 'log'))
    assert local.disk(tmp_path).level == PROBLEM
    finding = local.logs()
    assert (finding.level, 'ROS_LOG_DIR' in finding.advice) == (PROBLEM, True)
    assert local.memory().level == NOTE


def test_what_cannot_be_examined_is_a_problem():
    def fails():
        raise PermissionError(13, 'Permission denied', '/x')

    def refuses():
        raise ConfigurationError('this is so; allowed is that')

    assert examined('x', fails).level == PROBLEM
    assert examined('x', refuses) == Finding('x', PROBLEM, 'this is so', 'allowed is that')


FACTS = {
    'rmw': 'rmw_fastrtps_cpp',
    'rclpy': '/there/rclpy/__init__.py',
    'has_events_executor': True,
    'heard_after_s': 0.1,
    'nodes': ['/monitor', '/gate', '/sim'],
    'topics': {
        '/violation': {
            'types': ['diagnostic_msgs/msg/DiagnosticArray'],
            'publishers': ['/monitor'],
        },
        '/cmd_vel': {'types': ['geometry_msgs/msg/Twist'], 'publishers': ['/gate']},
    },
    'clock_publishers': [],
    'clock_messages': 0,
    'clock_advanced_s': None,
    'clock_took_s': None,
    'use_sim_time': {'/monitor': False},
    'behind_s': {'/violation': 0.001},
}


def topics(**changes):
    return {'topics': {**FACTS['topics'], **changes}}


ARRAY = 'diagnostic_msgs/msg/DiagnosticArray'
SIMULATED = {
    'clock_publishers': ['/sim'],
    'clock_messages': 50,
    'clock_advanced_s': 2.0,
    'clock_took_s': 1.0,
}
FOUND = [
    ({}, '', OK, ''),
    ({'has_events_executor': False}, 'rclpy', PROBLEM, '7.1.4'),
    (
        topics(**{'/violation': {'types': [ARRAY], 'publishers': ['/a', '/b']}}),
        'publishers',
        PROBLEM,
        '/violation has 2 publishers: /a, /b',
    ),
    (
        topics(**{'/r/costs': {'types': ['std_msgs/msg/String'], 'publishers': ['/a']}}),
        'publishers',
        PROBLEM,
        '/r/costs is of type std_msgs/msg/String',
    ),
    (
        topics(**{'/cmd_vel': {'types': ['x'], 'publishers': ['/gate', '/teleop']}}),
        'publishers',
        PROBLEM,
        '/cmd_vel is commanded past /gate by /teleop',
    ),
    (topics(**{'/cmd_vel': {'types': ['x'], 'publishers': ['/a', '/b']}}), 'publishers', OK, ''),
    ({'nodes': ['/monitor', '/monitor']}, 'publishers', PROBLEM, 'several nodes are called'),
    (SIMULATED, 'simulated time', NOTE, 'use_sim_time:=true: /monitor'),
    ({**SIMULATED, 'use_sim_time': {'/monitor': True}}, 'simulated time', OK, '2 times'),
    ({**SIMULATED, 'clock_advanced_s': 0.0}, 'simulated time', NOTE, 'stands still'),
    ({**SIMULATED, 'clock_messages': 0}, 'simulated time', NOTE, 'nothing comes'),
    (
        {**SIMULATED, 'clock_messages': 1, 'clock_took_s': 0.0, 'clock_advanced_s': 0.0},
        'simulated time',
        NOTE,
        'stands still',
    ),
    ({'clock_publishers': ['/a', '/b']}, 'simulated time', PROBLEM, '2 publishers'),
    ({'use_sim_time': {'/gate': True}}, 'simulated time', PROBLEM, 'nobody publishes /clock'),
    ({'behind_s': {'/violation': -3.0}}, 'clocks', PROBLEM, '3.00 s ahead'),
    ({'behind_s': {'/violation': 0.7}}, 'clocks', PROBLEM, '0.70 s behind'),
    ({'behind_s': {}}, 'clocks', OK, 'no verdict came'),
]


@pytest.mark.parametrize(('changes', 'name', 'level', 'words'), FOUND)
def test_what_two_processes_report_is_judged(monkeypatch, changes, name, level, words):
    monkeypatch.setattr(network, '_probe', lambda *_: ({**FACTS, **changes}, ''))
    findings = network.examine_network(time.monotonic() + 9.0)
    assert [item.name for item in findings] == [
        'rclpy',
        'discovery',
        'publishers',
        'simulated time',
        'clocks',
    ]
    chosen = {item.name: item for item in findings}
    if name:
        assert chosen[name].level == level
        assert words in f'{chosen[name].text} {chosen[name].advice}'
    bad = [item.name for item in findings if item.level != OK]
    assert bad == ([name] if level != OK else [])


@pytest.mark.parametrize(('second', 'words'), [(0.2, 'firewall'), (None, 'UDP ports')])
def test_processes_that_do_not_hear_each_other(monkeypatch, second, words):
    answers = [{**FACTS, 'heard_after_s': None}, {**FACTS, 'heard_after_s': second}]
    monkeypatch.setattr(network, '_probe', lambda *_: (answers.pop(0), ''))
    finding = network.examine_network(time.monotonic() + 9.0)[1]
    assert finding.level == PROBLEM
    assert words in finding.advice


def test_after_a_problem_no_process_is_started(monkeypatch, tmp_path):
    monkeypatch.setenv('ROS_DOMAIN_ID', '-1')
    monkeypatch.setattr(examination, 'examine_network', None)
    findings = list(examination.examine(tmp_path))
    assert findings[-1].text.startswith('not tried')
    text = '\n'.join(map(examination.text_of, findings))
    assert "problem  domain          ROS_DOMAIN_ID is '-1'\n" in text
    assert 'need mending' in examination.summary_of(findings)
    document = examination.document_of(findings)
    assert (document['ok'], len(document['findings'])) == (False, len(findings))


FAULTS = {
    'import of another Python': "raise ImportError('No module named rclpy._rclpy_pybind11')",
    'crash': 'import os; os._exit(102)',
    'noise': "print('{'); print('{}x'); raise RuntimeError('rcl error: \\x1b[2J')",
    'hang': 'import time; time.sleep(60)',
}


@pytest.mark.parametrize('fault', list(FAULTS))
def test_a_broken_rclpy_is_a_line_within_ten_seconds(tmp_path, fault):
    pytest.importorskip('rclpy', reason="needs the extra 'ros'")
    folder = tmp_path / 'rclpy'
    folder.mkdir()
    (folder / '__init__.py').write_text(FAULTS[fault])
    begin = time.monotonic()
    done = subprocess.run(
        [sys.executable, '-m', 'occ_constraints_pkg', 'doctor', '--json'],
        env={**os.environ, 'PYTHONPATH': str(tmp_path)},
        capture_output=True,
        text=True,
        check=False,
        timeout=60,
    )
    took = time.monotonic() - begin
    assert (done.returncode, done.stderr) == (1, '')
    (finding,) = (item for item in json.loads(done.stdout)['findings'] if item['level'] == PROBLEM)
    assert finding['name'] == 'rclpy'
    assert finding['text'].startswith('cannot be started')
    assert took < 12.0


def test_a_middleware_that_is_not_installed(monkeypatch, run_occ):
    pytest.importorskip('rclpy', reason="needs the extra 'ros'")
    monkeypatch.setenv('RMW_IMPLEMENTATION', 'rmw_nobody_cpp')
    code, out, err = run_occ('doctor')
    assert (code, err) == (1, '')
    assert 'ros-jazzy-rmw-nobody-cpp' in out
    assert 'not tried' in out


def test_it_does_not_load_ros_itself():
    code = """
import sys
from occ_constraints_pkg.doctor import examination, network
print(*({'rclpy', 'torch', 'textual'} & set(sys.modules)))
"""
    done = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == []
