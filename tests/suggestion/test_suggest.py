# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
import math

import numpy as np
import pytest
from occ_constraints_pkg.datasets.extraction import extract
from occ_constraints_pkg.documents import parse_yaml
from occ_constraints_pkg.features.feature_map import FeatureMap
from occ_constraints_pkg.rosbag.recording import Recording
from occ_constraints_pkg.suggestion.inspection import inspect_topics
from occ_constraints_pkg.suggestion.suggest import suggest, suggest_each
from occ_constraints_pkg.suggestion.text import suggestion_text

from experiments.any_robot import suggested_maps
from experiments.robot_kinds import write_robot
from experiments.robot_kinds.drives import Drive
from experiments.robot_kinds.messages import make, write_messages
from experiments.robot_kinds.parts import imus

START = 100 * 10**9
TENTH = 10**8


def drive(messages, *, steps=60, frame='odom', jump=0, commands=True):
    """Return a drive along walls, with what spoils recordings."""
    entries = []
    for step in range(steps):
        now = START + step * TENTH
        stamp = now - (5 * 10**9 if jump and step >= jump else 0)
        ranges = np.full(36, np.inf)
        ranges[:12] = 0.5 + 0.4 * math.sin(step / 5)
        ranges[20] = 0.0
        entries.append(('/scan', messages.scan(ranges, stamp_ns=stamp, step=math.tau / 36), now))
        odometry = messages.odometry(
            stamp_ns=stamp + 1, x=0.2 + 0.1 * math.sin(step / 7), wz=0.3, frame=frame
        )
        entries.append(('/odom', odometry, now + 1))
        if commands:
            entries.append(('/cmd_vel', messages.twist(x=0.2 + 0.01 * (step % 3)), now + 2))
    return entries


def found(write_bag, entries, name='bag'):
    suggestion = suggest(Recording(write_bag(entries, name)))
    text = suggestion_text(suggestion)
    assert max(map(len, text.splitlines())) <= 100
    document = parse_yaml(text, 'suggested')
    feature_map = FeatureMap.from_document(document, 'suggested', text=text)
    assert feature_map.names == tuple(item.source.name for item in suggestion.seen.features)
    return suggestion, text, feature_map


def aside(suggestion):
    return {item.entry['name']: item.aside for item in suggestion.candidates if item.aside}


def test_a_drive(messages, write_bag):
    suggestion, text, feature_map = found(write_bag, drive(messages))
    assert (feature_map.pace, feature_map.max_age) == ('scan', 0.2)
    assert feature_map.names[:2] == ('speed', 'clearance_front')
    assert len(feature_map.names) == 1 + 8
    clearance = feature_map.features[1]
    # The open sectors see 4 m, so this is where more space does not count any more.
    assert clearance.transform == (('clip', 0.0, 4.0),)
    assert (clearance.low, clearance.high, clearance.missing) == (0.0, 4.0, 'max_range')
    reasons = aside(suggestion)
    assert 'constant at 0.3' in reasons['turn_rate']
    assert "in the frame 'odom'" in reasons['position_x']
    assert 'commands stop when nobody drives' in reasons['commanded_speed']
    assert 'noisy' in reasons['acceleration']
    # The first scan came before the first command.
    assert reasons['speed_error'] == 'missing in 2% of the rows'
    for part in (
        '/odom at 10 Hz',
        '# speed: ',
        '64% Inf, 3% 0',
        '# - {name: heading',
        'never missing',
    ):
        assert part in text
    (warning,) = suggestion.warnings
    assert warning.startswith('speed goes to and fro too seldom to know how far')
    data = extract([write_bag(drive(messages), 'again')], feature_map)
    assert np.isfinite(data.values[1:]).all()


