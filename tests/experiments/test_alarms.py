# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
import json

import pytest
from occ_constraints_pkg.errors import OccError

pytest.importorskip('mujoco', reason="needs the extra 'train'")

from experiments import alarms  # noqa: E402


@pytest.mark.parametrize(
    ('settings', 'sentence'),
    [
        (
            {'world': 'simple_nav'},
            "no world 'simple_nav' with a known truth",
        ),
        ({'demonstrations': 100, 'episodes': 100}, 'leave none that is fresh'),
    ],
)
def test_what_cannot_be_measured_is_told(settings, sentence):
    with pytest.raises(OccError, match=sentence):
        alarms.AlarmSettings(**settings)


@pytest.mark.slow
def test_a_small_run_gives_a_line_for_every_guarantee(monkeypatch, tmp_path):
    monkeypatch.setattr(alarms, 'GUARANTEES', (0.5,))
    monkeypatch.setattr(alarms, '_JUDGED_EPISODES', 2)
    settings = alarms.AlarmSettings(demonstrations=10, episodes=30, draws=2)
    result = alarms.run_alarms(tmp_path, settings)
    assert [(line['episodes'], line['promised']) for line in result['lines']] == [
        ('demonstrated', None),
        ('demonstrated', 0.5),
        ('without true cost', None),
        ('without true cost', 0.5),
    ]
    for line in result['lines']:
        assert 0.0 <= line['alarm_rate']['mean'] <= 1.0
        assert line['margin']['mean'] >= 0.0
        assert (line['bound'] is None) == (line['promised'] is None)
    assert len(alarms.markdown(result).splitlines()) == 6
    json.dumps(result, allow_nan=False)
