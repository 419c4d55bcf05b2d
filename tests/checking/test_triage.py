# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Which recordings stand out, on drives with known faults."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from occ_constraints_pkg.checking.peaks import peak_space, peaks_of
from occ_constraints_pkg.checking.triage import Unit, triage
from occ_constraints_pkg.checking.unchanged import (
    unchanged_for,
    unchanged_space,
    with_raw_values,
)
from occ_constraints_pkg.datasets.dataset import ORIGIN, Dataset
from occ_constraints_pkg.datasets.extraction import extract
from occ_constraints_pkg.errors import DataError
from occ_constraints_pkg.features.feature_map import load_feature_map
from occ_constraints_pkg.learning.conditional import ConditionalSettings
from occ_constraints_pkg.rules import Feature, FeatureSpace
from synthetic_bags import ROVER_MAP, write_rover

SPACE = FeatureSpace(
    (Feature('speed', 'm/s'), Feature('turn', 'rad/s'), Feature('range', 'm', low=0.0))
)
PLAIN = ConditionalSettings('none')


def drive(seed, fault='', count=150):
    """Return 30 s of a smooth drive; its fault begins in the middle."""
    rng = np.random.default_rng(seed)
    at = np.arange(count) * 0.2
    phases = rng.uniform(0, 2 * np.pi, 3)
    values = np.stack(
        [
            0.3 + 0.2 * np.sin(0.6 * at + phases[0]),
            0.8 * np.sin(0.4 * at + phases[1]),
            1.5 + np.sin(0.3 * at + phases[2]),
        ],
        axis=1,
    )
    values += rng.normal(0, 0.01, values.shape)
    half = slice(count // 2, count // 2 + 25)
    if fault == 'fast':
        values[half, 0] += 0.5
    elif fault == 'close':
        values[half, 2] = 0.1
    elif fault == 'stuck':
        values[half] = values[count // 2]
    elif fault == 'offset':
        values[:, 1] += 0.6
    elif fault == 'spike':
        values[count // 2, 1] = 5.0
    elif fault == 'lost':
        values[half, 2] = np.nan
    ns = np.round(at * 1e9).astype(np.int64)
    origins = np.zeros(count, dtype=ORIGIN)
    origins['time_ns'] = ns + 10**18
    return Dataset(
        SPACE.names, values, ns, np.zeros(count, dtype=np.int64), times_ns=ns,
        origins=origins, recordings=np.zeros(count, dtype=np.int64), sources=({'name': 'd'},),
    )  # fmt: skip


def unit(name, data):
    return Unit(name, name, data, unchanged_for(data, SPACE), np.empty((len(data), 0)))


def rank(units, **options):
    options = {'rng': np.random.default_rng(0), **options}
    return triage(units, SPACE, PLAIN, **options)


FAULTS = ('fast', 'close', 'stuck', 'offset', 'spike', 'lost')


def test_planted_faults_come_first_with_their_rule_and_moment():
    faults = {10 * place: FAULTS[place % 6] for place in range(1, 7)}
    units = [unit(f'd{seed}', drive(seed, faults.get(seed, ''))) for seed in range(80)]
    result = rank(units)
    first = result.ranked[:6]
    assert {item.name for item in first} == {f'd{seed}' for seed in faults}
    assert all(item.stands_out and item.is_suspect for item in first)
    assert sum(item.stands_out for item in result.ranked) <= 8
    told = {faults[int(item.name[1:])]: item for item in first}
    for fault, words in {
        'fast': 'speed above',
        'close': 'range below',
        'stuck': '_unchanged above',
        'offset': 'turn above',
        'spike': 'turn above',
    }.items():
        assert words in told[fault].rule_words
    assert told['spike'].moment == pytest.approx(15.0)
    assert told['spike'].log_time_ns == 10**18 + 15 * 10**9
    assert told['spike'].values == {'turn': 5.0}
    assert told['spike'].violated == pytest.approx(0.2)
    assert told['lost'].rule is None
    assert told['lost'].unknown == pytest.approx(5.0)
    assert [event.words for event in told['lost'].events] == ['UNKNOWN']
    excerpt = told['close'].excerpt
    assert (excerpt.name, excerpt.unit, excerpt.values.min()) == ('range', 'm', 0.1)


def test_two_that_are_bad_in_the_same_way_do_not_hide_each_other():
    bad = {3, 17, 44}
    units = [unit(f'd{seed}', drive(seed, 'close' if seed in bad else '')) for seed in range(60)]
    assert {item.name for item in rank(units).ranked[:3]} == {f'd{seed}' for seed in bad}


def test_a_few_recordings_are_judged_one_by_one():
    units = [unit(f'd{seed}', drive(seed, 'fast' if seed == 2 else '')) for seed in range(8)]
    assert rank(units).ranked[0].name == 'd2'
    with pytest.raises(DataError, match='allowed are 3 or more'):
        rank(units[:2])


def test_processes_change_nothing():
    units = [unit(f'd{seed}', drive(seed, 'fast' if seed == 2 else '')) for seed in range(24)]
    one, two = (
        triage(units, SPACE, ConditionalSettings(), processes=count, rng=np.random.default_rng(0))
        for count in (1, 2)
    )
    assert [(item.name, item.score) for item in one.ranked] == [
        (item.name, item.score) for item in two.ranked
    ]


@settings(max_examples=10)
@given(st.permutations(range(24)), st.floats(0.01, 100.0))
def test_neither_order_nor_units_matter_to_what_comes_first(order, factor):
    drives = [drive(seed, 'spike' if seed == 5 else '') for seed in range(24)]
    scaled = [
        Dataset(
            own.names, own.values * factor, own.stamps_ns, own.episodes, times_ns=own.times_ns,
            origins=own.origins, recordings=own.recordings, sources=own.sources,
        )
        for own in drives
    ]  # fmt: skip
    result = rank([unit(f'd{seed}', scaled[seed]) for seed in order])
    assert result.ranked[0].name == 'd5'


def test_recordings_of_one_kind_and_one_length_more_are_no_fault():
    # A value that never changes is the same for longer in a longer recording.
    units = []
    for seed in range(10):
        data = drive(seed, count=300 if seed == 4 else 150)
        data.values[:, 2] = 3.0
        units.append(unit(f'd{seed}', data))
    assert not any('unchanged' in item.rule_words for item in rank(units).ranked)


def test_unchanged_counts_the_time_since_a_value_was_another():
    data = drive(0, count=6)
    data.values[:, 0] = [1.0, 1.0, 1.0, 2.0, np.nan, np.nan]
    found = unchanged_for(data, SPACE)[:, 0]
    assert found == pytest.approx([0.0, 0.2, 0.4, 0.0, 0.0, 0.0])
    assert unchanged_space(SPACE, 's').names[0] == 'speed_unchanged'


def test_a_rounded_value_is_the_same_only_if_the_sensor_says_so(tmp_path):
    (tmp_path / 'map.yaml').write_text(
        ROVER_MAP.replace(
            'field: twist.twist.linear.x, unit: m/s}',
            'field: twist.twist.linear.x, unit: m/s, transform: [{round: 5}]}',
        )
    )
    feature_map = load_feature_map(tmp_path / 'map.yaml')
    raw = with_raw_values(feature_map)
    assert raw.names[-1] == 'v before rounding'
    data = extract([write_rover(tmp_path / 'drive')], raw)
    own = data.values[:, 0]
    assert (own[np.isfinite(own)] == 0.0).all()
    # Odometry pauses for a second, and what it said stays for as long as it may.
    assert unchanged_for(data, feature_map.space)[:, 0].max() < 1.0


def test_a_spike_between_two_rows_is_a_peak(tmp_path):
    (tmp_path / 'map.yaml').write_text(ROVER_MAP)
    feature_map = load_feature_map(tmp_path / 'map.yaml')
    space = peak_space(feature_map)
    # The scan makes the rows; rates and differences of two topics have no peaks.
    assert space.names[:4] == ('v_peak', 'w_peak', 'yaw_peak', 'command_peak')
    source = write_rover(tmp_path / 'drive')
    data = extract([source], feature_map)
    peaks = peaks_of(source, data, feature_map)
    rows = np.isfinite(data.values[:, 0])
    assert peaks.shape == (len(data), len(space))
    assert (peaks[rows, 0] >= data.values[rows, 0]).all()
    assert (peaks[rows, 4] <= data.values[rows, 0]).all()
    assert (peaks[rows, 0] > data.values[rows, 0]).any()