def test_warnings(messages, write_bag):
    entries = drive(messages, frame='map', jump=30, commands=False)
    frozen = [(topic, m, t) for topic, m, t in entries if topic != '/scan']
    ranges = np.linspace(0.2, 2.0, 36)
    for step in range(60):
        ranges = ranges if step > 20 else ranges + 0.001
        frozen.append(('/scan', messages.scan(ranges, step=math.tau / 36), START + step * TENTH))
    suggestion, text, _ = found(write_bag, sorted(frozen, key=lambda entry: entry[2]))
    told = '\n'.join(suggestion.warnings)
    assert 'the stamps of /odom jump back once, first 2.9 s after its first message' in told
    assert 'the poses of /odom are in the frame map, which jumps' in told
    assert 'the messages of /scan have no time stamp; it is the trigger topic all the same' in told
    assert 'clearance_front did not change for 3.9 s' in told
    assert all(' '.join(sentence.split()[:4]) in text for sentence in suggestion.warnings)


def test_commands_alone(messages, write_bag):
    """Without anything measured, commands are better than nothing."""
    entries = [entry for entry in drive(messages) if entry[0] == '/cmd_vel']
    suggestion, _, feature_map = found(write_bag, entries)
    assert feature_map.names == ('commanded_speed',)
    assert 'no time stamp; it is the trigger topic all the same' in suggestion.warnings[0]


def test_a_table(messages, write_bag):
    rng = np.random.default_rng(0)
    names = ['lidar_0', 'lidar_1', 'still', 'episode', 'reward']
    entries = []
    for step in range(20):
        now = START + step * TENTH
        values = rng.random((3, 5)).astype(np.float32)
        values[:, 2:] = [7.0, 0.0, 1.0]
        entries.append(('/observation', messages.table(names, values, stamp_ns=now), now))
        entries.append(('/action', messages.table('ab', values[:, :2], stamp_ns=now), now + 1))
    suggestion, _, feature_map = found(write_bag, entries)
    assert feature_map.pace == 'observation'
    assert feature_map.names == ('lidar_0', 'lidar_1')
    assert {item.family for item in feature_map.features} == {'lidar'}
    assert aside(suggestion)['still'] == 'constant at 7'
    assert 'the table /observation is used instead' in aside(suggestion)['a']


def test_second_sources_are_set_aside_under_other_names(messages, write_bag):
    entries = drive(messages)
    twice = [(f'/robot{topic}', message, time) for topic, message, time in entries]
    both = sorted((*entries, *twice), key=lambda entry: entry[2])
    suggestion, _, feature_map = found(write_bag, both)
    assert {item.topic for item in feature_map.features} == {'odom', 'scan'}
    assert aside(suggestion)['clearance_robot_scan'] == '/scan is used instead'
    names = [item.entry['name'] for item in suggestion.candidates]
    assert len(set(names)) == len(names)


def test_a_scan_that_sees_only_ahead(messages, write_bag):
    entries = [
        (
            '/scan',
            messages.scan(
                1.0 + np.sin(np.arange(181) / 9 + step / 5) / 2,
                stamp_ns=START + step * TENTH,
                first=-math.pi / 2,
                step=math.pi / 180,
            ),
            START + step * TENTH,
        )
        for step in range(30)
    ]
    _, _, feature_map = found(write_bag, entries)
    assert feature_map.features[0].degrees[0] == -91.0
    assert feature_map.features[-1].degrees[1] == 91.0
    assert len(feature_map.names) == 8


def test_a_map_is_always_written(messages, write_bag, run_occ, tmp_path):
    """Without a feature, the map says why of each topic."""
    still = [('/cmd_vel', messages.twist(), START + step) for step in range(20)]
    few = [('/odom', messages.odometry(stamp_ns=START), START)]
    bag = write_bag([*few, *still])
    suggestion = suggest(Recording(bag))
    assert (suggestion.used, suggestion.pace.name) == ([], '/cmd_vel')
    reasons = aside(suggestion)
    assert reasons['commanded_speed'].startswith('constant at 0')
    assert {topic.name: reason for topic, reason in suggestion.unused} == {
        '/odom': 'it has 1 message, fewer than 10'
    }
    code, out, err = run_occ(f'features suggest {bag} -o {tmp_path}/map.yaml')
    assert (code, out) == (1, f'0 features; written to {tmp_path}/map.yaml\n')
    assert 'no feature can be used as it is' in err
    text = (tmp_path / 'map.yaml').read_text()
    assert 'features: []' in text
    code, _, err = run_occ(f'features check {bag} {tmp_path}/map.yaml')
    assert code == 2
    assert 'features: the map has no feature, so nothing could be judged; add one' in err
    # What a comment holds can be used all the same.
    entry = '  - {name: speed, topic: cmd_vel, field: linear.x, unit: m/s}'
    (tmp_path / 'map.yaml').write_text(text.replace('features: []', f'features:\n{entry}'))
    code, out, _ = run_occ(f'features check {bag} {tmp_path}/map.yaml')
    assert 'speed' in out


