"""Topology from a second file, for displacements that were saved alone."""

from __future__ import annotations

import numpy as np
import pytest
from openprc_merlin import samples
from scipy.io import savemat

from openprc.errors import MissingData, SchemaError

HINGE = np.array([[2, 3, 1, 4]])
FACES = np.array([[1, 2, 3], [2, 4, 3]])


@pytest.fixture
def alone(mat, space):
    """Return a file as Sim-FAST leaves it: one array of frames, nodes, axes."""
    return mat({"Uhis": space["Uhis"].T.reshape(60, 4, 3)}, name="alone.mat")


def _write(folder, kind):
    path = folder / f"topology.{'npz' if kind == 'npz' else 'mat'}"
    if kind == "npz":
        np.savez(path, nodes=samples.REST, bars=samples.BARS - 1, hinges=HINGE - 1, faces=FACES - 1)
    elif kind == "merlin":
        savemat(path, {"Node": samples.REST, "Bars": samples.BARS, "fold": HINGE, "Trigl": FACES})
    else:
        rows = HINGE[:, [2, 0, 1, 3]]
        named = {"node_ij_mat": samples.BARS, "node_ijkl_mat": rows, "faces": FACES}
        savemat(path, {"coordinates_mat": samples.REST, **named})
    return path


@pytest.mark.parametrize("kind", ["npz", "merlin", "sim-fast"])
def test_loose_tables_connect_the_nodes(alone, load, tmp_path, kind):
    result = load(alone, reference=str(_write(tmp_path, kind)), unit="m")
    trajectory = result.trajectory
    assert trajectory.element_kinds == ("bars", "faces", "hinges")
    np.testing.assert_array_equal(trajectory.indices("hinges"), HINGE - 1)
    folded = np.concatenate([[0.0], samples.fold_angles()])
    angle = trajectory.element("hinges", "angle")[:, 0]
    np.testing.assert_allclose(angle, np.pi + folded, atol=1e-14)
    # The sample turns a rigid triangle, so no bar is strained.
    np.testing.assert_allclose(trajectory.element("bars", "strain"), 0.0, atol=1e-14)


def test_zero_based_tables_in_a_workspace_are_refused(alone, load, tmp_path):
    savemat(tmp_path / "zero.mat", {"Node": samples.REST, "Bars": samples.BARS - 1})
    with pytest.raises(SchemaError, match="node number 0 in row 2"):
        load(alone, reference=str(tmp_path / "zero.mat"))


def test_table_of_another_width_is_named(alone, load, tmp_path):
    np.savez(tmp_path / "wide.npz", nodes=samples.REST, hinges=FACES)
    with pytest.raises(MissingData, match=r"hinges is 2x3"):
        load(alone, reference=str(tmp_path / "wide.npz"))


def test_sim_fast_run_with_a_topology_of_its_own(data, load, tmp_path):
    """The recorded Sim-FAST run has 13 nodes; a chain of bars through them shows the counts."""
    rng = np.random.default_rng(0)
    nodes = rng.normal(size=(13, 3))
    bars = np.column_stack([np.arange(12), np.arange(1, 13)])
    np.savez(tmp_path / "chain.npz", nodes=nodes, bars=bars)
    file = data / "sibling_simfast_OrigamiUhis.mat"
    trajectory = load(file, reference=str(tmp_path / "chain.npz")).trajectory
    assert (trajectory.n_frames, trajectory.n_nodes) == (301, 13)
    np.testing.assert_array_equal(trajectory.positions(slice(0, 1))[0], nodes)
    length = np.linalg.norm(np.diff(trajectory.positions(), axis=1), axis=2)
    np.testing.assert_allclose(trajectory.element("bars", "length"), length, rtol=1e-14)
