# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
import json
import signal

import pytest

pytest.importorskip('matplotlib')


def test_a_drive_on_the_highway_is_drawn(occ, tmp_path):
    code, out, _ = occ('drive highway --driver random --seed 2999 -o drive.png --json')
    assert code == 0
    numbers = json.loads(out)
    assert 0 < numbers['steps'] <= 200
    assert numbers['cost'] in (0.0, 1.0)
    assert (tmp_path / 'drive.png').stat().st_size > 1000


def test_a_scenario_or_driver_that_is_not_there_is_refused(occ):
    code, _, err = occ('drive highway_restricted --driver random --seed 52')
    assert code == 2
    assert 'world highway_restricted has no scenario 52; allowed are 0 to 51' in err
    for world in ('highway', 'highway_restricted'):
        code, _, err = occ(f'drive {world} --driver straight')
        assert code == 2
        assert f"world {world} has no driver 'straight'" in err
        assert 'allowed are random, expert and a policy file' in err


@pytest.mark.parametrize(
    ('line', 'sentence'),
    [
        ('drive highway --steps 5', '--steps is not for world highway; allowed is a whole'),
        ('drive simple_nav -c rules.yaml', '--constraints is not for world simple_nav'),
    ],
)
def test_an_option_without_effect_is_refused(occ, tmp_path, line, sentence):
    code, _, err = occ(f'{line} -o drive.png')
    assert code == 2
    assert sentence in err
    assert not (tmp_path / 'drive.png').exists()


@pytest.mark.parametrize(
    ('options', 'sentence'),
    [
        ('--steps 0', '0 is not in the range x>=1'),
        ('--rules nowhere.yaml', 'cannot read nowhere.yaml'),
        ('--rules strange.yaml', 'the constraints have no feature_map'),
        ('--cost-limit -1', 'learner setting cost_limit is -1.0; allowed is 0 or more'),
    ],
)
def test_a_mistake_about_ours_is_told_before_any_training(occ, tmp_path, options, sentence):
    pytest.importorskip('torch')
    pytest.importorskip('highway_env')
    (tmp_path / 'strange.yaml').write_text(
        'schema_version: 1\n'
        'features: [{name: x, demonstrated: [0.0, 1.0]}]\n'
        "rules: [{id: X, literals: [{feature: x, operator: '>', bound: 0.9}]}]\n"
    )
    code, _, err = occ(f'experiment highway {options} -o runs')
    assert code == 2
    assert sentence in err
    assert not (tmp_path / 'runs').exists()


def test_a_stopped_experiment_is_told_as_other_stopped_commands(occ, monkeypatch, tmp_path):
    pytest.importorskip('torch')
    pytest.importorskip('highway_env')
    from experiments import highway

    run = highway.run_highway

    def run_and_stop(*args, **options):
        signal.raise_signal(signal.SIGINT)
        return run(*args, **options)

    monkeypatch.setattr(highway, 'run_highway', run_and_stop)
    code, out, err = occ('experiment highway --agent RL --set restricted -o runs')
    assert (code, out, err.strip()) == (130, '', 'stopped')
    assert not (tmp_path / 'runs' / 'highway.json').exists()


def test_a_wrong_cost_limit_is_refused(occ):
    pytest.importorskip('torch')
    code, _, err = occ('experiment highway --cost-limit much')
    assert code == 2
    assert "got 'much'; allowed is a number or 'demonstrations'" in err
