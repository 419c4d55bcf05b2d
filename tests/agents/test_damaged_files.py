# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Damaged and hostile policies, checkpoints and metrics: refused in a sentence, or harmless."""

import io
import json
import pickle
import resource
import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest

torch = pytest.importorskip('torch', reason="needs the extra 'train'")

from fuzz_files import kinds, learner, same  # noqa: E402
from fuzzing import watched  # noqa: E402
from occ_constraints_pkg.agents import drivers  # noqa: E402
from occ_constraints_pkg.agents.checkpoint import read_checkpoint, write_checkpoint  # noqa: E402
from occ_constraints_pkg.agents.policy import GaussianPolicy  # noqa: E402
from occ_constraints_pkg.agents.ppo_lagrangian import PPOLagrangian  # noqa: E402
from occ_constraints_pkg.agents.training import TrainingDirectory, read_metrics  # noqa: E402
from occ_constraints_pkg.errors import OccError  # noqa: E402


def sealed():
    return [kind for kind in kinds() if kind[3]]


@pytest.mark.parametrize('ending', ['.npz', '.pt'])
def test_each_flipped_bit_is_refused_or_harmless(tmp_path, ending):
    _, (whole,), read, _ = next(kind for kind in sealed() if kind[0] == ending)
    path = tmp_path / f'file{ending}'
    path.write_bytes(whole)
    before = read(path)
    rng = np.random.default_rng(5)
    # The end holds what tells where all the rest is.
    places = [*rng.integers(8 * len(whole), size=300), *range(8 * len(whole) - 176, 8 * len(whole))]
    refused = []
    for place in places:
        flipped = bytearray(whole)
        flipped[place // 8] ^= 1 << (place % 8)
        path.write_bytes(flipped)
        try:
            after = read(path)
        except OccError as error:
            refused.append(str(error))
        else:
            assert same(before, after), f'bit {place} changes what is read'
    assert len(refused) > 100
    assert all(path.name in sentence and '\n' not in sentence for sentence in refused)


def test_a_flipped_weight_is_noticed(tmp_path):
    """Torch itself reads it: 0.021 became 7.2e36 in an actor."""
    path = tmp_path / 'checkpoint.pt'
    made = learner()
    made.save(path, settings={})
    weight = made._networks['actor'][0].weight.detach().numpy().tobytes()
    content = bytearray(path.read_bytes())
    content[content.index(weight) + 3] ^= 0x40
    path.write_bytes(content)
    torch.load(path, weights_only=True)
    with pytest.raises(OccError, match=r'checkpoint.pt is damaged .*Bad CRC-32'):
        PPOLagrangian.load(path)


def test_shipped_policies_and_earlier_checkpoints_are_read(tmp_path):
    experts = sorted((Path(drivers.__file__).parent / 'experts').glob('*.npz'))
    assert experts
    for path in experts:
        assert GaussianPolicy.load(path).weights

    def plain(value):
        if isinstance(value, np.ndarray):
            return torch.from_numpy(value.copy())
        if isinstance(value, dict):
            return {key: plain(item) for key, item in value.items()}
        return value

    # As it was written before, with one and the same pair in several places.
    made = learner()
    state = plain({'learner': made._state(), 'companions': {'settings': {}}})
    torch.save({'format': 'occ_constraints checkpoint 2', **state}, tmp_path / 'old.pt')
    loaded = PPOLagrangian.load(tmp_path / 'old.pt')
    assert same(loaded._networks.state_dict(), made._networks.state_dict())


def repacked(source, target, parts, packing=zipfile.ZIP_STORED):
    """Write an archive anew, with other parts in it and right checksums."""
    content = io.BytesIO(Path(source).read_bytes())
    with zipfile.ZipFile(content) as old, zipfile.ZipFile(target, 'w') as new:
        for name in old.namelist():
            part = parts.get(name.rpartition('/')[2], old.read(name))
            new.writestr(name, part, packing)
        for name in parts.keys() - {name.rpartition('/')[2] for name in old.namelist()}:
            new.writestr(name, parts[name], packing)


def header(shape, dtype='<f4'):
    """Return an array's header without its content."""
    content = io.BytesIO()
    np.lib.format.write_array_header_1_0(
        content, {'shape': shape, 'fortran_order': False, 'descr': dtype}
    )
    return content.getvalue()


_READ = """
import resource, sys
from occ_constraints_pkg.errors import OccError
kind, path = sys.argv[1:]
if kind == 'policy':
    from occ_constraints_pkg.agents.policy import GaussianPolicy
    read = GaussianPolicy.load
elif kind == 'checkpoint':
    from occ_constraints_pkg.agents.ppo_lagrangian import PPOLagrangian
    read = PPOLagrangian.load
else:
    from occ_constraints_pkg.datasets.table_files import read_tables
    read = lambda path: read_tables([path])
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
try:
    read(path)
    print('read')
except OccError as error:
    print(error)
print((resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) // 1024)
"""


def read_apart(kind, path):
    """Read a file in a process of its own; return what it said, and by how many MB it grew."""
    done = subprocess.run(
        [sys.executable, '-c', _READ, kind, str(path)],
        capture_output=True,
        text=True,
        check=True,
        timeout=120,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_DATA, (6 << 30, 6 << 30)),
    )
    words, grown = done.stdout.splitlines()
    return words, int(grown)


