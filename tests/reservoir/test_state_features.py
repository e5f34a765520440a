import numpy as np
import pytest

from openprc.errors import MissingData, TaskError
from openprc.reservoir.features.bar_features import BarExtensions, BarLengths
from openprc.reservoir.features.base import Stacked, is_constant
from openprc.reservoir.features.channel_features import Channels
from openprc.reservoir.features.node_features import NodeDisplacements, NodePositions
from openprc.reservoir.io.state_loader import StateLoader
from openprc.schema import Trajectory

FEATURES = [
    NodePositions(),
    NodePositions([2, 0], [2, 0]),
    NodePositions(dims=[1], reference_node=0),
    NodeDisplacements(),
    NodeDisplacements(reference_node=1, dims=[2]),
    NodeDisplacements(np.array([1]), np.array([1, 2]), origin="first"),
    BarLengths(),
    BarExtensions([1]),
    Stacked([NodePositions(dims=[0]), BarLengths()]),
]


@pytest.mark.parametrize("feature", FEATURES, ids=repr)
def test_one_name_per_column(make_body, feature):
    with StateLoader(make_body()) as loader:
        matrix, names = feature.transform(loader), feature.names(loader)
    assert matrix.shape == (40, len(names))
    assert matrix.dtype == np.float64
    assert len(set(names)) == len(names)
    assert feature.config()["type"] == type(feature).__name__


def test_columns_run_over_coordinates_then_nodes(make_body):
    with StateLoader(make_body()) as loader:
        feature = NodePositions([2, 1], [2, 1])
        matrix = feature.transform(loader)
        positions = loader.positions()
        assert feature.names(loader) == ["node2.z", "node2.y", "node1.z", "node1.y"]
        np.testing.assert_array_equal(matrix[:, 0], positions[:, 2, 2])
        np.testing.assert_array_equal(matrix[:, 3], positions[:, 1, 1])


def test_reference_node_is_subtracted(make_body):
    with StateLoader(make_body()) as loader:
        relative = NodePositions([2], reference_node=1).transform(loader)
        positions = loader.positions()
        np.testing.assert_allclose(relative, positions[:, 2] - positions[:, 1], atol=1e-15)
        displaced = NodeDisplacements([2], reference_node=1).transform(loader)
        displacements = loader.displacements()
        expected = displacements[:, 2] - displacements[:, 1]
        np.testing.assert_allclose(displaced, expected, atol=1e-15)


def test_constant_columns_are_kept_and_told(make_body):
    with StateLoader(make_body()) as loader:
        feature = NodeDisplacements(reference_node=0)
        assert feature.transform(loader).shape == (40, 9)
        moving = {"node1.y", "node2.z"}
        assert set(feature.constant_columns(loader)) == set(feature.names(loader)) - moving


def test_planar_file_has_two_coordinates(make_body):
    with StateLoader(make_body(dims=2)) as loader:
        assert NodePositions().names(loader)[:2] == ["node0.x", "node0.y"]
        with pytest.raises(TaskError, match="dims is \\[2\\] and the file has 2 coordinates"):
            NodePositions(dims=[2]).transform(loader)


def test_reference_node_out_of_range(make_body):
    with (
        StateLoader(make_body()) as loader,
        pytest.raises(TaskError, match="reference_node is \\[9\\]"),
    ):
        NodePositions(reference_node=9).transform(loader)


def test_a_trajectory_will_do(make_body):
    with Trajectory(make_body()) as trajectory:
        assert NodePositions().transform(trajectory).shape == (40, 9)


def test_channels(delay_line):
    with StateLoader(delay_line) as loader:
        assert Channels().names(loader) == [f"taps.d{k}" for k in range(8)]
        np.testing.assert_array_equal(Channels("taps").transform(loader), loader.channel("taps"))
        with pytest.raises(MissingData, match="no channel 'other'"):
            Channels(["taps", "other"]).transform(loader)


def test_no_channels(make_body):
    with StateLoader(make_body()) as loader, pytest.raises(MissingData, match="no channels"):
        Channels().transform(loader)


def test_nothing_to_stack():
    with pytest.raises(TaskError, match="no features given"):
        Stacked([])


def test_round_off_is_no_change():
    rows = np.full((50, 3), 1e3)
    rows[::2, 1] = np.nextafter(1e3, 2e3)
    rows[7, 2] += 1e-6
    assert is_constant(rows).tolist() == [True, True, False]
    rows[3] = np.nan
    assert is_constant(rows).tolist() == [True, True, False]
