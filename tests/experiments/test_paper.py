# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The paper's experiments: the store, the runner, and the tables of the page."""

import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from occ_constraints_pkg.errors import ConfigurationError, DataError

pytest.importorskip('torch', reason="needs the extra 'train'")
pytest.importorskip('sklearn', reason="needs the extra 'dev'")
pytest.importorskip('matplotlib', reason="needs the extra 'report'")

from occ_constraints_pkg.stopping import stop_request

from experiments.paper.command import run_paper
from experiments.paper.experiments import EXPERIMENTS, all_tables, wanted_jobs, with_tables
from experiments.paper.jobs import Job, in_order
from experiments.paper.plan import QUICK, Scale, rules_job, training_job
from experiments.paper.runner import run_jobs
from experiments.paper.store import Store

ROOT = Path(__file__).parents[2]
STATES = Job('states', {'world': 'simple_nav', 'episodes': 3})
# A training that improves its cost on the way, between checkpoints.
_SMALL = replace(QUICK, robots=64)
CUT = training_job(
    _SMALL,
    'simple_nav',
    'ICRL',
    0,
    rules=rules_job(_SMALL, 'simple_nav', 'expert', 0),
    steps=40_000,
)


def test_a_line_that_was_cut_off_is_ignored_and_then_removed(tmp_path):
    store = Store(tmp_path)
    assert store.lines() == {}
    store.append('kind', {'id': 'one', 'result': {'x': 1}})
    file = tmp_path / 'kind.jsonl'
    whole = file.read_bytes()
    for length in (1, len(whole) // 2, len(whole) - 1):
        file.write_bytes(whole + whole[:length])
        assert list(store.lines()) == ['one']
    store.append('kind', {'id': 'one', 'result': {'x': 2}})
    store.append('other', {'id': 'two', 'result': {}})
    assert len(file.read_bytes().splitlines()) == 2
    assert store.lines()['one']['result'] == {'x': 2}
    assert list(store.lines()) == ['one', 'two']


def test_a_store_that_is_damaged_elsewhere_is_told(tmp_path):
    (tmp_path / 'kind.jsonl').write_text('{"id": "one"\n{"id": "two", "result": {}}\n')
    with pytest.raises(DataError, match=r'kind\.jsonl is damaged: line 1 is no result of a run'):
        Store(tmp_path).lines()


def test_ids_and_folders_tell_runs_apart():
    for scale in (Scale(), QUICK):
        jobs = in_order(wanted_jobs(list(EXPERIMENTS), scale), (), Path('nowhere'))
        assert len({job.id for job in jobs}) == len({job.folder for job in jobs}) == len(jobs)
        seen = set()
        for job in jobs:
            assert {need.id for need in job.needs.values()} <= seen
            seen.add(job.id)


def test_runs_whose_files_are_missing_are_performed_again_only_if_needed(tmp_path):
    expert = Job('training', {'n': 1})
    rules = Job('rules', {'n': 1}, {'expert': expert})
    assert in_order([expert, rules], [expert.id, rules.id], tmp_path) == []
    assert in_order([expert, rules], [expert.id], tmp_path) == [expert, rules]
    (tmp_path / expert.folder).mkdir(parents=True)
    (tmp_path / expert.folder / 'result.json').write_text('{}')
    assert in_order([expert, rules], [expert.id], tmp_path) == [rules]


def test_only_the_first_seeds():
    one = wanted_jobs(['transfer'], Scale(), seeds=1)
    assert len(one) == 16
    assert {job.seed for job in one} == {0}


def test_a_run_that_fails_is_told_and_the_others_are_made(tmp_path):
    wrong = Job('states', {'world': 'nowhere', 'episodes': 3})
    after = Job('baselines', {'n': 1}, {'states': wrong})
    store = Store(tmp_path / 'store')
    failed = run_jobs([wrong, after, STATES], store, tmp_path / 'work', workers=1, command='this')
    assert list(failed) == [wrong.id]
    assert "'nowhere'" in failed[wrong.id]
    (line,) = store.lines().values()
    assert line['id'] == STATES.id
    assert line['command'] == 'this'
    assert line['result']['driver'] == 'straight'
    assert {'numpy', 'torch'} <= line['versions'].keys()
    assert line['seconds'] > 0


def test_two_runners_do_not_work_in_one_folder(tmp_path):
    from occ_constraints_pkg.files import DirectoryLock

    lock = DirectoryLock(tmp_path)
    with pytest.raises(ConfigurationError, match='another program is writing'):
        run_jobs([STATES], Store(tmp_path / 'store'), tmp_path)
    del lock


RUNNER = """
import sys
from pathlib import Path
sys.path.insert(0, 'tests/experiments')
from test_paper import CUT
from experiments.paper.runner import run_jobs
from experiments.paper.store import Store
folder = Path(sys.argv[1])
sys.exit(len(run_jobs([CUT], Store(folder / 'store'), folder / 'work', workers=1)))
"""


@pytest.fixture
def start_runner():
    """Return a function that starts a runner; those that are left are ended."""
    runners = []

    def start(folder):
        runners.append(subprocess.Popen([sys.executable, '-c', RUNNER, str(folder)], cwd=ROOT))
        return runners[-1]

    yield start
    for runner in runners:
        runner.kill()
        runner.wait()


def wait_until(condition, seconds=250.0):
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, 'waited in vain'
        time.sleep(0.02)


def is_alive(process):
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    return True


@pytest.mark.timeout(900)
@pytest.mark.slow
def test_a_run_goes_on_after_its_runner_was_killed_as_if_nothing_had_been(tmp_path, start_runner):
    training = tmp_path / 'work' / CUT.folder / 'training'

    def updates():
        file = training / 'metrics.jsonl'
        return file.read_text().count('\n') if file.exists() else 0

    for least in (1, 8):
        runner = start_runner(tmp_path)
        wait_until(lambda least=least: updates() >= least)
        children = Path(f'/proc/{runner.pid}/task/{runner.pid}/children').read_text().split()
        runner.send_signal(signal.SIGKILL)
        runner.wait()
        wait_until(lambda children=children: not any(map(is_alive, map(int, children))))
    assert CUT.id not in Store(tmp_path / 'store').lines()
    whole = tmp_path / 'whole'
    for folder in (tmp_path, whole):
        runner = start_runner(folder)
        assert runner.wait(400) == 0
    cut, uncut = (Store(folder / 'store').lines()[CUT.id] for folder in (tmp_path, whole))
    assert cut['result'] == uncut['result']
    assert cut['result']['curve']['steps'][-1] >= 36_000


@pytest.mark.timeout(900)
def test_everything_in_small(tmp_path, monkeypatch):
    """What a fresh clone can be smoked with; see the time that it may take in the documentation."""
    # That of an earlier test in this process.
    monkeypatch.setattr(stop_request, 'made', False)
    result = run_paper((), quick=True, output=tmp_path / 'results', workspace=tmp_path / 'work')
    assert result['failed'] == {}
    assert [row['runs'] - row['done'] for row in result['progress']] == [0] * len(EXPERIMENTS)
    page = (tmp_path / 'results' / 'results.md').read_text(encoding='utf-8')
    for name in ('simple_nav_rules', 'transfer_cost', 'depth', 'highway', 'pruning_rules'):
        block = page.split(f'<!-- table {name} -->\n')[1].split('\n<!-- end -->')[0]
        assert block.startswith('| ')
    pictures = {path.name for path in (tmp_path / 'results').glob('*.png')}
    assert {'simple_nav_tree.png', 'depth.png', 'highway.png'} <= pictures
    # A second call has nothing left to do.
    again = run_paper(
        ('depth',), quick=True, output=tmp_path / 'results', workspace=tmp_path / 'work'
    )
    assert again['failed'] == {}


def test_the_status_runs_nothing(run_experiment, tmp_path):
    code, out, _ = run_experiment(f'paper transfer --status -o {tmp_path} --workspace {tmp_path}')
    assert code == 0
    assert '| transfer | 56 | 0 | 100 | 380.0 | - |' in out
    assert list(tmp_path.iterdir()) == []


def test_a_wrong_name_is_told(run_experiment):
    code, _, err = run_experiment('paper transfr')
    assert code == 2
    assert "there is no experiment 'transfr'; did you mean 'transfer'?" in err


def test_the_tables_of_the_page_are_those_of_the_store():
    page = (ROOT / 'docs' / 'results.md').read_text(encoding='utf-8')
    lines = Store(ROOT / 'docs' / 'results' / 'paper').lines()
    tables = all_tables(lines, Scale())
    assert with_tables(page, tables) == page
    shown = {part.split(' -->')[0] for part in page.split('<!-- table ')[1:]}
    assert shown == set(tables)
    for line in lines.values():
        assert line['command'].startswith('python -m experiments paper')
        assert {'versions', 'commit', 'seconds', 'finished', 'machine'} <= line.keys()
        assert np.isfinite(line['seconds'])
        json.dumps(line, allow_nan=False)
