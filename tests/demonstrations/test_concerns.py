# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""What learning says of doubtful demonstrations, and that repeated recordings count once."""

import json
import shutil

import numpy as np
import pytest
from occ_constraints_pkg.rules.constraints_file import load_constraints
from synthetic_bags import write_drive


@pytest.fixture
def table(tmp_path, monkeypatch):
    """Return a function that writes a table of that many rows and episodes."""
    monkeypatch.chdir(tmp_path)

    def write(name='t.npz', rows=400, episodes=10, names=('a', 'b'), **columns):
        values = np.random.default_rng(0).uniform(size=(rows, len(names)))
        episode = np.arange(rows) * episodes // rows
        np.savez(name, **{'features': values, 'names': names, 'episode': episode, **columns})
        return name

    return write


@pytest.fixture
def learn(run_occ):
    """Return a function that learns: the warnings, the same on stderr and in JSON."""

    def run(line):
        code, out, err = run_occ(f'learn {line} -o rules.yaml --overwrite --json')
        assert code == 0, err
        result = json.loads(out)
        assert err == ''.join(f'warning: {sentence}\n' for sentence in result['warnings'])
        return result

    return run


def test_nothing_is_said_of_good_data(table, learn):
    assert learn(table())['warnings'] == []
    assert learn(f'{table()} --contamination 0')['warnings'] == []
    assert learn(table(cost=np.zeros(400)))['warnings'] == []


def test_costs_above_zero_are_told_with_their_number(table, learn):
    cost = np.zeros(400)
    cost[:37] = 0.5
    cost[-1] = np.nan
    (sentence,) = learn(table(cost=cost))['warnings']
    assert sentence.startswith('37 of 400 samples (9.25%) have a cost above 0')
    assert 'contamination of at least 0.093' in sentence
    assert learn(f'{table(cost=cost)} --contamination 0.093')['warnings'] == []
    (sentence,) = learn(f'{table(cost=cost)} --contamination 0.05')['warnings']
    assert '(stated is 0.05)' in sentence
    (sentence,) = learn(f'{table(cost=cost)} --clip density')['warnings']
    assert 'contamination' not in sentence


def test_a_stated_share_below_what_the_data_show_is_told(table, learn):
    values = np.random.default_rng(0).uniform(size=(1000, 2))
    values[::50] = values[::50] * 40.0 + 10.0
    name = table(rows=1000, features=values)
    assert learn(name)['warnings'] == []
    (sentence,) = learn(f'{name} --contamination 0.001')['warnings']
    assert 'the stated contamination is 0.001' in sentence


def test_few_samples_and_few_episodes_are_told(table, learn):
    texts = learn(table(rows=1, episodes=1))['warnings']
    assert [text.partition(';')[0] for text in texts] == [
        'there is 1 usable sample',
        'there is 1 episode',
    ]
    texts = learn(table(rows=99, episodes=4))['warnings']
    assert [text.partition(';')[0] for text in texts] == [
        'there are 99 usable samples',
        'there are 4 episodes',
    ]
    assert learn(table(rows=100, episodes=5))['warnings'] == []


def test_columns_that_look_like_a_family_are_taken_for_one(table, learn):
    names = [f'd_l{number}' for number in range(10)]
    result = learn(table(names=names))
    (sentence,) = result['warnings']
    assert sentence.startswith("the 10 columns d_l0 ... d_l9 are taken for a family, 'd_l'")
    assert '--no-families' in sentence
    assert families_in('rules.yaml') == ['d_l'] * 10
    assert learn(f'{table(names=names)} --no-families')['warnings'] == []
    assert families_in('rules.yaml') == [''] * 10
    assert learn(table(names=names, families=['scan'] * 10))['warnings'] == []
    assert learn(f'{table(names=names)} --clip density')['warnings'] == []
    assert learn(table(names=['x1', 'x2', 'y1', 'y2']))['warnings'] == []
    units = ['m', 'rad', 's', 'V']
    assert learn(table(names=['d1', 'd2', 'd3', 'd4'], units=units))['warnings'] == []


