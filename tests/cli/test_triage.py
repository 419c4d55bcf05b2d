# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""``occ triage``: what it prints and writes, bad recordings, mistakes, Ctrl-C."""

import json
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path
from urllib.parse import parse_qs, urlsplit

import numpy as np
import pytest
from occ_constraints_pkg.rosbag.recording import Recording

from benchmarks.triage import MAP, Drive, write_drive

COUNT = 6


@pytest.fixture(scope='module')
def folder(tmp_path_factory):
    """Return a folder with drives, of which one is bad, and a damaged recording."""
    folder = tmp_path_factory.mktemp('triage')
    (folder / 'map.yaml').write_text(MAP)
    for place in range(COUNT):
        fault = 'too fast' if place == 2 else ''
        write_drive(folder / 'bags' / f'drive_{place}', Drive(place, fault), seconds=20.0)
    shutil.copytree(folder / 'bags', folder / 'damaged')
    (folder / 'damaged' / 'broken.mcap').write_bytes(b'not a recording')
    rng = np.random.default_rng(0)
    table = rng.normal(size=(8, 50, 2))
    table[5, 25, 0] = 40.0
    np.savez(folder / 'table.npz', features=table, names=['v', 'w'])
    np.savez(folder / 'one.npz', features=table[0], names=['v', 'w'])
    (folder / 'empty').mkdir()
    return folder


@pytest.fixture
def occ(folder, run_occ, monkeypatch):
    monkeypatch.chdir(folder)
    return run_occ


def test_the_bad_one_comes_first_with_clip_link_and_manifest(occ, folder):
    code, out, err = occ(
        'triage bags -m map.yaml --clips clips --url http://host:9 --manifest good.yaml'
    )
    assert (code, err) == (1, '')
    lines = out.splitlines()
    assert lines[0].startswith('6 recordings, each judged by rules learned from the others')
    assert lines[2].endswith(' drive_2')
    assert 'speed above' in lines[3]
    clip = Path(lines[4].strip())
    query = parse_qs(urlsplit(lines[5].strip()).query)
    assert query['ds'] == ['remote-file']
    assert query['ds.url'] == [f'http://host:9/{clip.as_posix()}']
    assert query['time'][0].startswith('2023-11-14T22:13:')
    assert query['time'][0].endswith('Z')
    recording, source = Recording(clip.parent), Recording('bags/drive_2')
    assert {*recording.topics} == {*source.topics}
    first, last = recording.start_ns, max(raw.log_time_ns for raw in recording.messages())
    assert (last - first) * 1e-9 == pytest.approx(6.0, abs=0.4)
    assert recording.message_count == sum(
        first <= raw.log_time_ns <= last for raw in source.messages()
    )
    text = Path('good.yaml').read_text()
    assert 'exclude' in text or '# left out: drive_2' in text
    code, out, _ = occ('learn good.yaml -m map.yaml -o learned.yaml')
    assert code == 0


def test_json(occ):
    code, out, _ = occ('triage bags/drive_* -m map.yaml --json'.replace('*', '0') + ' bags')
    document = json.loads(out)
    assert code == 1
    assert document['unit'] == 's'
    assert [item['rank'] for item in document['recordings']] == list(range(1, COUNT + 2))
    assert document['recordings'][0]['name'] == 'drive_2'
    assert document['rules']


def test_what_cannot_be_read_is_named_and_the_others_go_on(occ):
    code, out, err = occ('triage damaged -m map.yaml')
    assert code == 1
    assert 'warning: broken is put aside: ' in err
    assert '\ncannot be used: broken: ' in out
    assert ' drive_2\n' in out


def test_good_recordings_end_well(occ):
    code, out, _ = occ('triage bags -m map.yaml --above 1e9')
    assert code == 0
    assert '0 stand out' in out


def test_episodes_of_a_table_are_ranked(occ):
    code, out, _ = occ('triage table.npz --json')
    first = json.loads(out)['recordings'][0]
    assert (code, first['name'], first['moment']) == (1, 'table.npz episode 5', 275.0)


MISTAKES = {
    'triage': 'Missing argument',
    'triage bags': 'recordings need a feature map',
    'triage bags -m nowhere.yaml': "no feature map 'nowhere.yaml'",
    'triage nowhere -m map.yaml': 'there is no recording at nowhere',
    'triage empty -m map.yaml': 'empty is no recording, and holds neither',
    'triage map.yaml -m map.yaml': 'map.yaml is not a recording, nor a manifest',
    'triage bags table.npz -m map.yaml': 'allowed are tables only or recordings only',
    'triage bags/drive_0 -m map.yaml': 'allowed are 3 or more',
    'triage one.npz': 'allowed are 3 or more',
    'triage bags -m map.yaml --clips bags': '--clips got bags, which exists',
    'triage bags -m map.yaml --clip-seconds 2': '--clip-seconds needs --clips',
    'triage bags -m map.yaml --url here': "--url got 'here'",
    'triage bags -m map.yaml --manifest map.yaml': 'cannot write map.yaml',
    'triage bags -m map.yaml --manifest bags.txt': 'ends in .yaml or .yml',
    'triage bags -m map.yaml --above 0': '--above',
    'triage bags -m map.yaml --processes 0': '--processes',
    'triage table.npz --clips new': 'got tables with --clips, --url or --manifest',
}


@pytest.mark.parametrize('line', MISTAKES)
def test_mistakes_are_told_in_one_sentence(occ, line):
    code, out, err = occ(line)
    assert (code, out) == (2, '')
    assert MISTAKES[line] in err
    assert len([told for told in err.splitlines() if told.startswith('error: ')]) == 1


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM, signal.SIGKILL])
def test_it_ends_at_once_with_its_processes(folder, number):
    sources = ['bags'] * 200
    process = subprocess.Popen(
        [sys.executable, '-m', 'occ_constraints_pkg', 'triage', *sources, '-m', 'map.yaml',
         '--processes', '2'],
        cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        start_new_session=True,
    )  # fmt: skip
    try:
        end = time.monotonic() + 60.0
        while len(children(process.pid)) < 2 and time.monotonic() < end:
            time.sleep(0.02)
        started = children(process.pid)
        assert len(started) == 2
        process.send_signal(number)
        out, err = process.communicate(timeout=30.0)
    finally:
        process.kill()
    if number != signal.SIGKILL:
        assert (process.returncode, out, err.strip()) == (130, '', 'stopped')
    end = time.monotonic() + 30.0
    while any(map(is_running, started)) and time.monotonic() < end:
        time.sleep(0.02)
    assert not any(map(is_running, started))


def is_running(pid):
    """Tell whether there is such a process that has not ended."""
    try:
        return Path(f'/proc/{pid}/stat').read_text().rpartition(')')[2].split()[0] != 'Z'
    except OSError:
        return False


def children(pid):
    """Return the processes that a process started."""
    try:
        return Path(f'/proc/{pid}/task/{pid}/children').read_text().split()
    except OSError:
        return []
