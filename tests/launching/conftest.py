# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Launch files as ``ros2 launch`` runs them, in an install tree of links, and a domain each.

PyPI has no ``launch``: without it these tests are skipped. Besides apt it can be had from its
sources (ros2/launch, ros2/launch_ros), which are pure Python, on ``PYTHONPATH``.
"""

import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from occ_constraints_pkg.demo.processes import environment, private_domain

PACKAGE = Path(__file__).resolve().parents[2] / 'src' / 'occ_constraints_pkg'
# What `ros2 launch` does with a file and its arguments.
DRIVER = """
import sys
from launch import LaunchDescription, LaunchService
from launch.actions import IncludeLaunchDescription
from launch.launch_description_sources import AnyLaunchDescriptionSource

path, *arguments = sys.argv[1:]
pairs = [argument.split(':=', 1) for argument in arguments]
service = LaunchService(argv=arguments)
source = AnyLaunchDescriptionSource(path)
service.include_launch_description(
    LaunchDescription([IncludeLaunchDescription(source, launch_arguments=pairs)])
)
sys.exit(service.run())
"""
# Launches take as long as their nodes' starts, several at once on a busy machine.
PATIENCE = 90.0


class Launch:
    """A running launch: it, and all its nodes, are a process group of their own."""

    def __init__(self, file, arguments, folder, env):
        self.log = folder / f'{Path(file).stem}.log'
        path = file if '/' in str(file) else PACKAGE / 'launch' / f'{file}.launch.py'
        with self.log.open('wb') as output:
            self._process = subprocess.Popen(
                [sys.executable, '-c', DRIVER, path, *arguments],
                cwd=folder,
                env=env,
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=subprocess.STDOUT,
                start_new_session=True,
            )

    @property
    def text(self):
        return self.log.read_text()

    @property
    def is_running(self):
        return self._process.poll() is None

    def wait_for(self, text, times=1):
        """Wait until its output has a text so many times."""
        end = time.monotonic() + PATIENCE
        while self.text.count(text) < times:
            assert self.is_running, self.text
            assert time.monotonic() < end, self.text
            time.sleep(0.05)

    def join(self):
        """Return the exit code, which must come by itself, and see that no node is left."""
        try:
            code = self._process.wait(PATIENCE)
        except subprocess.TimeoutExpired:
            raise AssertionError(f'the launch does not end: {self.text}') from None
        for pid in self.pids.values():
            assert not Path(f'/proc/{pid}').exists(), f'process {pid} is left: {self.text}'
        assert 'Traceback' not in self.text
        return code

    @property
    def pids(self):
        """The process ids of the nodes by name; of one that was started twice, the newest."""
        found = re.findall(r'\[(\w+)-\d+\]: process started with pid \[(\d+)\]', self.text)
        return {name: int(pid) for name, pid in found}

    def interrupt(self):
        """Press Ctrl-C."""
        os.killpg(self._process.pid, signal.SIGINT)

    def kill(self):
        """End whatever is left."""
        try:
            os.killpg(self._process.pid, signal.SIGKILL)
        except ProcessLookupError:
            return
        self._process.wait()


@pytest.fixture(scope='session')
def prefix(tmp_path_factory):
    """An install tree as colcon makes it, of links."""
    prefix = tmp_path_factory.mktemp('prefix')
    name = PACKAGE.name
    folders = {
        'share/ament_index/resource_index/packages': [PACKAGE / 'resource' / name],
        f'share/{name}': [PACKAGE / 'package.xml'],
        f'share/{name}/launch': (PACKAGE / 'launch').glob('*.launch.py'),
        f'share/{name}/config': (PACKAGE / 'config').iterdir(),
        f'lib/{name}': (PACKAGE / 'scripts').iterdir(),
    }
    for folder, files in folders.items():
        (prefix / folder).mkdir(parents=True)
        for file in files:
            (prefix / folder / file.name).symlink_to(file)
    return prefix


@pytest.fixture(scope='session', autouse=True)
def _launch():
    for module in ('rclpy', 'launch_ros.actions'):
        pytest.importorskip(module, reason='needs rclpy and launch_ros, which PyPI does not have')


@pytest.fixture
def domain():
    with private_domain() as domain:
        yield domain


@pytest.fixture
def start(prefix, tmp_path, domain):
    """Return a function that launches a file, by its short name or its path."""
    started = []
    env = environment(domain)
    paths = [str(prefix), *env.get('AMENT_PREFIX_PATH', '').split(os.pathsep)]
    env |= {
        'AMENT_PREFIX_PATH': os.pathsep.join(filter(None, paths)),
        'PATH': os.pathsep.join([str(Path(sys.executable).parent), env['PATH']]),
        'ROS_LOG_DIR': str(tmp_path / 'log'),
    }

    def start(file, *arguments):
        started.append(Launch(file, arguments, tmp_path, env))
        return started[-1]

    yield start
    for launch in started:
        launch.kill()


@pytest.fixture
def observer(domain):
    from listener import Listener

    with Listener(domain) as observer:
        yield observer


@pytest.fixture
def parameter(observer):
    """Return a function that asks a running node for one of its parameters."""
    from rcl_interfaces.srv import GetParameters
    from rclpy.parameter import parameter_value_to_python

    def ask(node, name):
        answer = observer.call(GetParameters, f'{node}/get_parameters', names=[name])
        return parameter_value_to_python(answer.values[0])

    return ask