def test_arrays_that_are_too_short_now_and_then(tmp_path):
    """Elements that some messages lack are set aside with the reason, seen or not in the sample."""
    for rare in ({3003}, {7, 3003}, {step for step in range(5000) if step % 9 == 0}):
        messages = (
            (step / 50, '/motors', motors(2 if step in rare else 4, step)) for step in range(5000)
        )
        suggestion = suggest(Recording(write_messages(tmp_path / f'{len(rare)}.mcap', messages)))
        assert [item.entry['field'] for item in suggestion.used] == ['data[0]', 'data[1]']
        reasons = aside(suggestion)
        assert reasons.keys() >= {'motors_2', 'motors_3'}
        for name in ('motors_2', 'motors_3'):
            assert 'not every message has it' in reasons[name] or 'but data has 2' in reasons[name]


def motors(count, step):
    values = np.sin(np.arange(count) + step / 20).astype(np.float32)
    return make('std_msgs/Float32MultiArray', data=values)


def test_only_offsets(messages, write_bag):
    """A map of which nothing is left, as all features differ by an offset, is written as well."""
    bags = [
        Recording(
            write_bag(
                [
                    (
                        '/height',
                        messages.types['std_msgs/msg/Float64'](ground + math.sin(step / 9)),
                        START + step * TENTH,
                    )
                    for step in range(100)
                ],
                name,
            )
        )
        for name, ground in (('one', 20.0), ('two', 60.0))
    ]
    suggestion = suggest(*bags)
    assert (suggestion.used, suggestion.seen.rows, suggestion.pace.name) == ([], 0, '/height')
    assert 'offset' in aside(suggestion)['height']


def test_inspection(messages, write_bag):
    entries = drive(messages, jump=30)
    topics = inspect_topics(Recording(write_bag(entries)))
    odometry = topics['/odom']
    assert (odometry.count, odometry.is_stamped, odometry.jumps) == (60, True, 1)
    assert odometry.rate == pytest.approx(10.0)
    assert odometry.series['twist.twist.angular.z'].values.tolist() == [0.3] * 60
    assert not topics['/cmd_vel'].is_stamped
    scan = topics['/scan'].scan
    assert (scan.least_beams, scan.first, scan.last) == (36, 0.0, pytest.approx(350.0, abs=1e-4))
    assert (scan.counts / 60).tolist() == [1, 23, 0, 0, 36]


def test_how_far_the_measured_is_from_the_commanded(messages, write_bag):
    """Where commands are there from the start, and always."""
    entries = drive(messages, steps=300)
    suggestion, _, feature_map = found(write_bag, entries)
    (error,) = [item for item in feature_map.features if item.name == 'speed_error']
    assert (error.topic, error.minus.topic, error.minus.field) == ('odom', 'cmd_vel', 'linear.x')
    assert 'commanded_speed' in aside(suggestion)


