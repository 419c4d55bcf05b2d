# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from occ_constraints_pkg.agents.drivers import DRIVERS
from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.worlds.registry import make_world

pytest.importorskip('matplotlib')
pytest.importorskip('mujoco')

from occ_constraints_pkg.worlds.film import COLOURS, draw_episode  # noqa: E402
from PIL import Image  # noqa: E402


def _draw(path, name, steps):
    world = make_world(name, 1)
    driver = DRIVERS[name]['random'](np.random.default_rng(0))
    numbers = draw_episode(path, world, driver, steps=steps, seed=0)
    world.close()
    return numbers


@pytest.mark.parametrize(('name', 'thing'), [('PointGoal1', 'vase'), ('CarPush1', 'box')])
def test_a_picture_shows_what_there_is(tmp_path, name, thing):
    numbers = _draw(tmp_path / 'drive.png', name, 20)
    assert numbers['steps'] == 20
    pixels = np.asarray(Image.open(tmp_path / 'drive.png').convert('RGB')).reshape(-1, 3)
    for kind in (thing, 'robot'):
        colour = [int(COLOURS[kind][place : place + 2], 16) for place in (1, 3, 5)]
        # More than the legend's patch.
        assert (pixels == colour).all(axis=1).sum() > 250


def test_a_film_has_its_frames_in_simulated_time_and_leaves_nothing_else(tmp_path):
    _draw(tmp_path / 'drive.gif', 'CarGoal1', 8)
    with Image.open(tmp_path / 'drive.gif') as film:
        assert film.n_frames == 5
        assert film.info['duration'] == pytest.approx(80, abs=10)
        first = np.asarray(film.convert('RGB'))
        film.seek(4)
        assert (np.asarray(film.convert('RGB')) != first).any()
    assert [path.name for path in tmp_path.iterdir()] == ['drive.gif']


def test_an_unknown_ending_and_a_world_without_a_view_are_refused(tmp_path):
    with pytest.raises(OccError, match=r'allowed are \.png, \.gif'):
        _draw(tmp_path / 'drive.bmp', 'PointGoal1', 2)
    with pytest.raises(OccError, match='no view'):
        _draw(tmp_path / 'drive.png', 'simple_nav', 2)
    assert not list(tmp_path.iterdir())
