# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Mistakes in what a node is given: one sentence and exit code 2, before anything is written."""

import resource
import subprocess
import sys
from pathlib import Path

import pytest
from occ_constraints_pkg.cli import main
from occ_constraints_pkg.demo.processes import environment
from occ_constraints_pkg.rosbag.writer import BagWriter
from synthetic_bags import write_drive

import occ_constraints_pkg


@pytest.fixture(scope='module')
def files(tmp_path_factory, rules_of):
    folder = tmp_path_factory.mktemp('files')
    write_drive(folder / 'drive', robots=6, steps=40)
    write_drive(folder / 'elsewhere', robots=1, steps=3, topic='/odom_table')
    BagWriter(folder / 'empty').close()
    # Written by hand, so counted as edited.
    rules_of['simple_nav'].save(folder / 'edited.yaml')
    text = (folder / 'edited.yaml').read_text()
    (folder / 'newer.yaml').write_text(text.replace('schema_version: 1', 'schema_version: 2'))
    (folder / 'units.yaml').write_text(text.replace("unit: '1'", 'unit: km', 1))
    (folder / 'corrupt.yaml').write_text(text[: len(text) // 2] + '\0')
    (folder / 'slip.yaml').write_text('/**/monitor: {ros__parameters: {timeot: 1.0}}')
    (folder / 'shared.yaml').write_text(
        '/**: {ros__parameters: {lop: true, of_another_node: {deep: 1}, use_sim_time: false}}\n'
        '/elsewhere/player: {ros__parameters: {lop: true}}\nmonitor: {ros__parameters: {lop: true}}'
    )
    (folder / 'typo.yaml').write_text(text.replace('operator', 'operater', 1))
    return folder


@pytest.fixture
def node(files, monkeypatch, capfd):
    """Return a function that runs a node in this process: exit code and all that it said."""
    monkeypatch.chdir(files)
    monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'OFF')

    def run(line):
        capfd.readouterr()
        code = main(['node', *line.split()])
        return code, ''.join(capfd.readouterr())

    return run


SCRIPTS = Path(occ_constraints_pkg.__file__).parents[1] / 'scripts'
QOS = 'qos_overrides./violation.publisher'
MISTAKES = {
    'tree_learner': "parameter 'feature_map' of node 'tree_learner' is missing",
    'tree_learner -p feature_map:=simple_nave': "did you mean 'simple_nav'",
    'tree_learner -p feature_map:=simple_nav -p clip:=maas': "clip is 'maas'",
    'tree_learner -p feature_map:=simple_nav -p max_depth:=-1': "parameter 'max_depth'",
    'tree_learner -p feature_map:=simple_nav -p conditions:=all': "conditions is 'all'; allowed",
    'tree_learner -p feature_map:=simple_nav -p conditions:=pairs -p alpha:=0.5': 'within a box',
    'tree_learner -p feature_map:=simple_nav -p apart:=x': "apart names ('x',); allowed are pairs",
    'tree_learner -p feature_map:=simple_nav -p bags:=drive -p apart:=x,v': "apart names 'v'",
    'tree_learner -p feature_map:=simple_nav -p bags:=nowhere': 'no recording at nowhere',
    'tree_learner -p feature_map:=simple_nav -p bags:=empty': 'empty holds no messages',
    'tree_learner -p feature_map:=simple_nav -p bags:=elsewhere': "no topic 'observation'",
    'tree_learner -p feature_map:=simple_nav -p bags:=drive -p output:=edited.yaml': 'was edited',
    'tree_learner -p feature_map:=simple_nav -p bags:=drive -p output:=typo.yaml': 'operater',
    'tree_learner -p feature_map:=simple_nav -p calibrate_on:=drive': "goes with 'bags' only",
    'tree_learner -p feature_map:=simple_nav -p bags:=drive -p false_alarm:=0.01': 'needs 99 safe',
    'tree_learner -p feature_map:=simple_nav -p bags:=drive -p false_alarm:=2': 'up to 1',
    'monitor -p constraints_file:=nowhere.yaml': 'cannot read nowhere.yaml',
    'monitor -p constraints_file:=typo.yaml': "did you mean 'operator'",
    'monitor -p constraints_file:=newer.yaml': 'newer.yaml',
    'monitor -p constraints_file:=corrupt.yaml': 'corrupt.yaml',
    'monitor -p constraints_file:=units.yaml': "but feature_map gives x in '1'",
    'monitor -p constraints_file:=edited.yaml -p disabled_rules:=X': "there is no rule 'X'",
    'monitor -p constraints_file:=edited.yaml -p moved_bounds:=X': "a moved bound is 'X'",
    'monitor -p trigger_count:=2': 'a window of at least trigger_count',
    'monitor -p timeout:=0': 'allowed is a number from 0.01',
    'monitor -p timeout:=soon': "got 'soon'; allowed is a number",
    'monitor -p timeout:=.nan': 'got nan; allowed is a number',
    'monitor -p enabled:=1': 'got 1; allowed is true or false',
    'monitor enabled': "['enabled']",
    'monitor -p enabled': "'-p enabled'",
    'monitor --params-file nowhere.yaml': 'cannot read nowhere.yaml: No such file',
    'monitor --params-file slip.yaml': "did you mean 'timeout'?",
    'monitor -p constraint_file:=edited.yaml': "did you mean 'constraints_file'?",
    'monitor -p monitor:timeot:=1.0': "did you mean 'timeout'?",
    'monitor -p use_simtime:=true': "did you mean 'use_sim_time'?",
    'player -p bag:=drive -p lop:=true': "did you mean 'loop'?",
    'gate -p use_sim_time:=1': "'use_sim_time' of node 'gate': got 1; allowed is true or false",
    'gate -p use_sim_time:=maybe': "got 'maybe'; allowed is true or false",
    'gate -p start_type_description_service:=1': 'allowed is true or false',
    f'monitor -p {QOS}.reliability:=bad': "got 'bad'; allowed are reliable, best_effort",
    f'monitor -p {QOS}.reliability:=1': 'got 1; allowed are reliable, best_effort',
    f'monitor -p {QOS}.history:=unknown': "got 'unknown'; allowed are keep_last, keep_all",
    f'monitor -p {QOS}.depth:=0': 'got 0; allowed is a whole number from 1',
    f'monitor -p {QOS}.depth:=-1': 'got -1; allowed is a whole number from 1',
    f'monitor -p {QOS}.depth:=4294967296': 'allowed is a whole number from 1',
    f'monitor -p {QOS}.depth:=x': "got 'x'; allowed is a whole number from 1",
    f'monitor -p {QOS}.lifespan:=1': "lifespan'; allowed are the policies history, reliability",
    f'monitor -p {QOS}.durability:=local': "got 'local'; allowed are volatile, transient_local",
    f'monitor -p {QOS}.deadline:=-1': 'got -1; allowed is a whole number of ns from 0',
    f'monitor -p {QOS}.deadline:=1.5': 'got 1.5; allowed is a whole number of ns from 0',
    f'monitor -p {QOS}.liveliness:=manual_by_node': 'allowed are automatic, manual_by_topic',
    f'monitor -p {QOS}.deadlin:=1': "did you mean 'deadline'?",
    'gate -p qos_overrides./cmd_vel_in.subscription.deadline:=1': (
        "deadline'; allowed are the policies history, reliability, depth"
    ),
    f'monitor -p {QOS}.dept:=5': "did you mean 'depth'?",
    'monitor -p qos_overrides./violatio.publisher.depth:=5': "'qos_overrides./violation.publ",
    f'gate -p {QOS}.depth:=5': "no parameter 'qos_overrides./violation.publisher.depth'",
    'player -p bag:=drive -p qos_overrides./x.publisher.depth:=5': 'none of quality of service',
    'sim -p world:=simple_nav -p drive_by_cmd_vel:=true': 'got 1 of simple_nav',
    'sim -p num_robots:=2 -p drive_by_cmd_vel:=true': 'got 2 of PointGoal1',
    'recorder': "parameter 'output' of node 'recorder' is missing",
    'recorder -p output:=drive': 'drive exists already',
    'recorder -p output:=7': 'got 7; allowed is text',
    'recorder -p output:=new -p topcs:=odom': "did you mean 'topics'?",
    'constrained_learner -p output:=new -p seeds:=1': "did you mean 'seed'?",
    'sim -p worlds:=simple_nav': "did you mean 'world'?",
    'recorder -p output:=new -p topics:=[1,2]': 'allowed is a list of texts',
    'recorder -p output:=new -p topics:=9lives': "'9lives' cannot name a topic",
    'recorder -p output:=new -p compression:=zip': "compression 'zip'",
    'recorder -p output:=typo.yaml/new': 'cannot record to typo.yaml/new: Not a directory',
    'recorder -p output:=new -p regex:=a(': "'a(' chooses no topics",
    'recorder -p output:=new -p max_bag_size:=-1': 'allowed is a whole number from 0',
    'player': "parameter 'bag' of node 'player' is missing",
    'player -p bag:=nowhere': 'no recording at nowhere',
    'player -p bag:=drive -p topics:=observatio': "no topic 'observatio'",
    'player -p bag:=drive -p rate:=0': 'allowed is a number from 0.001',
    'player -p bag:=drive -p clock:=-1': 'allowed is a number from 0',
    'player -p bag:=drive -p start_offset:=1e3': 'no message to play from 1000 s after its start',
    'player -p bag:=drive -p exclude_topics:=observatio': "no topic 'observatio'",
    'player -p bag:=drive -p exclude_regex:=.': 'none of the topics to play',
    'policy -p policy:=nowhere.npz': 'nowhere.npz',
    'policy -p policy:=expret': "there is no driver 'expret'; did you mean 'expert'?",
    'sim -p world:=simple_nave': "did you mean 'simple_nav'",
    'player -p bag:=drive -p start_offset:=1e300': 'got 1e+300; allowed is a number from 0',
    'sim -p num_robots:=0': 'allowed is a whole number from 1',
    'sim -p num_robots:=2.5': 'allowed is a whole number from 1',
    'constrained_learner -p output:=typo.yaml/x': 'cannot write to typo.yaml/x',
    'constrained_learner -p output:=. -p device:=tpu': "device is 'tpu'",
    'constrained_learner -p output:=. -p total_steps:=63': 'total_steps is 63',
}


@pytest.mark.parametrize('line', MISTAKES)
def test_a_mistake_is_told_in_one_sentence(node, files, line):
    if line.startswith('constrained_learner'):
        pytest.importorskip('torch', reason="needs the extra 'train'")
    before = {path: path.stat().st_mtime_ns for path in files.rglob('*') if path.is_file()}
    code, text = node(line)
    # What is not ours: rcl's own line on arguments that it cannot read.
    told = [item for item in text.splitlines() if '[INFO]' not in item and '[rcl]' not in item]
    assert code == 2
    assert len(told) == 1, text
    assert told[0].startswith('error: ')
    assert MISTAKES[line] in told[0]
    assert not (files / 'new').exists()
    after = {path: path.stat().st_mtime_ns for path in files.rglob('*') if path.is_file()}
    assert after == before


def test_a_parameter_may_lack_its_decimal_point_or_its_brackets(node, files):
    line = '-p feature_map:=simple_nav -p bags:=drive -p exit_when_done:=true -p contamination:=0'
    code, text = node(f'tree_learner {line}')
    assert code == 0, text
    assert 'rules learned' in text
    code, text = node('player -p bag:=drive -p rate:=1000 -p topics:=[]')
    assert code == 0, text
    assert 'the recording is over' in text


def test_a_time_may_be_so_long_that_it_means_never(nodes, observer):
    nodes.start('sim', world='simple_nav', repeat_after=1e200, rate=1e-300)
    nodes.start('recorder', output=nodes.folder / 'bag', max_bag_duration=1e200)
    nodes.start('monitor', timeout=1e200, max_lead=1e200, warning_horizon=1e200)
    nodes.start('gate', command_timeout=1e200, timeout=1e200)
    names = {'sim', 'recorder', 'monitor', 'gate'}
    observer.spin_until(lambda: set(observer.node.get_node_names()) >= names)


def test_parameters_for_any_node_may_be_those_of_others(node):
    code, text = node('player -p bag:=drive -p rate:=1000 --params-file shared.yaml')
    assert code == 0, text
    told = [line for line in text.splitlines() if 'WARN' in line]
    # Of these, a name that looks like one of ours may be a slip.
    assert len(told) == 1
    assert "'lop' is ignored" in told[0]
    assert "did you mean 'loop'?" in told[0]


def test_quality_of_service_of_topics_that_a_map_names_can_be_overridden(nodes, observer):
    qos = 'qos_overrides./scan.subscription'
    nodes.start('monitor', **{f'{qos}.depth': 2, f'{qos}.reliability': 'RELIABLE'})
    observer.spin_until(lambda: 'monitor' in observer.node.get_node_names())


def run(*arguments, **options):
    """Return how a program ended that Python runs."""
    return subprocess.run(
        [sys.executable, *arguments],
        capture_output=True,
        text=True,
        check=False,
        timeout=60,
        **options,
    )


ENVIRONMENTS = {
    'ROS_DOMAIN_ID=233': "ROS_DOMAIN_ID is '233'; allowed is a whole number from 0 to 232",
    'ROS_DOMAIN_ID=-1': "ROS_DOMAIN_ID is '-1'; allowed is a whole number from 0 to 232",
    'ROS_DOMAIN_ID=one': "ROS_DOMAIN_ID is 'one'; allowed is a whole number from 0 to 232",
    f'ROS_DOMAIN_ID={10**30}': 'allowed is a whole number from 0 to 232',
    'RMW_IMPLEMENTATION=rmw_of_nobody_cpp': 'ros-jazzy-rmw-of-nobody-cpp from apt',
    'FAKETIME=@2038-01-20 00:00:00': "the system's clock shows 2038-01-20",
    'FAKETIME=@1969-01-01 00:00:00': "the system's clock shows 1969-01-01",
    'FAKETIME=@2300-01-01 00:00:00': "the system's clock shows a year beyond",
}


@pytest.mark.parametrize('name', ['monitor', 'gate'])
@pytest.mark.parametrize('setting', ENVIRONMENTS)
def test_surroundings_in_which_no_node_can_run_are_told_in_one_sentence(name, setting):
    variable, _, value = setting.partition('=')
    more = faketime() if variable == 'FAKETIME' else {}
    command = ['-m', 'occ_constraints_pkg', 'node', name]
    done = run(*command, env={**environment(1), **more, variable: value})
    assert (done.returncode, done.stdout) == (2, '')
    assert done.stderr.count('\n') == 1
    assert done.stderr.startswith('error: ')
    assert ENVIRONMENTS[setting] in done.stderr


@pytest.mark.parametrize('name', ['monitor', 'gate'])
def test_too_little_memory_is_told_in_one_sentence(name):
    def limit():
        resource.setrlimit(resource.RLIMIT_AS, (300_000_000, 300_000_000))

    done = run(SCRIPTS / name, env=environment(1), preexec_fn=limit)
    assert (done.returncode, done.stdout) == (2, '')
    assert done.stderr.count('\n') == 1
    assert 'limited to 286 MiB; a node needs at least 640 MiB' in done.stderr


def test_a_clock_that_jumps_beyond_what_ros_can_carry_is_told_in_one_sentence(nodes, tmp_path):
    clock = tmp_path / 'clock'
    clock.write_text('+0')
    more = {**faketime(), 'FAKETIME_TIMESTAMP_FILE': str(clock), 'FAKETIME_NO_CACHE': '1'}
    process = subprocess.Popen(
        [sys.executable, '-m', 'occ_constraints_pkg', 'node', 'gate'],
        env={**environment(nodes.domain), **more},
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        assert 'STOP' in process.stderr.readline()
        clock.write_text('+20y')
        _, told = process.communicate(timeout=10.0)
    finally:
        process.kill()
    assert process.returncode == 2
    # Beside notes of rcl on what it cannot publish any more.
    ours = [line for line in told.splitlines() if line.startswith('error: ')]
    assert len(ours) == 1
    assert "the system's clock shows 204" in ours[0]
    assert 'Traceback' not in told


MISSING = {
    'rclpy.experimental': 'allowed is rclpy from 7.1.4',
    'rclpy': "'rclpy', which is not installed: pip install 'occ_constraints_pkg[ros]'",
    'diagnostic_msgs': "pip install 'occ_constraints_pkg[ros]'",
    'ruamel': 'source .venv/bin/activate), or pip install occ_constraints_pkg',
    'numpy': 'source .venv/bin/activate), or pip install occ_constraints_pkg',
}


@pytest.mark.parametrize('module', MISSING)
def test_a_module_that_is_missing_is_named_with_what_to_install(module):
    # As if it were not there: None in sys.modules says so to the import.
    code = (
        f'import sys; sys.modules[{module!r}] = None; from occ_constraints_pkg.nodes import run; '
        "sys.exit(run('monitor'))"
    )
    done = run('-c', code, env=environment(1))
    assert done.returncode == 2, done.stderr
    assert done.stderr.count('\n') == 1
    assert MISSING[module] in done.stderr
    # One way out, not one wrapped in another.
    assert done.stderr.count('allowed is') + done.stderr.count('which is not installed') == 1


def faketime():
    """Return what makes another clock of a process, or skip the test."""
    library = next(Path('/usr/lib').glob('*/faketime/libfaketime.so.1'), None)
    if library is None:
        pytest.skip('needs libfaketime')
    return {'LD_PRELOAD': str(library), 'FAKETIME_DONT_FAKE_MONOTONIC': '1'}
