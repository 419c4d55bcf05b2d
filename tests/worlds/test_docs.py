# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The examples of docs/worlds.md run and do what the text says."""

import re
from pathlib import Path

import numpy as np
import pytest
from occ_constraints_pkg.agents.evaluation import evaluate
from occ_constraints_pkg.errors import OccError

_TEXT = (Path(__file__).parents[2] / 'docs' / 'worlds.md').read_text(encoding='utf-8')
_BLOCKS = re.findall(r'```python\n(.*?)```', _TEXT, flags=re.DOTALL)


def _run(word):
    """Run the only example that holds a word; return what it defines."""
    (block,) = (block for block in _BLOCKS if word in block)
    names = {}
    exec(compile(block, f'docs/worlds.md: {word}', 'exec'), names)
    return names, block


def test_the_first_example():
    names, _ = _run('EpisodeStream(world')
    assert names['batch'].observation.shape == (4, 2)


def test_the_example_with_gymnasium():
    pytest.importorskip('gymnasium')
    pytest.importorskip('mujoco')
    names, _ = _run('make_vec')
    assert names['info']['cost'] in (0.0, 1.0)
    assert names['envs'].num_envs == 64
    names['envs'].close()


def test_the_example_of_an_own_world():
    names, block = _run('class Corridor')
    code = [line for line in block.splitlines() if line.strip() and '"""' not in line]
    assert len(code) <= 33
    world = names['Corridor'](4)
    result = evaluate(world, lambda rows: np.tile([1.0, 0.5], (len(rows), 1)), episodes=8, seed=0)
    np.testing.assert_allclose(result.returns, 1.0, atol=1e-9)
    assert (result.lengths == 20).all()
    assert (result.costs > 0).any()
    few, many = names['Corridor'](1), names['Corridor'](4)
    np.testing.assert_array_equal(few.reset(seed=2)[0], many.reset(seed=2)[0][:1])
    mask = np.array([True, False, False, False])
    before = many.reset()[0]
    np.testing.assert_array_equal(many.reset(mask=mask)[0][1:], before[1:])
    with pytest.raises(OccError, match='nan'):
        world.step(np.full((4, 2), np.nan))
