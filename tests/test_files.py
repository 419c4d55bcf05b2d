# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Files are replaced whole or not at all, never by another kind, and never read without end."""

import os
import signal
import stat
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest
from occ_constraints_pkg.documents import read_text
from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.files import (
    CONSTRAINTS,
    DOCUMENT_BYTES,
    PICTURE,
    RESULTS,
    check_outputs,
    keep_copy,
    replacing,
    write_text,
)

PNG = b'\x89PNG\r\n\x1a\n'


def test_a_file_keeps_its_permissions_and_a_link_its_target(tmp_path):
    (tmp_path / 'elsewhere').mkdir()
    target, link = tmp_path / 'elsewhere' / 'old.json', tmp_path / 'link.json'
    target.write_text('{}')
    target.chmod(0o604)
    link.symlink_to(target)
    write_text(link, RESULTS, '[1]')
    assert link.is_symlink()
    assert target.read_text() == '[1]'
    assert stat.S_IMODE(target.stat().st_mode) == 0o604
    assert os.listdir(tmp_path / 'elsewhere') == ['old.json']


@pytest.mark.skipif(os.geteuid() != 0, reason='only an administrator can give files away')
def test_owner_and_group_are_kept(tmp_path):
    file = tmp_path / 'a.json'
    file.write_text('{}')
    os.chown(file, 1, 2)
    write_text(file, RESULTS, '[]')
    assert (file.stat().st_uid, file.stat().st_gid) == (1, 2)


def test_a_new_file_follows_the_umask_and_its_directory_is_made(tmp_path):
    before = os.umask(0o027)
    try:
        write_text(tmp_path / 'a' / 'b' / 'new.json', RESULTS, '{}')
    finally:
        os.umask(before)
    assert stat.S_IMODE((tmp_path / 'a' / 'b' / 'new.json').stat().st_mode) == 0o640


def test_a_dangling_link_and_a_loop_of_links(tmp_path):
    (tmp_path / 'dangling.json').symlink_to(tmp_path / 'later.json')
    write_text(tmp_path / 'dangling.json', RESULTS, '{}')
    assert (tmp_path / 'later.json').read_text() == '{}'
    (tmp_path / 'loop.json').symlink_to(tmp_path / 'loop.json')
    with pytest.raises(OccError, match='cannot write'):
        write_text(tmp_path / 'loop.json', RESULTS, '{}')


def test_drafts_cannot_be_foreseen_nor_planted(tmp_path):
    names = []
    for _ in range(2):
        with replacing(tmp_path / 'a.json', RESULTS) as draft:
            names.append(draft.name)
            assert draft.parent == tmp_path
            assert draft.suffix == '.json'
    assert names[0] != names[1]
    victim = tmp_path / 'victim'
    victim.write_text('precious')

    def swapped():
        with replacing(tmp_path / 'a.json', RESULTS) as draft:
            draft.unlink()
            draft.symlink_to(victim)

    with pytest.raises(OccError, match='another program has replaced the draft'):
        swapped()
    assert victim.read_text() == 'precious'
    assert sorted(os.listdir(tmp_path)) == ['a.json', 'victim']


@pytest.mark.parametrize('name', ['x' * 255, 'ü' * 127, 'a.' + 'b' * 253])
def test_the_longest_names_can_be_written(tmp_path, name):
    write_text(tmp_path / name, RESULTS, '{}')
    assert os.listdir(tmp_path) == [name]


@pytest.mark.parametrize('error', [KeyboardInterrupt, OccError, OSError])
def test_nothing_is_left_of_a_block_that_fails(tmp_path, error):
    (tmp_path / 'a.json').write_text('{}')

    def failing():
        with replacing(tmp_path / 'a.json', RESULTS) as draft:
            draft.write_text('half')
            raise error

    with pytest.raises((error, OccError)):
        failing()
    assert os.listdir(tmp_path) == ['a.json']
    assert (tmp_path / 'a.json').read_text() == '{}'


def test_a_file_of_another_kind_is_never_replaced(tmp_path):
    picture = tmp_path / 'a.png'
    picture.write_bytes(PNG)
    with pytest.raises(OccError, match='not a constraints file, which would be lost'):
        write_text(picture, CONSTRAINTS, 'rules: []')
    with replacing(picture, PICTURE) as draft:
        draft.write_bytes(PNG + b'new')
    assert picture.read_bytes() == PNG + b'new'
    (tmp_path / 'empty').touch()
    write_text(tmp_path / 'empty', CONSTRAINTS, 'rules: []')
    for name in ('/dev/null', tmp_path):
        with pytest.raises(OccError, match='no ordinary file'):
            write_text(name, RESULTS, '{}')
    os.mkfifo(tmp_path / 'pipe')
    with pytest.raises(OccError, match='no ordinary file'):
        write_text(tmp_path / 'pipe', RESULTS, '{}')


