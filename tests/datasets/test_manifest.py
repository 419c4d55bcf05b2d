# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from occ_constraints_pkg.cli import main
from occ_constraints_pkg.datasets.extraction import extract
from occ_constraints_pkg.datasets.manifest import Selection, load_manifest, select
from occ_constraints_pkg.demonstrations.learning import learn_from_files
from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.features.feature_map import FeatureMap, FeatureSource
from occ_constraints_pkg.learning.settings import OCTreeSettings
from occ_constraints_pkg.rosbag.recording import Recording

SECOND = 10**9
MAP = FeatureMap('cmd_vel', 0.5, (FeatureSource('v', 'cmd_vel', 'linear.x'),))
TEXT = """\
schema_version: 1
recordings:
- path: drive
  include: [[0, 4], [6, null]]
  exclude: [[1, 2.5]]
  episodes: [8, 9.5]
  note: the bump at 1 s is left out
- path: other
"""


@pytest.fixture
def drives(messages, write_entries, tmp_path):
    """Return the folder of two recordings of twelve seconds; v is the second."""
    for name, start in (('drive', 100), ('other', 500)):
        entries = [
            ('/cmd_vel', messages.twist(x=tick / 2), start * SECOND + tick * SECOND // 2)
            for tick in range(24)
        ]
        write_entries(tmp_path / name, entries)
    return tmp_path


def manifest(folder, text=TEXT):
    (folder / 'drives.yaml').write_text(text)
    return folder / 'drives.yaml'


def test_intervals_and_episodes(drives):
    data = extract([manifest(drives)], MAP)
    values, episodes = data.values[:, 0], data.episodes
    first = values[episodes < episodes[-1]].tolist()
    assert first == [0, 0.5, 2.5, 3, 3.5, 6, 6.5, 7, 7.5, 8, 8.5, 9, 9.5, 10, 10.5, 11, 11.5]
    assert [values[episodes == number].min() for number in range(6)] == [0, 2.5, 6, 8, 9.5, 0]
    assert values[episodes == 5].tolist() == [tick / 2 for tick in range(24)]
    assert data.sources[0] == Recording(drives / 'drive').fingerprint() | {
        'include': [[0.0, 4.0], [6.0, None]],
        'exclude': [[1.0, 2.5]],
        'episodes': [8.0, 9.5],
    }
    assert data.sources[1] == Recording(drives / 'other').fingerprint()


def test_a_manifest_beside_recordings(drives):
    text = 'schema_version: 1\nrecordings: [{path: drive, include: [[0, 1]]}]\n'
    data = extract([drives / 'other', manifest(drives, text)], MAP)
    assert data.values[:, 0].tolist() == [*(tick / 2 for tick in range(24)), 0.0, 0.5]
    assert set(data.episodes) == {0, 1}


def test_tables_and_their_episodes(messages, write_entries, tmp_path):
    entries = [
        (
            '/observation',
            messages.table(
                ['x', 'episode'], [[step, step // 4 + 0.0], [step, 0]], stamp_ns=step + 1
            ),
            step * SECOND,
        )
        for step in range(8)
    ]
    write_entries(tmp_path / 'run', entries)
    text = 'schema_version: 1\nrecordings: [{path: run, exclude: [[6, 7]]}]\n'
    wanted = FeatureMap('observation', 1.0, (FeatureSource('x', 'observation', column='x'),))
    data = extract([manifest(tmp_path, text)], wanted)
    assert data.values[data.episodes == 0].ravel().tolist() == [0, 1, 2, 3]
    rows = [sorted(data.values[data.episodes == number, 0]) for number in range(5)]
    assert rows == [[0, 1, 2, 3], [4, 5], [7], [0, 1, 2, 3, 4, 5], [7]]


def test_every_command_takes_it(drives, capsys):
    path = str(manifest(drives))
    (drives / 'map.yaml').write_text(
        'schema_version: 1\npace: cmd_vel\nmax_age: 1\n'
        'features: [{name: v, topic: cmd_vel, field: linear.x, unit: m/s}]\n'
    )
    rules = str(drives / 'rules.yaml')
    assert main(['learn', path, '-m', str(drives / 'map.yaml'), '-o', rules]) == 0
    assert 'exclude:' in (drives / 'rules.yaml').read_text()
    assert main(['check', path, '-c', rules]) in (0, 1)
    assert '41 samples' in capsys.readouterr().out
    assert main(['score', rules, path]) == 2
    assert 'no true cost' in capsys.readouterr().err


def test_learning_notes_what_was_left_out(drives):
    constraints = learn_from_files(
        [manifest(drives)], MAP, OCTreeSettings(), rng=np.random.default_rng(0)
    )
    assert constraints.provenance['bags'][0]['exclude'] == [[1.0, 2.5]]


@pytest.mark.parametrize(
    ('old', 'new', 'sentence'),
    [
        ('[1, 2.5]', '[2.5, 1]', 'recordings[0].exclude[0]: got [2.5, 1]; allowed is an end after'),
        ('[1, 2.5]', '[1, a]', "line 5: recordings[0].exclude[0][1]: got 'a'; allowed is a number"),
        ('[1, 2.5]', '[1]', 'exclude[0]: got [1]; allowed is a list no shorter than 2'),
        ('[8, 9.5]', '[-1]', 'line 6: recordings[0].episodes[0]: got -1; allowed is a number of'),
        ('[8, 9.5]', '[.nan]', 'recordings[0]: got nan for a time; allowed are seconds'),
        ('[8, 9.5]', '[.inf]', 'episodes[0]: got inf; allowed is'),
        ('note', 'nota', "line 7: recordings[0].nota: unknown key; did you mean 'note'?"),
        ('path: other', 'path: a.csv', "recordings[1].path: got 'a.csv'; allowed are rosbag2"),
        ('path: other', 'path: drives.yaml', 'allowed are rosbag2 directories'),
        ('- path: other', '- {}', "recordings[1]: the key 'path' is missing"),
        ('schema_version: 1', 'schema_version: 2', 'line 1: schema_version: got 2; allowed is 1'),
        ('recordings:', 'recordings: [', 'is not valid YAML'),
    ],
)
def test_one_sentence_for_each_mistake(tmp_path, old, new, sentence):
    path = manifest(tmp_path, TEXT.replace(old, new, 1))
    with pytest.raises(OccError) as caught:
        load_manifest(path)
    assert str(caught.value).startswith(str(path))
    assert sentence in str(caught.value)
    assert '\n' not in str(caught.value)


def test_mistakes_that_show_with_the_recordings(drives):
    with pytest.raises(OccError, match='give its directory instead'):
        select([drives / 'drive' / 'metadata.yaml'])
    with pytest.raises(OccError, match='there is no recording at .*nothing'):
        extract([manifest(drives, TEXT.replace('other', 'nothing'))], MAP)
    late = 'schema_version: 1\nrecordings: [{path: drive, include: [[20, 30]]}]\n'
    with pytest.raises(OccError, match=r"on '/cmd_vel', which sets the pace, in the intervals to"):
        extract([manifest(drives, late)], MAP)
    some = late.replace('[[20, 30]]', '[[0, 1], [20, 30]]')
    (warning,) = extract([manifest(drives, some)], MAP).warnings
    assert 'no row lies in the interval [20.0, 30.0] s, which the manifest includes' in warning
    useless = late.replace('include: [[20,', 'episodes: [5, 40], exclude: [[1, 2], [20,')
    exclude, episode = extract([manifest(drives, useless)], MAP).warnings
    assert 'no row lies in the interval [20.0, 30.0] s, which the manifest excludes' in exclude
    assert 'the last row is at 11.5 s, before the episode that the manifest begins at 40' in episode


interval = st.tuples(st.integers(0, 20), st.integers(1, 9)).map(lambda p: (p[0], p[0] + p[1]))


@given(st.lists(interval, max_size=3), st.lists(interval, max_size=3), st.lists(st.integers(0, 25)))
def test_stretches(include, exclude, episodes):
    selection = Selection('bag', tuple(include), tuple(exclude), tuple(episodes))
    times = np.arange(30)
    numbers = selection.stretches(times)
    used = [
        (not include or any(a <= t < b for a, b in include))
        and not any(a <= t < b for a, b in exclude)
        for t in times
    ]
    assert (numbers >= 0).tolist() == used
    # A new number begins after each gap and at each episode, and nowhere else.
    for before, after in zip(times, times[1:], strict=False):
        if used[before] and used[after]:
            assert (numbers[after] != numbers[before]) == (after in episodes)
    seen = numbers[numbers >= 0]
    assert (np.diff(seen) >= 0).all()
    for gap in np.flatnonzero(numbers < 0):
        earlier, later = numbers[:gap], numbers[gap:]
        assert not set(earlier[earlier >= 0]) & set(later[later >= 0])
