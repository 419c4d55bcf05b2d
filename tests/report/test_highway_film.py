# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
import dataclasses

import numpy as np
import pytest

pytest.importorskip('matplotlib')

from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.report.highway_film import draw_drives, drive_through
from PIL import Image


def test_a_drive_ends_as_the_world_says():
    off = drive_through(lambda seen: np.array([[0.0, 0.2]]), 0)
    assert off.end == 'off the road'
    assert off.vehicles.shape == (len(off.observation), 21, 3)
    assert 5 < len(off.vehicles) < 60
    # The ego is first, and goes to the left.
    assert off.vehicles[-1, 0, 1] < off.vehicles[0, 0, 1]
    assert off.returned == pytest.approx(0.2 * 0.5 * (len(off.vehicles) - 1), abs=0.2)


@pytest.mark.parametrize('suffix', ['png', 'gif'])
def test_drives_are_drawn_under_one_another(tmp_path, suffix):
    drive = drive_through(lambda seen: np.array([[0.0, 0.2]]), 0)
    short = dataclasses.replace(
        drive, vehicles=drive.vehicles[:9], observation=drive.observation[:9]
    )
    path = tmp_path / f'drives.{suffix}'
    draw_drives(path, {'one': short, 'other': short}, None)
    with Image.open(path) as picture:
        assert picture.width > picture.height
        assert getattr(picture, 'n_frames', 1) == (1 if suffix == 'png' else 3)


def test_another_suffix_is_refused(tmp_path):
    with pytest.raises(OccError, match=r'allowed are \.png and \.gif'):
        draw_drives(tmp_path / 'drives.mp4', {}, None)
