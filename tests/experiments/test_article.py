# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The article's benchmark: bands over splits, for its one split cannot be known."""

import json
from dataclasses import replace

import numpy as np
import pytest
from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.learning.octree import fit_tree
from occ_constraints_pkg.learning.settings import OCTreeSettings

from experiments.article_printed import METHODS, NOISE_LEVELS, printed

pytest.importorskip('sklearn')

from experiments import article
from experiments.article_data import contaminate


@pytest.fixture(scope='module')
def results(tmp_path_factory):
    folder = tmp_path_factory.mktemp('article')
    return folder, article.run_article(folder, splits=2, names=['Iris'], noise_levels=[5])


def test_iris_is_in_the_band_of_the_article(results):
    _, result = results
    assert len(result['cells']) == 4
    for cell in result['cells'].values():
        for measure in ('precision', 'recall'):
            assert cell['methods']['oc_tree'][measure]['mean'] > 0.75, cell
        assert set(cell['methods']) == set(METHODS)
        assert cell['chosen']['alpha'] in np.arange(0.5, 0.81, 0.05).round(2)
    all_target = result['cells']['Iris, 5 %']['methods']['oc_tree']
    expected = printed('Iris', 'oc_tree', 5)
    for measure, value in zip(('precision', 'recall'), expected, strict=True):
        assert all_target[measure]['mean'] == pytest.approx(value, abs=0.12)


def test_done_cells_are_kept_and_others_added(results, monkeypatch):
    folder, first = results
    before = json.loads((folder / 'article.json').read_text())['cells']
    ran = []
    run_cell = article._run_cell

    def counted(*arguments):
        ran.append(arguments[3:5])
        return run_cell(*arguments)

    monkeypatch.setattr(article, '_run_cell', counted)
    article.run_article(folder, splits=2, names=['Iris'], noise_levels=[5, 10])
    after = json.loads((folder / 'article.json').read_text())['cells']
    assert ran == [(None, 10), ('1', 10), ('2', 10), ('3', 10)]
    assert before == {key: after[key] for key in before}
    table = (folder / 'article.md').read_text()
    assert '| Iris 2 | 10 | ' in table
    with pytest.raises(OccError, match='other settings'):
        article.run_article(folder, splits=3, names=['Iris'])
    assert first['settings']['splits'] == 2


def test_cells_do_not_depend_on_what_ran_before(results, tmp_path, monkeypatch):
    _, first = results
    iris = article.BENCHMARKS[0]
    monkeypatch.setattr(
        article, 'BENCHMARKS', (replace(iris, classes={'0': '1', '2': '3', '1': '2'}),)
    )
    again = article.run_article(tmp_path, splits=2, noise_levels=[5])
    for key, cell in again['cells'].items():
        assert cell['methods'] == first['cells'][key]['methods']


def test_absent_files_are_skipped_and_named(tmp_path):
    result = article.run_article(tmp_path, splits=1, folder=tmp_path, names=['Pima'])
    assert result['cells'] == {}
    assert 'pima.csv' in result['skipped']['Pima']


def test_bad_requests_are_told(tmp_path, run_experiment):
    with pytest.raises(OccError, match='Satimage'):
        article.run_article(tmp_path, names=['Moon'])
    code, _, err = run_experiment('article --splits 0')
    assert (code, 'splits is 0' in err) == (2, True)


@pytest.mark.parametrize('target', [None, 'b'])
def test_outliers_are_a_share_of_the_targets(target):
    rng = np.random.default_rng(0)
    values = rng.normal(size=(300, 3))
    classes = np.array(['a', 'b', 'c'] * 100)
    rows, truth = contaminate(values, classes, target, 10, rng)
    targets = 300 if target is None else 100
    assert truth.sum() == targets
    assert len(rows) == round(targets * 1.1)
    own = values if target is None else values[classes == target]
    assert {tuple(row) for row in rows[truth]} == {tuple(row) for row in own}
    if target is None:
        assert (rows >= values.min(axis=0)).all()
        assert (rows <= values.max(axis=0)).all()
    else:
        others = {tuple(row) for row in values[classes != target]}
        assert {tuple(row) for row in rows[~truth]} <= others


@pytest.mark.parametrize('seed', range(5))
def test_trees_of_a_smaller_nu_are_the_first_levels_of_a_larger(seed):
    rng = np.random.default_rng(seed)
    values = np.concatenate(
        [rng.normal(size=(200, 4)), rng.normal(5.0, 1.0, (200, 4)), rng.uniform(-9, 9, (40, 4))]
    )
    grown = fit_tree(values, OCTreeSettings.article(nu=0.3))
    for nu in (0.0, 0.05, 0.1, 0.2, 0.3):
        cut = article.at_most_outside(grown, len(values), nu)
        assert cut == fit_tree(values, OCTreeSettings.article(nu=nu))


def test_printed_values_are_shares():
    targets = ['Iris', 'Pima', 'Ionosphere', 'Satimage']
    for target in targets:
        for method in METHODS:
            for noise in NOISE_LEVELS:
                assert all(0.8 < value <= 1.0 for value in printed(target, method, noise))
    assert printed('Iris 3', 'oc_tree', 10) == (1.0, 0.833)
    assert printed('Iris 3', 'ocsvm', 10) is None
