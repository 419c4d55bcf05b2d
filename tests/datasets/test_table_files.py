# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
import hashlib
import sys

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from occ_constraints_pkg.datasets.reading import read_for_rules
from occ_constraints_pkg.datasets.table_files import are_table_files, is_table_file, read_tables
from occ_constraints_pkg.demonstrations.learning import learn_from_files
from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.features.feature_map import load_feature_map
from occ_constraints_pkg.learning.settings import OCTreeSettings
from occ_constraints_pkg.rules import Feature, FeatureSpace
from occ_constraints_pkg.rules.constraints_file import parse_constraints

AB = FeatureSpace((Feature('a'), Feature('b', 'm', 0.0, 9.0)))
ROWS = np.arange(12.0).reshape(6, 2)


@pytest.fixture
def npz(tmp_path):
    def write(name='table.npz', **arrays):
        np.savez(tmp_path / name, **arrays)
        return tmp_path / name

    return write


@pytest.fixture
def text(tmp_path):
    def write(content, name='table.csv'):
        (tmp_path / name).write_text(content, encoding='utf-8')
        return tmp_path / name

    return write


def test_bare_rows_get_names(npz):
    path = npz(features=ROWS.astype(np.float32))
    data, space = read_tables([path])
    assert space == FeatureSpace((Feature('x0'), Feature('x1')))
    np.testing.assert_array_equal(data.values, ROWS)
    assert data.values.dtype == np.float64
    np.testing.assert_array_equal(data.stamps_ns, np.arange(6))
    assert set(data.episodes) == {0}
    assert data.true_cost is None
    digest = hashlib.sha256(path.read_bytes()).hexdigest()
    assert data.sources == ({'name': 'table.npz', 'sha256': digest, 'rows': 6},)


def test_an_archive_may_say_everything(npz):
    path = npz(
        features=ROWS,
        names=['a', 'b'],
        units=['1', 'm'],
        bounds=[[-np.inf, np.inf], [0.0, 9.0]],
        cost=np.arange(6) % 2,
        episode=[7, 7, 3, 3, 3, 9],
        actions=np.zeros((6, 2)),
    )
    data, space = read_tables([path])
    assert space == AB
    np.testing.assert_array_equal(data.episodes, [1, 1, 0, 0, 0, 2])
    np.testing.assert_array_equal(data.true_cost, [0, 1, 0, 1, 0, 1])


def test_families(npz):
    features = tuple(Feature(name, 'm', 0.0, 9.0, 'lidar') for name in ('left', 'right'))
    _, space = read_tables(
        [
            npz(
                features=ROWS,
                names=['left', 'right'],
                units=['m', 'm'],
                families=['lidar', 'lidar'],
                bounds=[[0, 9], [0, 9]],
            )
        ]
    )
    assert space == FeatureSpace(features)


def test_the_first_of_three_axes_is_the_episode(npz):
    values = np.arange(24.0).reshape(3, 4, 2)
    data, _ = read_tables([npz(features=values, true_cost=values[..., 0])])
    np.testing.assert_array_equal(data.values, values.reshape(12, 2))
    np.testing.assert_array_equal(data.episodes, np.repeat([0, 1, 2], 4))
    np.testing.assert_array_equal(data.true_cost, values[..., 0].ravel())


def test_columns_are_found_by_name(npz, text):
    first = npz(features=np.ones((2, 3)) * [1, 2, 3], names=['b', 'other', 'a'], cost=[0, 1])
    second = text('episode,note,b,a\n4,hello,5,6\n4,"a, b",7,8\n5,,9,\n')
    data, space = read_tables([first, second], AB)
    assert space is AB
    np.testing.assert_array_equal(data.values, [[3, 1], [3, 1], [6, 5], [8, 7], [np.nan, 9]])
    np.testing.assert_array_equal(data.episodes, [0, 0, 1, 1, 2])
    np.testing.assert_array_equal(data.true_cost, [0, 1, np.nan, np.nan, np.nan])
    np.testing.assert_array_equal(data.stamps_ns, [0, 1, 0, 1, 2])
    assert [source['rows'] for source in data.sources] == [2, 3]


def test_columns_that_nobody_asks_for_need_no_name(text):
    data, _ = read_tables([text(',b,a,,c,c\n0,1,2,,x,y\n')], AB)
    np.testing.assert_array_equal(data.values, [[2, 1]])


def test_a_spreadsheet(text):
    data, space = read_tables([text('\ufeff"a b", cost ,c\r\n1,0,-2.5e3\r\n\r\n"4",1,\r\n')])
    assert space.names == ('a b', 'c')
    np.testing.assert_array_equal(data.values, [[1, -2500], [4, np.nan]])
    np.testing.assert_array_equal(data.true_cost, [0, 1])


