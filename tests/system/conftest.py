# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Nodes as real processes, each test in a ROS domain of its own, on this machine only."""

import signal
import time
from contextlib import ExitStack
from pathlib import Path

import numpy as np
import pytest
from occ_constraints_pkg.demo.processes import NodeProcess, private_domain
from occ_constraints_pkg.features.feature_map import load_feature_map
from occ_constraints_pkg.features.table import Table
from occ_constraints_pkg.rules import Literal, Rule, RuleSet
from occ_constraints_pkg.rules.constraints_file import Constraints
from synthetic_bags import write_drive

# How long robots wait for what is wanted of who watches them.
_PATIENCE = 60.0


class Nodes:
    """Starts nodes and sees to it that none survives the test."""

    def __init__(self, folder: Path, domain: int) -> None:
        self.folder, self.domain = folder, domain
        self.started: list[NodeProcess] = []

    def start(self, name: str, *, namespace: str = '/', **parameters) -> NodeProcess:
        folder = self.folder / 'logs' / namespace.strip('/') / str(len(self.started))
        process = NodeProcess(name, parameters, folder, self.domain, namespace=namespace)
        self.started.append(process)
        return process

    def stop(self, *processes: NodeProcess, number: signal.Signals = signal.SIGINT) -> None:
        """Send a signal to some or all nodes; each must end by itself, cleanly and in silence."""
        chosen = processes or [item for item in self.started if not item.was_killed]
        for process in chosen:
            process.send_signal(number)
        for process in chosen:
            code, text = process.join(), process.log.read_text()
            assert code == 0, f'{process.name} ended with {code}: {text}'
            assert 'Traceback' not in text
            assert 'FATAL' not in text

    def kill(self) -> None:
        for process in self.started:
            # A stopped process takes no other signal.
            process.send_signal(signal.SIGKILL)
            process.join()


@pytest.fixture(scope='session', autouse=True)
def _ros() -> None:
    pytest.importorskip('rclpy', reason="needs the extra 'ros'")


@pytest.fixture(scope='module')
def make_nodes(tmp_path_factory):
    """Return a function that returns :class:`Nodes` with a new folder and domain."""
    with ExitStack() as stack:

        def make() -> Nodes:
            domain = stack.enter_context(private_domain())
            nodes = Nodes(tmp_path_factory.mktemp('nodes'), domain)
            stack.callback(nodes.kill)
            return nodes

        yield make


@pytest.fixture
def nodes(make_nodes):
    """Return :class:`Nodes`; at the end of the test all must end cleanly on Ctrl-C."""
    nodes = make_nodes()
    yield nodes
    nodes.stop()


@pytest.fixture
def observer(nodes):
    """Return a listener in this process."""
    from listener import Listener

    with Listener(nodes.domain) as observer:
        yield observer


def _constraints(world: str, rules: list[list[tuple[str, str, float]]]) -> Constraints:
    feature_map = load_feature_map(world)
    space = feature_map.space
    built = tuple(
        Rule(
            f'R{number}', tuple(Literal(space.index(name), sign, bound) for name, sign, bound in r)
        )
        for number, r in enumerate(rules)
    )
    demonstrated = np.tile([0.0, 0.5], (len(space), 1))
    return Constraints(RuleSet(space, built, demonstrated), feature_map.to_document())


@pytest.fixture(scope='session')
def rules_of():
    """Return constraints of each world, written by hand."""
    lidar = [[(f'd_l{bin}', '>', 0.9)] for bin in range(16)]
    return {
        'simple_nav': _constraints(
            'simple_nav', [[('y', '>', 0.95)], [('x', '<=', 0.7), ('y', '>=', 0.3)]]
        ),
        'PointGoal1': _constraints(
            'PointGoal1',
            [
                [('v_x', '>', 0.4)],
                [('d_l0', '>=', 0.3), ('v_y', '<', 0.0), ('a_x', '<', 1.0)],
                *lidar,
            ],
        ),
    }


@pytest.fixture(scope='session')
def let_go():
    """Return a function that subscribes once more to a topic of tables.

    A simulation that waits for this subscription can be started early, along with the others.
    """

    def subscribe(observer, topic='observation'):
        from sensor_msgs.msg import PointCloud2

        observer.node.create_subscription(PointCloud2, topic, lambda message: None, 10)

    return subscribe


@pytest.fixture
def trigger(observer):
    """Return a function that calls a service without arguments and returns its answer."""
    from std_srvs.srv import Trigger

    return lambda service: observer.call(Trigger, service)


@pytest.fixture(scope='session')
def small_bag(tmp_path_factory) -> Path:
    """Return a bag with observations of simple_nav, written without ROS."""
    return write_drive(tmp_path_factory.mktemp('bags') / 'small', robots=3, steps=40)


@pytest.fixture
def rules(tmp_path, rules_of):
    """Return a file of rules about x and y, for what watches."""
    path = tmp_path / 'rules.yaml'
    rules_of['simple_nav'].save(path)
    return path


@pytest.fixture
def robots(observer):
    """Return a function that lets robots be somewhere, until something is as wanted."""
    from occ_constraints_pkg.ros.qos import STEPS
    from occ_constraints_pkg.ros.tables import table_bytes
    from sensor_msgs.msg import PointCloud2

    publishers = {}

    def send_until(condition, **places):
        for name in places:
            if name not in publishers:
                publishers[name] = observer.node.create_publisher(
                    PointCloud2, f'/{name}/observation', STEPS
                )
        end = time.monotonic() + _PATIENCE
        while not condition():
            assert time.monotonic() < end, 'nothing came of waiting'
            for name, place in places.items():
                table = Table(('x', 'y'), np.array([place]))
                publishers[name].publish(table_bytes(table, time.time_ns(), 'simple_nav'))
            observer.spin(0.02)

    return send_until
