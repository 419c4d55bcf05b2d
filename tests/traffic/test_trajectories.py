# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
import errno
import os

import numpy as np
import pytest
from occ_constraints_pkg.datasets.extraction import extract
from occ_constraints_pkg.documents import parse_yaml
from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.features.feature_map import load_feature_map
from occ_constraints_pkg.features.table import Table
from occ_constraints_pkg.features.table_messages import TableSerializer
from occ_constraints_pkg.traffic import trajectories as module
from occ_constraints_pkg.traffic.trajectories import Trajectories, write_trajectories
from rosbags.typesys import Stores, get_typestore


@pytest.fixture
def trajectories():
    rng = np.random.default_rng(0)
    return Trajectories(
        names=('v_x', 'p_rel4'),
        values=rng.uniform(0.0, 40.0, (7, 2)),
        vehicle=np.array([9, 9, 9, 4, 4, 9007, 9007]),
        time=np.array([3.0, 3.1, 3.2, 0.0, 0.1, 3.0, 3.5]),
        source={'format': 'made up', 'licence': 'none'},
    )


def test_a_bag_holds_one_episode_for_each_vehicle(trajectories, tmp_path):
    done = []
    write_trajectories(trajectories, tmp_path / 'bag', progress=lambda *pair: done.append(pair))
    data = extract([tmp_path / 'bag'], load_feature_map('highway_following'))
    np.testing.assert_array_equal(data.values, trajectories.values)
    assert data.episodes.tolist() == [0, 0, 0, 1, 1, 2, 2]
    seconds = (data.stamps_ns - 10**9) / 1e9
    np.testing.assert_allclose(seconds, [0.0, 0.1, 0.2, 1.2, 1.3, 2.3, 2.8])
    assert data.warnings == ()
    assert done[-1] == (7, 7)
    metadata = parse_yaml((tmp_path / 'bag' / 'metadata.yaml').read_text(), 'metadata')
    assert metadata['rosbag2_bagfile_information']['custom_data'] == trajectories.source
    assert sorted(os.listdir(tmp_path)) == ['bag']


def test_rows_are_serialized_as_messages_are():
    names, values = ('a', 'b_longer', 'c'), np.array([1.5, -np.pi, 1e300])
    serializer = TableSerializer(names, 'road')
    serializer.serialize(values * 2.0, 5)
    data = serializer.serialize(values, 12_345_678_901)
    message = get_typestore(Stores.ROS2_JAZZY).deserialize_cdr(data, 'sensor_msgs/msg/PointCloud2')
    assert (message.header.stamp.sec, message.header.stamp.nanosec) == (12, 345_678_901)
    assert message.header.frame_id == 'road'
    table = Table.from_message(message)
    assert table.names == names
    np.testing.assert_array_equal(table.values, [values])


def test_nothing_is_written_over(trajectories, tmp_path):
    (tmp_path / 'bag').mkdir()
    with pytest.raises(OccError, match='bag exists already; allowed is a new directory'):
        write_trajectories(trajectories, tmp_path / 'bag')


def test_nothing_is_half_written(trajectories, tmp_path, monkeypatch):
    def fail(*_):
        raise OSError(errno.ENOSPC, 'No space left on device')

    monkeypatch.setattr('occ_constraints_pkg.rosbag.mcap_writer.McapOutput.add', fail)
    with pytest.raises(OccError, match=r'^cannot write \S+/deep/bag: No space left on device$'):
        write_trajectories(trajectories, tmp_path / 'deep' / 'bag')
    assert os.listdir(tmp_path / 'deep') == []


def test_an_interrupted_import_leaves_nothing(trajectories, tmp_path, monkeypatch):
    def interrupt(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(module.TableSerializer, 'serialize', interrupt)
    with pytest.raises(KeyboardInterrupt):
        write_trajectories(trajectories, tmp_path / 'bag')
    assert os.listdir(tmp_path) == []


def test_shapes_must_fit():
    with pytest.raises(OccError, match=r'2 rows and 1 features got values of shape \(2, 3\)'):
        Trajectories(('a',), np.zeros((2, 3)), np.zeros(2), np.zeros(2))
