# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from hypothesis import given
from hypothesis import settings as effort
from hypothesis import strategies as st
from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.learning.safe_set import fit_safe_set
from occ_constraints_pkg.learning.settings import DEEPEST, OCTreeSettings
from strategies import fit_settings, samples


def blobs(rows=900, seed=0):
    """Three round clusters in the plane and a third column that says nothing."""
    rng = np.random.default_rng(seed)
    centres = np.array([[0.0, 0.0], [10.0, 0.0], [10.0, 10.0]])
    plane = centres[rng.integers(0, 3, size=rows)] + rng.normal(size=(rows, 2))
    return np.column_stack([plane, np.ones(rows)])


ARTICLE = OCTreeSettings(clip='density', gamma=0.05, alpha=0.5, beta=0.02, min_split=0.0)


def visit(node, path=()):
    """Yield (path of (feature, number of branches), node) from the root down."""
    yield path, node
    for branch in node.branches:
        yield from visit(branch.node, (*path, (node.feature, len(node.branches))))


@effort(max_examples=60)
@given(samples(), fit_settings())
def test_trees_are_what_the_article_allows(values, settings):
    tree = fit_safe_set(values, settings)
    assert tree.depth <= (DEEPEST if settings.max_depth is None else settings.max_depth)
    for path, node in visit(tree):
        if node.feature is None:
            assert node.branches == ()
            continue
        # Not cut again unless split into several since.
        since = []
        for feature, branches in path:
            since = [] if branches > 1 else [*since, feature]
        assert node.feature not in since
        ends = [end for branch in node.branches for end in (branch.low, branch.high)]
        assert ends == sorted(ends)
        assert all(a.high < b.low for a, b in zip(node.branches, node.branches[1:], strict=False))
        assert np.isin(ends, values[:, node.feature]).all()


@effort(max_examples=60)
@given(samples(), fit_settings())
def test_branches_count_their_samples_and_lie_within_their_parents(values, settings):
    def check(node, rows, box):
        for branch in node.branches:
            column = values[rows, node.feature]
            inside = rows[(column >= branch.low) & (column <= branch.high)]
            assert branch.samples == len(inside) > 0
            assert box[node.feature, 0] <= branch.low <= branch.high <= box[node.feature, 1]
            inner = box.copy()
            inner[node.feature] = branch.low, branch.high
            check(branch.node, inside, inner)

    tree = fit_safe_set(values, settings)
    check(tree, np.arange(len(values)), np.stack([values.min(axis=0), values.max(axis=0)], axis=1))
    boxes = tree.leaf_boxes(values.shape[1])
    inside = ((values[:, None] >= boxes[..., 0]) & (values[:, None] <= boxes[..., 1])).all(axis=2)
    np.testing.assert_array_equal(tree.contains(values), inside.any(axis=1))


@given(samples(), st.floats(0.0, 0.3))
def test_a_tree_without_splits_in_several_stays_within_its_contamination(values, contamination):
    settings = OCTreeSettings(contamination=contamination, alpha=0.0, min_split=0.0, beta=0.0)
    covered = fit_safe_set(values, settings).contains(values).mean()
    assert covered >= 1.0 - contamination - 1e-9


def test_three_blobs_become_three_boxes():
    values = blobs()
    tree = fit_safe_set(values, ARTICLE)
    boxes = tree.leaf_boxes(3)
    assert len(boxes) == 3
    assert np.isinf(boxes[:, 2]).all()
    for centre in ([0.0, 0.0], [10.0, 0.0], [10.0, 10.0]):
        holds = (boxes[:, :2, 0] <= centre).all(axis=1) & (boxes[:, :2, 1] >= centre).all(axis=1)
        assert holds.sum() == 1
    assert not tree.contains(np.array([[0.0, 10.0, 1.0], [5.0, 0.0, 1.0]])).any()
    assert tree.contains(values).mean() > 0.9


@pytest.mark.parametrize('nu', [0.0, 0.01, 0.05, 0.2, 1.0])
def test_nu_limits_the_share_outside(nu):
    values = blobs()
    tree = fit_safe_set(values, OCTreeSettings(**{**vars(ARTICLE), 'nu': nu}))
    assert np.mean(~tree.contains(values)) <= nu
    if nu == 0.0:
        assert tree.depth == 0
    if nu == 1.0:
        assert tree.depth >= 2


def test_nu_undoes_only_the_level_that_oversteps():
    values = blobs()
    free = fit_safe_set(values, ARTICLE)
    limited = fit_safe_set(values, OCTreeSettings(**{**vars(ARTICLE), 'max_depth': 1}))
    outside = float(np.mean(~limited.contains(values)))
    assert np.mean(~free.contains(values)) > outside
    assert fit_safe_set(values, OCTreeSettings(**{**vars(ARTICLE), 'nu': outside})) == limited


@pytest.mark.parametrize('depth', [0, 1, 2])
def test_depth_limit(depth):
    levels = []
    tree = fit_safe_set(
        blobs(),
        OCTreeSettings(max_depth=depth, contamination=0.05),
        progress=lambda level, leaves: levels.append((level, leaves)),
    )
    assert tree.depth == depth
    assert levels == [(level + 1, 1) for level in range(depth)]


def test_small_nodes_are_not_divided():
    values = blobs()
    tree = fit_safe_set(values, OCTreeSettings(**{**vars(ARTICLE), 'min_split': 0.5}))
    for path, node in visit(tree):
        if path:
            continue
        for branch in node.branches:
            if branch.samples < 0.5 * len(values):
                assert branch.node.feature is None
            else:
                assert branch.node.feature is not None


def test_the_order_of_samples_does_not_matter():
    values = blobs()
    shuffled = np.random.default_rng(5).permutation(values)
    assert fit_safe_set(values, ARTICLE) == fit_safe_set(shuffled, ARTICLE)


@pytest.mark.parametrize(
    ('values', 'sentence'),
    [
        (np.empty((0, 3)), r'shape \(n, k\), got an array of \(0, 3\)'),
        (np.empty((3, 0)), r'got an array of \(3, 0\)'),
        (np.ones(3), r'got an array of \(3,\)'),
        ([[0.0, 1.0], [2.0, np.nan]], 'sample 1, feature 1 is nan'),
        ([[0.0, -np.inf], [2.0, 3.0]], 'sample 0, feature 1 is -inf'),
    ],
)
def test_what_cannot_be_learned_from(values, sentence):
    with pytest.raises(OccError, match=sentence):
        fit_safe_set(values, OCTreeSettings())


@pytest.mark.parametrize(
    ('change', 'sentence'),
    [
        ({'clip': 'mean'}, "clip is 'mean'; allowed are 'mass' and 'density'"),
        ({'max_depth': -1}, 'max_depth is -1; allowed is 0 to 100'),
        ({'max_depth': DEEPEST + 1}, 'max_depth is 101'),
        ({'contamination': 1.0}, 'contamination is 1.0'),
        ({'gamma': np.nan}, 'gamma is nan'),
        ({'beta': -0.1}, 'beta is -0.1'),
        ({'min_split': 2}, 'min_split is 2'),
        ({'alpha': 1.1}, 'alpha is 1.1'),
        ({'nu': -0.1}, 'nu is -0.1'),
    ],
)
def test_settings_out_of_range(change, sentence):
    with pytest.raises(OccError, match=sentence):
        OCTreeSettings(**change)