def test_several_recordings_are_used_together(messages, write_bag):
    """What differs by an offset only is set aside; what one of them shows alone is told."""

    def flight(name, ground, top):
        entries = []
        for step in range(100):
            now = START + step * TENTH
            height = ground + math.sin(step / 9)
            entries.append(('/height', messages.types['std_msgs/msg/Float64'](height), now))
            speed = top * math.sin(step / 11)
            entries.append(('/odom', messages.odometry(stamp_ns=now, x=speed), now + 1))
        return Recording(write_bag(entries, name))

    first, second = flight('one', 20.0, 1.0), flight('two', 60.0, 3.0)
    assert 'height' in [item.entry['name'] for item in suggest(first).used]
    suggestion = suggest(first, second)
    assert 'it differs by an offset only' in aside(suggestion)['height']
    (told,) = [text for text in suggestion.warnings if 'speed lies outside' in text]
    assert told.endswith('learn from both, or leave it out')
    assert suggestion.name == 'one, two'
    assert 'one, two: 200 rows in 19.8 s' in suggestion_text(suggestion)
    assert suggestion.seen.rows == 200

    third = flight('three', 20.0, 2.0)
    (told,) = [text for text in suggest(first, third, second).warnings if 'speed lies' in text]
    assert 'of the rows of two (-3 to 3), and for no more of another recording' in told
    assert told.endswith('learn from all, or leave it out')


def test_a_topic_that_only_one_recording_has(messages, write_bag):
    entries = drive(messages)
    without = [entry for entry in entries if entry[0] != '/odom']
    recordings = Recording(write_bag(entries, 'a')), Recording(write_bag(without, 'b'))
    unused = {topic.name: reason for topic, reason in suggest(*recordings).unused}
    assert unused == {'/odom': 'it is not in b'}


def test_arrays_that_are_sometimes_shorter(messages, write_bag):
    """Elements by number have to be there always; those by name need not."""
    kind = messages.types['sensor_msgs/msg/JointState']
    entries = []
    for step in range(60):
        now, value = START + step * TENTH, math.sin(step / 7)
        count = 2 if step % 3 else 1
        numbers = np.full(count, value)
        bare = kind(messages.header(now), [], numbers, numbers, numbers)
        named = kind(messages.header(now), ['hip', 'knee'][:count], numbers, numbers, numbers)
        entries += [('/bare', bare, now), ('/named', named, now + 1)]
    suggestion, _, feature_map = found(write_bag, entries)
    fields = {item.field for item in feature_map.features if 'position' in item.name}
    assert fields == {'position[0]', 'position[name=hip]', 'position[name=knee]'}
    assert suggestion.seen.usable > 0.95


def test_never_two_robots_in_one_map(messages, write_bag, run_occ, tmp_path):
    entries = [
        (f'/robot{number}{topic}', message, time)
        for number in (1, 2)
        for topic, message, time in drive(messages)
    ]
    entries += [('/battery', messages.odometry(stamp_ns=time), time) for _, _, time in entries[:30]]
    bag = write_bag(sorted(entries, key=lambda entry: entry[2]))
    first, second = suggest_each(Recording(bag))
    assert (first.robot, second.robot) == ('robot1', 'robot2')
    for item in (first, second):
        assert {part.topic.name.split('/')[1] for part in item.candidates} == {item.robot}
        assert [reason for _, reason in item.unused] == ['it is in the namespace of no robot']
    code, out, _ = run_occ(f'features suggest {bag} -o {tmp_path}/map.yaml')
    assert code == 0
    assert [line.split()[-1] for line in out.splitlines()] == [
        f'{tmp_path}/map_robot1.yaml',
        f'{tmp_path}/map_robot2.yaml',
    ]
    _, out, err = run_occ(f'features suggest {bag}')
    assert 'there are 2 robots, robot1, robot2; the map shown is of robot1' in err
    assert 'pace: robot1/scan' in out
    _, out, _ = run_occ(f'features suggest {bag} --robot robot2')
    assert 'pace: robot2/scan' in out
    code, _, err = run_occ(f'features suggest {bag} --robot robot3')
    assert (code, 'its robots are robot1, robot2' in err) == (2, True)


@pytest.mark.parametrize(
    'spaces', [('left', 'right'), ('front_lidar', 'rear_lidar'), ('camera1', 'camera2')]
)
def test_parts_of_one_robot_are_no_robots(messages, write_bag, spaces):
    entries = [
        (f'/{space}{topic}', message, time)
        for space in spaces
        for topic, message, time in drive(messages)
    ]
    bag = write_bag(sorted(entries, key=lambda entry: entry[2]))
    assert [item.robot for item in suggest_each(Recording(bag))] == ['']