# What is read, which member of it is another one, that one's header, and its bytes after that.
BOMBS = {
    'a member nobody needs': ('policy', 'more.npy', header((750_000_000,)), 300 << 20),
    'a large weight': ('policy', 'weight_0.npy', header((10**9,)), 300 << 20),
    'a shape': ('policy', 'weight_0.npy', header((10**12,)), 0),
    'features': ('table', 'features.npy', header((10**8, 3), '<f4'), 300 << 20),
    'bytes that become numbers': ('table', 'features.npy', header((40 << 20, 2), '|i1'), 80 << 20),
    'long names': ('table', 'names.npy', header((2,), '<U9999999'), 79_999_992),
}


@pytest.mark.parametrize('name', BOMBS)
def test_a_bomb_in_an_archive_of_arrays_takes_no_memory(tmp_path, name):
    kind, member, start, zeros = BOMBS[name]
    whole = tmp_path / 'whole.npz'
    if kind == 'policy':
        learner().policy().save(whole)
    else:
        np.savez(whole, features=np.ones((5, 2)), names=np.array(['x', 'y']))
    path = tmp_path / 'bomb.npz'
    repacked(whole, path, {member: start + bytes(zeros)}, zipfile.ZIP_DEFLATED)
    words, grown = read_apart(kind, path)
    assert grown < 150
    if 'nobody' in name:
        assert words == 'read'
    else:
        assert 'bomb.npz' in words
        assert 'allowed' in words


@pytest.mark.parametrize('packing', [zipfile.ZIP_LZMA, zipfile.ZIP_BZIP2])
def test_another_packing_is_refused(tmp_path, packing):
    learner().policy().save(tmp_path / 'whole.npz')
    repacked(tmp_path / 'whole.npz', tmp_path / 'policy.npz', {}, packing)
    with pytest.raises(OccError, match='policy.npz is not a policy file, or damaged'):
        GaussianPolicy.load(tmp_path / 'policy.npz')


def doubled(levels):
    """Return nested lists that hold one another twice."""
    value = ['x']
    for _ in range(levels):
        value = [value, value]
    return value


def hostile():
    good = {'format': 'occ_constraints checkpoint 2'}
    alloc = b'\x80\x02cbuiltins\nbytearray\n\x8a\x05\x00\xe8vH\x17\x85R.'
    call = b'\x80\x02cos\nsystem\nX\x04\x00\x00\x00trueq\x00\x85R.'
    return {
        'bytearray': alloc,
        'a call': call,
        'doubled lists': pickle.dumps({**good, 'learner': doubled(60)}, 2),
        'a list of itself': b'\x80\x02]q\x00h\x00a.',
        'wrong kinds': pickle.dumps({**good, 'learner': 3, 'companions': []}, 2),
        'wrong lists': pickle.dumps({**good, 'learner': [], 'companions': []}, 2),
        'empty': b'',
    }  # fmt: skip


@pytest.mark.parametrize('name', hostile())
def test_a_hostile_pickle_is_refused(tmp_path, name):
    learner().save(tmp_path / 'whole.pt', settings={})
    repacked(tmp_path / 'whole.pt', tmp_path / 'bad.pt', {'data.pkl': hostile()[name]})
    words, grown = read_apart('checkpoint', tmp_path / 'bad.pt')
    assert 'bad.pt is damaged' in words
    assert grown < 150


CHANGES = {
    'huge layers': lambda state: state['config'].update(hidden=[10**6, 10**6]),
    'no layers': lambda state: state['config'].update(hidden=None),
    'deep numbers': lambda state: state.update(rng='[' * 100_000),
    'steps': lambda state: state.update(multiplier=[1]),
    'columns': lambda state: state.update(columns=7),
    'networks': lambda state: state.update(networks=[1, 2]),
    'optimiser': lambda state: state['optimiser'].update(param_groups=[]),
    'stream': lambda state: state.update(stream={'robots': 2, 'rollout': 5}),
    'robots': lambda state: state.update(stream={'robots': 10**15, 'rollout': {}}),
    'setting': lambda state: state['config'].update(gamma='x'),
}


@pytest.mark.parametrize('name', CHANGES)
def test_wrong_kinds_in_a_checkpoint_are_told(tmp_path, name):
    made = learner()
    made.save(tmp_path / 'whole.pt', settings={})
    state = read_checkpoint(tmp_path / 'whole.pt')
    CHANGES[name](state['learner'])
    write_checkpoint(tmp_path / 'bad.pt', state)
    with pytest.raises(OccError) as refusal:
        PPOLagrangian.load(tmp_path / 'bad.pt')
    assert '\n' not in str(refusal.value)


@pytest.mark.parametrize('companions', [{}, {'settings': 3}, {'settings': []}])
def test_a_checkpoint_without_settings_is_refused(tmp_path, companions):
    learner().save(tmp_path / 'checkpoint.pt', **companions)
    with pytest.raises(OccError, match='checkpoint.pt is damaged: it tells no settings'):
        TrainingDirectory(tmp_path).resume()


@pytest.mark.parametrize('text', ['{"updates": "a"}', '{"updates": null}', '{"updates": true}',
                                  '[' * 100_000, '{"updates": 1.5}', '"updates"'])  # fmt: skip
def test_a_damaged_line_of_metrics_is_told(tmp_path, text):
    path = tmp_path / 'metrics.jsonl'
    path.write_text(f'{{"updates": 1}}\n{text}\n')
    with pytest.raises(OccError, match=r'metrics.jsonl is damaged: .* line 2 is'):
        read_metrics(path)
    path.write_text(f'{json.dumps({"updates": 1})}\n{text}')
    assert read_metrics(path) == [{'updates': 1}]


def test_damaged_files_of_all_kinds_are_read_within_bounds():
    found = watched('fuzz_files', 0, 180)
    assert found['problems'] == []
    assert found['endings']['refused'] > 50
