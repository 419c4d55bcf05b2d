# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The player with bags whose types and topics are odd: the rest plays, and nothing is executed."""

import os
import subprocess
import sys

from occ_constraints_pkg.demo.processes import environment
from occ_constraints_pkg.rosbag.writer import BagWriter

STRING = 'std_msgs/msg/String'
DATA = b'\0\1\0\0\2\0\0\0a\0'
# Topic, type, and the reason that is told.
ODD = [
    ('/zen', 'this/msg/x', 'no message type'),
    ('/zen_of_python', 'this/msg/Zen', 'not installed'),
    ('/join', 'os/path/join', 'no message type'),
    ('/here', './msg/x', 'no message type'),
    ('/trigger', 'std_srvs/srv/Trigger', 'no message type'),
    ('/action', 'example_interfaces/action/Fibonacci_Goal', 'no message type'),
    ('/evil', 'evil_msgs/msg/Thing', 'not installed'),
    ('/evil_too', 'evilmod/msg/Thing', 'not installed'),
    ('/unknown', 'std_msgs/msg/Nope', 'not installed'),
    ('/rosout', STRING, 'the type that this node itself publishes'),
    ('/parameter_events', STRING, 'the type that this node itself publishes'),
    ('/a b', STRING, 'cannot name a topic'),
]


def test_odd_types_are_skipped_and_the_rest_plays(nodes, observer):
    from std_msgs.msg import String

    folder = nodes.folder
    with BagWriter(folder / 'bag') as bag:
        for number, (topic, msgtype, _) in enumerate([*ODD, ('/good', STRING, '')]):
            bag.write(topic, msgtype, DATA, 10**18 + number)
    # Beside the bag lie modules that would say so if they were imported.
    for name in ('evilmod', 'evil_msgs'):
        (folder / name / 'msg').mkdir(parents=True)
        for place in (folder / name, folder / name / 'msg'):
            (place / '__init__.py').write_text(f'print("executed {name}")\n')
        (folder / name / f'{name}_s__rosidl_typesupport_c.so').write_text('')
    heard = []
    observer.node.create_subscription(String, '/good', lambda m: heard.append(m.data), 10)
    player = subprocess.Popen(
        [sys.executable, '-m', 'occ_constraints_pkg', 'play', 'bag', '--wait-for-subscribers', '1'],
        cwd=folder,
        env={
            **environment(nodes.domain),
            'PYTHONPATH': os.pathsep.join(['', '.', str(folder), *sys.path]),
        },
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    try:
        observer.spin_until(lambda: player.poll() is not None)
        said = player.stdout.read()
    finally:
        player.kill()
        player.wait()
        player.stdout.close()
    assert player.returncode == 0, said
    assert heard == ['a']
    assert 'executed' not in said
    assert 'Zen of Python' not in said
    assert 'Traceback' not in said
    for topic, _, reason in ODD:
        (line,) = [line for line in said.splitlines() if f'topic {topic} is not played' in line]
        assert reason in line
