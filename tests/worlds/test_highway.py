# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from occ_constraints_pkg.features.feature_map import load_feature_map
from occ_constraints_pkg.worlds.highway import Highway, RestrictedHighway
from occ_constraints_pkg.worlds.highway_features import FAR, NAMES, features
from occ_constraints_pkg.worlds.highway_scenarios import FULL, RESTRICTED, Scenario, scenario
from occ_constraints_pkg.worlds.highway_traffic import IDENTITY, LANE, LENGTH, Traffic, X, Y
from occ_constraints_pkg.worlds.stream import EpisodeStream


def scene(x, y, lanes=3, speed=25.0):
    x, y = np.array(x, dtype=float), np.array(y, dtype=float)
    n = len(x)
    lane = np.clip(np.ceil(y / 4 - 0.5), 0, lanes - 1).astype(int)
    return Scenario('t', lanes, x, y, lane, np.full(n, speed), np.full(n, 30.0), np.full(n, 4.0))


def start(given):
    traffic = Traffic(1, len(given.x))
    traffic.start(np.array([0]), [given])
    return traffic


def seen(traffic):
    return dict(zip(NAMES, features(traffic, traffic.ego, np.array([0]))[0], strict=True))


def test_the_first_columns_are_the_features_of_the_map():
    names = tuple(column.name for column in Highway.columns)
    assert names[:10] == NAMES == load_feature_map('highway').names
    assert Highway.max_episode_steps * Highway.step_seconds == pytest.approx(40.0)


def test_gaps_are_between_bumpers_by_lane_behind_and_ahead():
    others = [(60, 0), (150, 0), (80, 4), (130, 4), (40, 8), (700, 8)]
    known = seen(start(scene([100, *(x for x, _ in others)], [4, *(y for _, y in others)])))
    gaps = [known[f'p_rel{i}'] for i in range(6)]
    assert gaps == [35, 15, 55, 45, 25, 500]
    assert (known['v_x'], known['v_y']) == (25, 0)
    assert (known['d_left'], known['d_right']) == (6, 6)


def test_a_lane_that_is_not_there_is_empty_and_side_by_side_is_no_gap():
    known = seen(start(scene([100, 102, 98], [0, 4, 8], lanes=3)))
    assert known['p_rel0'] == known['p_rel3'] == FAR
    assert known['p_rel5'] == 0
    # Two lanes away is no neighbour.
    assert known['p_rel2'] == FAR
    assert (known['d_left'], known['d_right']) == (2, 10)


def test_v_y_and_the_distance_to_the_left_edge_tell_of_the_same_way():
    world = Highway(1)
    before, _ = world.reset(seed=0)
    after, *_ = world.step(np.array([[0.0, 1.0]]))
    for _ in range(3):
        after, *_ = world.step(np.array([[0.0, 0.0]]))
    assert after[0, 1] > 0
    assert after[0, NAMES.index('d_left')] < before[0, NAMES.index('d_left')]
    assert after[0, 8:10].sum() == pytest.approx(before[0, 8:10].sum())


def test_neighbours_are_those_found_by_looking_at_all():
    traffic = Traffic(8, 21)
    traffic.start(np.arange(8), [scenario(number) for number in range(8)])
    for step in range(60):
        traffic.step(np.zeros(8), np.zeros(8))
        if step % 20:
            continue
        x, y = traffic.real[X], traffic.real[Y]
        assert (np.diff(x, axis=0) >= 0).all()
        assert (np.sort(traffic.whole[IDENTITY], axis=0) == np.arange(21)[:, None]).all()
        for s in range(8):
            for lane in range(3):
                inside = np.flatnonzero(np.abs(y[:, s] - 4 * lane) <= 3)
                for row in range(21):
                    ahead, behind = inside[inside > row], inside[inside < row]
                    assert traffic.ahead[row, lane, s] == (ahead[0] if len(ahead) else 21)
                    assert traffic.behind[row, lane, s] == (behind[-1] if len(behind) else -1)
    assert (traffic.whole[LANE] < traffic.lanes).all()