@given(
    values=hnp.arrays(
        np.float64,
        hnp.array_shapes(min_dims=2, max_dims=2, max_side=6),
        elements=st.floats(allow_subnormal=True),
    ),
    empty=st.booleans(),
)
def test_numbers_come_back_bit_for_bit(tmp_path_factory, values, empty):
    path = tmp_path_factory.mktemp('csv') / 'table.csv'
    names = ','.join(f'c{index}' for index in range(values.shape[1]))
    lines = [','.join(map(repr, row)) for row in values.tolist()]
    if empty:
        # One empty cell sends the whole file the careful way.
        lines.append(',' * (values.shape[1] - 1) if values.shape[1] > 1 else 'nan')
        values = np.vstack([values, np.full(values.shape[1], np.nan)])
    path.write_text('\n'.join([names, *lines]))
    np.testing.assert_array_equal(read_tables([path])[0].values, values)


FAULTY_TEXT = {
    'a,b\n1,2\n3,x\n': "table.csv, line 3, column 'b': got 'x'; allowed is a number",
    'a,b\n1,2\n"3\n",4\n5,y\n': "line 5, column 'b': got 'y'",
    'a,b\n1,2\n3,4,5\n': 'line 3: got 3 cells; allowed are 2',
    'a,b\n1,2,3\n4,5,6\n': 'line 2: got 3 cells; allowed are 2',
    'a,b\n1\n': 'line 2: got 1 cells; allowed are 2',
    'a,a\n1,2\n': "two columns 'a'",
    'a,b\n': 'has no rows',
    '': 'is empty',
    '1,2\n3,4\n': 'line 1: got the numbers 1, 2',
    'cost,episode\n1,2\n': 'no column of a feature; its columns are cost, episode',
    'a,cost,true_cost\n1,2,3\n': "both 'cost' and 'true_cost'",
    'a,episode\n1,nan\n': "not finite in the column 'episode'",
    'a,\n1,2\n': 'a column without a name',
    ',a,\n0,1,2\n': 'a column without a name',
}


@pytest.mark.parametrize('content', FAULTY_TEXT)
def test_a_fault_in_a_text_file_is_named(text, content):
    with pytest.raises(OccError, match='table.csv') as caught:
        read_tables([text(content)])
    assert FAULTY_TEXT[content] in str(caught.value)


def test_a_row_too_long_is_refused_also_where_some_columns_are_wanted(text):
    with pytest.raises(OccError, match='line 3: got 4 cells'):
        read_tables([text('a,b,c\n1,2,3\n1,1,2,3\n')], AB)


FAULTY_ARRAYS = {
    "no array 'features'": {'rows': ROWS},
    "'features' has the shape (6,)": {'features': ROWS[:, 0]},
    "'features' has the shape (6, 0)": {'features': ROWS[:, :0]},
    "'features' is of type <U1": {'features': np.array([['a']])},
    "'features' is of type complex128": {'features': ROWS + 1j},
    'has no rows': {'features': ROWS[:0]},
    'damaged or no archive of plain arrays': {'features': np.array([[None]])},
    "'names' has the shape (3,)": {'features': ROWS, 'names': ['a', 'b', 'c']},
    "'names' has the shape (2,) and type int64": {'features': ROWS, 'names': np.array([1, 2])},
    'a column without a name': {'features': ROWS, 'names': ['a', '']},
    'named twice': {'features': ROWS, 'names': ['a', 'a']},
    "'units' has the shape ()": {'features': ROWS, 'units': 'm'},
    "'bounds' has the shape (2,)": {'features': ROWS, 'bounds': [0.0, 1.0]},
    'has bounds [1.0, 0.0]': {'features': ROWS, 'bounds': [[1.0, 0.0], [0.0, 1.0]]},
    "'cost' has the shape (5,)": {'features': ROWS, 'cost': np.zeros(5)},
    "'episode' has the shape (1, 6)": {'features': ROWS, 'episode': np.zeros((1, 6))},
    'tells episodes apart already': {'features': ROWS[None], 'episode': np.zeros((1, 6))},
}


@pytest.mark.parametrize('told', FAULTY_ARRAYS)
def test_a_fault_in_an_archive_is_named(npz, told):
    with pytest.raises(OccError, match='table.npz') as caught:
        read_tables([npz(**FAULTY_ARRAYS[told])])
    assert told in str(caught.value)


@pytest.mark.parametrize('content', [b'', b'hello', b'PK\x03\x04 and no more', b'\x93NUMPY'])
def test_what_is_no_archive_is_told(tmp_path, content):
    (tmp_path / 'table.npz').write_bytes(content)
    with pytest.raises(OccError, match='table.npz is damaged or no archive'):
        read_tables([tmp_path / 'table.npz'])


