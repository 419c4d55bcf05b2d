# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Mistakes in what a node is given: one sentence and exit code 2, before anything is written."""

import pytest
from made_bags import write_drive
from occ_constraints_pkg.bags.writer import BagWriter
from occ_constraints_pkg.cli import main


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
    (folder / 'corrupt.yaml').write_text(text[: len(text) // 2] + '\0')
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


MISTAKES = {
    'tree_learner': "parameter 'feature_map' of node 'tree_learner' is missing",
    'tree_learner -p feature_map:=simple_nave': "did you mean 'simple_nav'",
    'tree_learner -p feature_map:=simple_nav -p clip:=maas': "clip is 'maas'",
    'tree_learner -p feature_map:=simple_nav -p max_depth:=-1': "parameter 'max_depth'",
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
    'monitor -p constraints_file:=edited.yaml -p disabled_rules:=X': "there is no rule 'X'",
    'monitor -p constraints_file:=edited.yaml -p moved_bounds:=X': "a moved bound is 'X'",
    'monitor -p trigger_count:=2': 'a window of at least trigger_count',
    'monitor -p timeout:=0': 'allowed is a number from 0.01',
    'monitor -p timeout:=soon': "got 'soon'; allowed is a number",
    'monitor -p timeout:=.nan': 'got nan; allowed is a number',
    'monitor -p enabled:=1': 'got 1; allowed is true or false',
    'monitor enabled': "['enabled']",
    'monitor -p enabled': "'-p enabled'",
    'monitor --params-file nowhere.yaml': 'nowhere.yaml',
    'sim -p world:=simple_nav -p drive_by_cmd_vel:=true': 'got 1 of simple_nav',
    'sim -p num_robots:=2 -p drive_by_cmd_vel:=true': 'got 2 of PointGoal1',
    'recorder': "parameter 'output' of node 'recorder' is missing",
    'recorder -p output:=drive': 'drive exists already',
    'recorder -p output:=7': 'got 7; allowed is text',
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
    'sim -p world:=simple_nave': "did you mean 'simple_nav'",
    'player -p bag:=drive -p start_offset:=1e300': 'got 1e+300; allowed is a number from 0',
    'sim -p num_robots:=0': 'allowed is a whole number from 1',
    'sim -p num_robots:=2.5': 'allowed is a whole number from 1',
    'constrained_learner -p output:=typo.yaml/x': 'cannot write to typo.yaml/x',
    'constrained_learner -p output:=. -p device:=tpu': "device is 'tpu'",
    'constrained_learner -p output:=. -p total_steps:=255': 'total_steps is 255',
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


def test_a_time_may_be_so_long_that_it_means_never(nodes, witness):
    nodes.start('sim', world='simple_nav', repeat_after=1e200, rate=1e-300)
    nodes.start('recorder', output=nodes.folder / 'bag', max_bag_duration=1e200)
    nodes.start('monitor', timeout=1e200, max_lead=1e200, warning_horizon=1e200)
    nodes.start('gate', command_timeout=1e200, timeout=1e200)
    names = {'sim', 'recorder', 'monitor', 'gate'}
    witness.spin_until(lambda: set(witness.node.get_node_names()) >= names, 40.0)


def test_a_misspelt_parameter_is_pointed_out(node):
    code, text = node('player -p bag:=drive -p rate:=1000 -p lop:=true -p use_sim_time:=false')
    assert code == 0
    told = [line for line in text.splitlines() if 'WARN' in line]
    assert len(told) == 1
    assert "'lop' is ignored" in told[0]
    assert "did you mean 'loop'?" in told[0]