def test_scenarios_are_the_same_every_time_and_each_is_another():
    names = {scenario(number).name for number in range(0, FULL, 100)}
    assert len(names) == FULL // 100
    again = scenario.__wrapped__(7)
    np.testing.assert_array_equal(again.x, scenario(7).x)
    assert not np.array_equal(scenario(7).desired_speed, scenario(8).desired_speed)
    for number in range(0, FULL, 60):
        given = scenario(number)
        assert given.lanes in (2, 3)
        order = np.argsort(given.x)
        # Nobody touches anybody at the start.
        for lane in range(given.lanes):
            places = given.x[order][given.lane[order] == lane]
            assert (np.diff(places) > LENGTH).all()


def test_the_restricted_set_is_the_first_part_of_the_full_one(monkeypatch):
    def drawn(kind):
        world, numbers = kind(300), []
        monkeypatch.setattr(world, 'start', lambda _, given: numbers.extend(given))
        world.reset(seed=0)
        return numbers

    restricted = set(drawn(RestrictedHighway))
    assert restricted <= set(range(RESTRICTED))
    assert len(restricted) > 40
    assert max(drawn(Highway)) > FULL * 0.9


def test_a_robot_drives_the_same_in_any_batch():
    actions = np.random.default_rng(0).uniform(-1.0, 1.0, (60, 4, 2)) * (1.0, 0.1)
    streams = [EpisodeStream(Highway(n), seed=3) for n in (4, 2)]
    for action in actions:
        one, other = (stream.step(action[: stream.world.num_envs]) for stream in streams)
        np.testing.assert_array_equal(one.observation[:2], other.observation)
        np.testing.assert_array_equal(one.reward[:2], other.reward)


def test_a_reset_by_mask_leaves_the_others_alone():
    world = Highway(3)
    world.reset(seed=0)
    for _ in range(5):
        before, *_ = world.step(np.zeros((3, 2)))
    after, _ = world.reset(mask=np.array([False, True, False]))
    np.testing.assert_array_equal(after[[0, 2]], before[[0, 2]])
    assert not np.array_equal(after[1], before[1])


def test_reward_grows_from_20_to_30_m_per_s():
    world = Highway(1)
    world.start(np.array([0]), [4])
    for _ in range(8):
        observation, reward, *_ = world.step(np.array([[0.2, 0.0]]))
        assert reward[0] == pytest.approx(0.2 * np.clip((observation[0, 0] - 20) / 10, 0, 1))
        assert reward[0] > 0.1
    for _ in range(12):
        *_, reward, _, _, _ = world.step(np.array([[-1.0, 0.0]]))
    assert reward[0] == 0


def test_who_steers_off_the_road_or_drives_into_others_is_stopped_at_a_cost():
    swerving = np.arange(40) < 20
    action = np.where(swerving[:, None], [0.0, 0.1], [1.0, 0.0])
    world = Highway(40)
    world.reset(seed=0)
    reasons = []
    for _ in range(150):
        _, _, terminated, _, info = world.step(action)
        reasons.append((info['off_road'], info['collision']))
        np.testing.assert_array_equal(terminated, info['off_road'] | info['collision'])
        np.testing.assert_array_equal(info['true_cost'], terminated)
        world.reset(mask=terminated)
    off_road, collision = np.any(reasons, axis=0)
    assert off_road[swerving].all()
    assert collision[~swerving].mean() > 0.8


def test_a_car_that_keeps_its_lane_and_slows_down_is_truncated_after_40_s():
    world = Highway(20)
    world.reset(seed=0)
    for step in range(200):
        observation, _, terminated, truncated, _ = world.step(np.tile([-0.4, 0.0], (20, 1)))
        assert truncated.any() == (step == 199)
    assert (truncated | terminated).all()
    assert (observation[:, 0] >= -0.5).all()
