# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""``occ learn --compare-depths``: the rules of all depths, as table, JSON and picture."""

import json
import struct

import numpy as np
import pytest
from synthetic_bags import write_drive


def test_bags_scored_on_another_bag(occ, tmp_path):
    pytest.importorskip('matplotlib', reason="needs the extra 'report'")
    write_drive(tmp_path / 'careful')
    write_drive(tmp_path / 'careless', driver='straight', robots=5, steps=60)
    line = 'learn careful -m simple_nav --alpha 0.5 --compare-depths --score careless -o out'
    code, out, err = occ(f'{line} --json')
    assert (code, err) == (0, '')
    depths = json.loads(out)
    assert depths == json.loads((tmp_path / 'out' / 'depth.json').read_text())
    assert [item['depth'] for item in depths] == list(range(len(depths)))
    assert depths[-1]['f1'] > depths[0]['f1']
    assert depths[-1]['training'] <= depths[0]['training'] == 1.0
    header = (tmp_path / 'out' / 'depth.png').read_bytes()[:24]
    assert header[:8] == b'\x89PNG\r\n\x1a\n'
    assert min(struct.unpack('>II', header[16:])) > 300
    code, out, _ = occ(line)
    assert code == 0
    assert len(out.splitlines()) == 1 + len(depths) + 1
    assert f'{depths[-1]["f1"]:.3f}' in out
    last = depths[-1]
    learned = json.loads(occ('learn careful -m simple_nav --alpha 0.5 --json')[1])
    assert (learned['rules'], learned['literals']) == (last['rules'], last['literals'])
    assert (learned['training'], learned['held_out']) == (last['training'], last['held_out'])


def test_tables_and_mistakes(occ):
    pytest.importorskip('matplotlib', reason="needs the extra 'report'")
    rng = np.random.default_rng(0)
    np.savez('drives.npz', features=rng.random((300, 2)), names=['x', 'y'])
    np.savez('more.npz', features=rng.random((50, 2)), names=['y', 'x'])
    np.savez('judged.npz', features=rng.random((9, 2)), names=['y', 'x'], cost=np.arange(9) % 2)
    code, out, err = occ('learn drives.npz --compare-depths -o out')
    assert (code, err) == (0, '')
    assert 'none' in out
    assert 'F1' not in out
    code, out, _ = occ('learn drives.npz --compare-depths --score judged.npz -o out')
    assert (code, 'F1' in out) == (0, True)
    for wrong, told in (
        ('learn drives.npz --compare-depths --score more.npz', 'no true cost'),
        ('learn nowhere --compare-depths', 'needs a feature map'),
        ('learn drives.npz --compare-depths --depth 200', 'max_depth is 200'),
        ('learn drives.npz --score judged.npz', '--score needs --compare-depths'),
        (
            'learn drives.npz --compare-depths --false-alarm 0.1',
            '--false-alarm has no effect with --compare-depths',
        ),
    ):
        code, out, err = occ(wrong)
        assert (code, out, err.count('\n')) == (2, '', 1)
        assert told in err