def families_in(file):
    return [feature.family for feature in load_constraints(file).space.features]


def test_names_that_say_nothing_and_feature_maps_make_no_family(table, learn, tmp_path):
    names = [f'x{number}' for number in range(5)]
    (sentence,) = learn(table(names=names))['warnings']
    assert sentence.startswith('the 5 features x0 ... x4 look like one measurement')
    assert families_in('rules.yaml') == [''] * 5
    assert learn(f'{table(names=names)} --no-families')['warnings'] == []
    names = [f'd_l{number}' for number in range(5)]
    features = ''.join(f'- {{name: {name}, topic: t, field: {name}, unit: m}}\n' for name in names)
    (tmp_path / 'map.yaml').write_text(
        f'schema_version: 1\npace: t\nmax_age: 1\nfeatures:\n{features}'
    )
    (sentence,) = learn(f'{table(names=names)} -m map.yaml')['warnings']
    assert sentence.startswith('the 5 features d_l0 ... d_l4 look like one measurement')
    assert families_in('rules.yaml') == [''] * 5


def test_a_table_that_describes_nothing_is_told_what_it_lacks(table, learn, run_occ):
    values = np.random.default_rng(0).uniform(size=(400, 3))
    np.savez('bare.npz', features=values, episode=np.arange(400) // 40)
    (sentence,) = learn('bare.npz')['warnings']
    assert sentence.startswith('bare.npz does not describe its features, here called x0 ... x2')
    assert all(f"'{array}':" in sentence for array in ('names', 'bounds', 'families'))
    # To check is not to learn.
    _, _, err = run_occ('check bare.npz -c rules.yaml')
    assert err == ''


def test_the_same_families_are_taken_for_every_depth(table, run_occ):
    name = table(names=[f'd_l{number}' for number in range(6)], cost=np.zeros(400))
    for option, taken in (('', True), (' --no-families', False)):
        code, _, err = run_occ(f'learn {name} --compare-depths -o out{option}')
        assert code == 0
        assert ('are taken for a family' in err) is taken


def test_a_recording_given_twice_counts_once(tmp_path, monkeypatch, learn):
    monkeypatch.chdir(tmp_path)
    write_drive(tmp_path / 'one')
    write_drive(tmp_path / 'other', driver='straight', robots=5, steps=60)
    shutil.copytree('one', 'copy')
    (tmp_path / 'link').symlink_to('one')
    alone = learn('one -m simple_nav')
    assert alone['warnings'] == []
    for twice in ('one one', 'one/ ./one', 'one copy', 'one link', 'copy one copy'):
        result = learn(f'{twice} -m simple_nav')
        times = len(twice.split()) - 1
        assert [('left out' in text) for text in result['warnings']] == [True] * times
        assert {**result, 'warnings': []} == alone
    both = learn('one other -m simple_nav')
    again = learn('one other one -m simple_nav')
    assert {**again, 'warnings': []} == {**both, 'warnings': []}


def test_of_two_stretches_of_a_recording_the_common_rows_count_once(tmp_path, monkeypatch, learn):
    monkeypatch.chdir(tmp_path)
    write_drive(tmp_path / 'one')
    total = sum(learn('one -m simple_nav')[f'{part}_samples'] for part in ('training', 'held_out'))
    stretches = '- {path: one, include: [[0, 2]]}\n- {path: one, include: [[1, null]]}\n'
    (tmp_path / 'parts.yaml').write_text(f'schema_version: 1\nrecordings:\n{stretches}')
    result = learn('parts.yaml -m simple_nav')
    assert sum(result[f'{part}_samples'] for part in ('training', 'held_out')) == total
    assert 'repeated rows are left out' in result['warnings'][0]


def test_a_table_given_twice_counts_once(table, learn, tmp_path):
    name = table()
    alone = learn(name)
    shutil.copy(name, 'again.npz')
    result = learn(f'{name} again.npz')
    assert result['warnings'] == [
        'again.npz has the content of t.npz; its 400 repeated rows are left out'
    ]
    assert {**result, 'warnings': []} == alone


def test_nothing_is_calibrated_on_that_was_learned_from(table, learn, run_occ):
    name = table(episodes=40)
    code, _, err = run_occ(f'learn {name} --false-alarm 0.1 --calibrate-on {name} -o x.yaml')
    assert code == 2
    assert 'all of it is learned from' in err


@pytest.mark.parametrize(
    ('episodes', 'given'),
    [
        (1, 'of the 1 episode given none can be held out'),
        (4, 'of the 4 episodes given none can be held out'),
        (10, 'of the 10 episodes given 5 can be held out'),
    ],
)
def test_too_few_episodes_for_a_promise_are_counted_rightly(table, run_occ, episodes, given):
    code, _, err = run_occ(f'learn {table(episodes=episodes)} --false-alarm 0.05 -o x.yaml')
    assert code == 2
    assert 'needs 19 safe episodes to calibrate on' in err
    assert given in err
    assert 'allowed are 38 or more' in err
    if episodes == 10:
        assert 'a false_alarm of 0.1667 or more' in err
        assert run_occ(f'learn {table(episodes=10)} --false-alarm 0.1667 -o x.yaml')[0] == 0
    assert run_occ(f'learn {table(episodes=38)} --false-alarm 0.05 -o x.yaml')[0] == 0


def careless(share, episodes, bad_episodes, rows=20_000):
    """Sectors of one who keeps 0.2 m away, but for a share of the rows, in some episodes."""
    rng = np.random.default_rng(0)
    episode = np.arange(rows) * episodes // rows
    distance = np.sqrt(rng.random(rows)) * 0.9
    distance = np.where(distance < 0.2, rng.uniform(0.2, 0.3, rows), distance)
    candidates = np.flatnonzero(episode < bad_episodes)
    bad = rng.choice(candidates, int(share * rows), replace=False)
    distance[bad] = 0.2 * np.sqrt(rng.random(len(bad)))
    sectors = np.zeros((rows, 8))
    sectors[np.arange(rows), rng.integers(0, 8, rows)] = 1.0 - distance / 3.0
    return {
        'features': sectors,
        'names': [f'd{sector}' for sector in range(8)],
        'families': ['lidar'] * 8,
        'bounds': [[0.0, 1.0]] * 8,
        'episode': episode,
    }


def test_bad_samples_are_told_with_their_share_their_bound_and_their_episodes(table, learn):
    assert learn(table(**careless(0.0, 40, 40)))['warnings'] == []
    assert learn(table(**careless(0.01, 40, 40)))['warnings'] == []
    (sentence,) = learn(table(**careless(0.1, 40, 40)))['warnings']
    assert sentence.startswith('10.3% of the samples are above 0.93')
    assert "family 'lidar', evenly down to contact" in sentence
    assert 'better left out' not in sentence
    (sentence,) = learn(table(**careless(0.1, 40, 8)))['warnings']
    assert '7 of the 40 episodes have 75% of them, which are better left out' in sentence
    assert '(t.npz)' in sentence


def test_a_stated_share_that_is_too_small_is_told_with_the_one_that_would_do(table, learn):
    name = table(**careless(0.05, 40, 40))
    for stated in (0.01, 0.03, 0.045):
        (sentence,) = learn(f'{name} --contamination {stated}')['warnings']
        assert f'the stated contamination of {stated:g} is less' in sentence
        assert 'state at least 0.05' in sentence
    (sentence,) = learn(f'{name} --contamination 0.06')['warnings']
    assert 'within the stated contamination of 0.06' in sentence


def test_driving_along_walls_is_told_but_not_taken_for_bad(table, learn):
    columns = careless(0.0, 40, 40)
    along = np.random.default_rng(1).choice(20_000, 3000, replace=False)
    columns['features'][along, 0] = 1.0 - np.linspace(0.12, 0.19, 3000) / 3.0
    (sentence,) = learn(table(**columns))['warnings']
    assert 'where a demonstrator who ignores obstacles would be for 5% of the time' in sentence
    assert 'state a contamination of at least 0.138' in sentence