def test_a_damaged_archive_is_told(npz):
    path = npz(features=np.arange(4000.0).reshape(-1, 2))
    data = bytearray(path.read_bytes())
    data[2000] ^= 0xFF
    path.write_bytes(data)
    with pytest.raises(OccError, match='damaged'):
        read_tables([path])


@pytest.mark.parametrize('name', ['nowhere.npz', 'nowhere.csv'])
def test_no_such_file(tmp_path, name):
    with pytest.raises(OccError, match=f'cannot read .*{name}: No such file'):
        read_tables([tmp_path / name])


def test_what_a_space_asks_for_must_be_there(npz, text):
    with pytest.raises(OccError, match="no column 'b'; its columns are a, c") as caught:
        read_tables([text('a,c\n1,2\n')], AB)
    assert str(caught.value).count('\n') == 0
    with pytest.raises(OccError, match="no column 'a'; its columns are x0, x1"):
        read_tables([npz(features=ROWS)], AB)
    with pytest.raises(OccError, match="the unit 'ft' for the feature 'b'; allowed here is 'm'"):
        read_tables([npz(features=ROWS, names=['a', 'b'], units=['1', 'ft'])], AB)


def test_further_files_must_have_the_columns_of_the_first(npz, text):
    with pytest.raises(OccError, match="table.csv has no column 'x1'"):
        read_tables([npz(features=ROWS), text('x0,x2\n1,2\n')])


def test_parquet(tmp_path):
    pyarrow = pytest.importorskip('pyarrow')
    parquet = pytest.importorskip('pyarrow.parquet')
    path = tmp_path / 'table.parquet'
    columns = {
        'b': pyarrow.array([1, None, 3], pyarrow.int32()),
        'note': ['x', 'y', 'z'],
        'a': pyarrow.array([True, False, True]),
        'cost': pyarrow.array([0.0, 1.0, 0.0], pyarrow.float32()),
        'episode': [2, 2, 1],
    }
    parquet.write_table(pyarrow.table(columns), path)
    data, _ = read_tables([path], AB)
    np.testing.assert_array_equal(data.values, [[1, 1], [0, np.nan], [1, 3]])
    np.testing.assert_array_equal(data.true_cost, [0, 1, 0])
    np.testing.assert_array_equal(data.episodes, [1, 1, 0])
    with pytest.raises(OccError, match="column 'note': got string; allowed are numbers"):
        read_tables([path])
    path.write_bytes(b'no such thing')
    with pytest.raises(OccError, match='is not a Parquet file'):
        read_tables([path])


def test_parquet_without_pyarrow(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, 'pyarrow', None)
    with pytest.raises(OccError, match="table.parquet needs the module 'pyarrow'"):
        read_tables([tmp_path / 'table.parquet'])


def test_tables_are_told_from_recordings(tmp_path):
    (tmp_path / 'bag.csv').mkdir()
    assert not is_table_file(tmp_path / 'bag.csv')
    assert are_table_files(['a.npz', 'b.csv', 'c.parquet'])
    assert not are_table_files(['bag', 'other.mcap'])
    with pytest.raises(OccError, match='the table a.npz and the recording bag'):
        are_table_files(['a.npz', 'bag'])
    with pytest.raises(OccError, match='bag.mcap is not a table'):
        read_tables(['bag.mcap'])
    with pytest.raises(OccError, match='no tables to read'):
        read_tables([])


def test_learning_from_tables(npz):
    rng = np.random.default_rng(0)
    values = rng.random((8, 50, 2))
    path = npz(features=values, names=['x', 'y'], bounds=[[0, 1], [0, 1]])
    settings = OCTreeSettings()
    constraints = learn_from_files([path], None, settings, rng=np.random.default_rng(0))
    assert constraints.feature_map is None
    assert constraints.coverage['held_out_episodes'] == 2
    read_back = parse_constraints(constraints.dumps(), 'learned')
    assert read_back.provenance['bags'] == [dict(read_tables([path])[0].sources[0])]
    assert not read_back.is_edited
    data = read_for_rules([path], read_back, 'learned')
    np.testing.assert_array_equal(data.values, values.reshape(400, 2))
    with pytest.raises(OccError, match='learned has no feature_map.* allowed are tables'):
        read_for_rules(['bag'], read_back, 'learned')


def test_rules_of_a_table_can_be_monitored_with_a_feature_map(npz):
    feature_map = load_feature_map('simple_nav')
    path = npz(features=np.random.default_rng(0).random((99, 2)), names=['y', 'x'])
    constraints = learn_from_files(
        [path], feature_map, OCTreeSettings(), rng=np.random.default_rng(0)
    )
    assert constraints.feature_map == feature_map.to_document()
    assert constraints.rule_set.space == feature_map.space
    assert read_for_rules([path], constraints, 'learned').names == ('x', 'y')