@pytest.mark.parametrize(
    ('bag', 'expected'),
    [
        ('safe_tb3_abhishek', {'speed', 'turn_rate', 'clearance_front', 'acceleration_x'}),
        ('safe_neato_junpark_teleop', {'speed', 'turn_rate', 'clearance_rear', 'bump_left_front'}),
        ('close_epuck_webots_aakash', {'speed', 'turn_rate', 'range_tof'}),
    ],
)
def test_real_robots(robots, bag, expected):
    suggestion = suggest(Recording(robots / bag))
    text = suggestion_text(suggestion)
    feature_map = FeatureMap.from_document(parse_yaml(text, bag), bag, text=text)
    assert expected <= set(feature_map.names)
    assert suggestion.seen.usable > 0.95


def test_numbers_in_the_texts_of_diagnostics(tmp_path):
    """Each by its name and key, if the key tells what it is; nodes may publish in turn."""

    def values(**texts):
        return [
            make('diagnostic_msgs/KeyValue', key=key, value=text) for key, text in texts.items()
        ]

    def messages():
        for step in range(200):
            for part, name in enumerate(('motor left', 'lidar')):
                own = values(Temperature=f'{40 + step % 7} C', mode='AUTO', packets=str(step % 9))
                status = make('diagnostic_msgs/DiagnosticStatus', name=name, values=own)
                array = make('diagnostic_msgs/DiagnosticArray', status=[status])
                yield step + part / 2, '/diagnostics', array

    suggestion = suggest(Recording(write_messages(tmp_path / 'agv.mcap', messages())))
    fields = {item.entry['name']: item.entry['field'] for item in suggestion.used}
    assert fields['motor_left_temperature'] == (
        'status[name=motor left].values[key=Temperature].value'
    )
    assert fields.keys() == {'motor_left_temperature', 'lidar_temperature'}
    assert suggestion.seen.usable > 0.99
    assert aside(suggestion)['lidar_packets'] == 'its key does not tell what it is'


def test_altitude_by_satellite(tmp_path):
    """Of what stays on the ground it is no feature, whatever the message; of what flies it is."""
    for span, is_used in ((3.0, False), (60.0, True)):
        fixes = (
            (
                step / 5,
                '/fix',
                make(
                    'sensor_msgs/NavSatFix',
                    latitude=47.0 + 1e-5 * math.sin(step / 7),
                    altitude=430.0 + span / 2 * math.sin(step / 9),
                ),
            )
            for step in range(300)
        )
        suggestion = suggest(Recording(write_messages(tmp_path / f'{span}.mcap', fixes)))
        assert ('altitude' in [item.entry['name'] for item in suggestion.used]) is is_used


def test_the_imu_of_the_body_is_used(tmp_path):
    messages = (
        item
        for number, part in enumerate(('head', 'pelvis', 'left_foot'))
        for item in imus(Drive(number, '', 20.0), f'/{part}/imu')
    )
    suggestion = suggest(Recording(write_messages(tmp_path / 'imus.mcap', messages)))
    assert {item.topic.name for item in suggestion.used} == {'/pelvis/imu'}


def test_what_the_dynamics_of_a_joint_tie_together_is_kept_apart(tmp_path):
    (feature_map,) = suggested_maps(write_robot(tmp_path, 'ground', 1, seconds=30.0))
    assert feature_map.apart == (('speed', 'speed_error'), ('turn_rate', 'turn_rate_error'))


def test_standing_still_is_allowed(messages, write_bag):
    """Also where the robot never did; driving backwards is not, where it was seen to stand."""
    for least, rules_below in ((0.0, True), (0.5, False)):
        entries = []
        for step in range(400):
            now, speed = START + step * TENTH, least + 0.5 + 0.5 * math.sin(step / 5)
            entries.append(('/odom', messages.odometry(stamp_ns=now, x=speed), now))
        _, text, feature_map = found(write_bag, entries, f'bag{least}')
        has_clip = any(step[0] == 'clip' for step in feature_map.features[0].transform)
        assert has_clip is not rules_below
        assert ('it never stood still here' in text.replace('\n# ', ' ').lower()) is has_clip