@pytest.mark.parametrize('by', ['name', 'symlink', 'hard link', 'other way'])
def test_an_output_is_never_an_input(tmp_path, by):
    source = tmp_path / 'c.yaml'
    source.write_text('rules: []')
    output = tmp_path / 'out.yaml'
    if by == 'symlink':
        output.symlink_to(source)
    elif by == 'hard link':
        os.link(source, output)
    else:
        output = source if by == 'name' else tmp_path / '..' / tmp_path.name / 'c.yaml'
    with pytest.raises(OccError, match='read by the same command; allowed is another file'):
        check_outputs({output: CONSTRAINTS}, [source])


def test_two_outputs_are_two_files_and_names_end_as_their_kind(tmp_path):
    (tmp_path / 'link.png').symlink_to(tmp_path / 'a.png')
    with pytest.raises(OccError, match='to be written by the same command'):
        check_outputs([(tmp_path / 'a.png', PICTURE), (tmp_path / 'link.png', PICTURE)])
    for name in ('x.html', 'x', 'x.jpg', 'png'):
        with pytest.raises(OccError, match='ends in .png'):
            check_outputs({tmp_path / name: PICTURE})
    check_outputs({tmp_path / 'X.PNG': PICTURE})


def test_copies_are_kept_of_each_replacement(tmp_path):
    file = tmp_path / 'c.yaml'
    victim = tmp_path / 'victim'
    victim.write_text('precious')
    (tmp_path / 'c.yaml.bak').symlink_to(victim)
    for text in ('one', 'two', 'two', 'three'):
        file.write_text(text)
        file.chmod(0o600)
        copy = keep_copy(file)
        assert copy.read_text() == text
        assert stat.S_IMODE(copy.stat().st_mode) == 0o600
    assert victim.read_text() == 'precious'
    kept = [(tmp_path / f'c.yaml.bak{end}').read_text() for end in ('', '.2', '.3')]
    assert kept == ['three', 'one', 'two']


def test_what_never_ends_or_is_too_large_is_not_read(tmp_path):
    os.mkfifo(tmp_path / 'pipe')
    (tmp_path / 'zero').symlink_to('/dev/zero')
    for name in ('/dev/zero', tmp_path / 'zero', tmp_path / 'pipe'):
        with pytest.raises(OccError, match='a device, a pipe or a socket; allowed is'):
            read_text(name)
    with (tmp_path / 'huge').open('wb') as stream:
        stream.truncate(DOCUMENT_BYTES + 1)
    with pytest.raises(OccError, match='it has 8388609 bytes; allowed are 8388608 at most'):
        read_text(tmp_path / 'huge')
    with pytest.raises(OccError, match='it is a directory'):
        read_text(tmp_path)
    with pytest.raises(OccError, match='cannot read'):
        read_text('a\0b')


_WRITER = """
import sys
from occ_constraints_pkg.files import RESULTS, replacing
for number in range(10**9):
    with replacing(sys.argv[1], RESULTS) as draft:
        with draft.open('w') as file:
            for _ in range(200):
                file.write('[' + str(number % 10) * 1000 + ']\\n')
    print(flush=True)
"""


def test_a_killed_writer_leaves_the_old_or_the_new_file(tmp_path):
    file = tmp_path / 'a.json'
    for trial in range(10):
        writer = subprocess.Popen(
            [sys.executable, '-c', _WRITER, str(file)], stdout=subprocess.PIPE, text=True
        )
        writer.stdout.readline()
        threading.Event().wait(0.002 * trial)
        writer.kill()
        writer.wait()
        writer.stdout.close()
        lines = set(file.read_text().splitlines())
        assert len(lines) == 1
        assert len(file.read_text()) == 200 * 1003


def test_a_stopped_writer_leaves_no_draft(tmp_path):
    writer = subprocess.Popen(
        [sys.executable, '-c', _WRITER, str(tmp_path / 'a.json')],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
        # A test run in the background may ignore it, which children inherit.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    )
    writer.stdout.readline()
    time.sleep(0.05)
    writer.send_signal(signal.SIGINT)
    writer.stdout.read()
    writer.wait(10)
    writer.stdout.close()
    assert os.listdir(tmp_path) == ['a.json']
    assert Path(tmp_path / 'a.json').stat().st_size == 200 * 1003
