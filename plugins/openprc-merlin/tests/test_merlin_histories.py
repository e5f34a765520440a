"""Histories, workspaces that contradict themselves, and one test for each message."""

from __future__ import annotations

import numpy as np
import pytest
from openprc_merlin import histories, samples

from openprc.errors import ConfigError, MissingData, SchemaError

PHI = samples.fold_angles()


# --- histories -------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["U_his", "Uhis", "U_history", "uhis", "U_his2", "u_hist_3"])
def test_names_of_displacements(name):
    assert histories.is_displacement(name)


@pytest.mark.parametrize("name", ["LF_his", "Fhis", "load_his", "LF_his2", "load_history", "Lhist"])
def test_names_of_loads(name):
    assert histories.is_load(name) == (name != "Lhist")


def test_renamed_and_transposed_histories(mat, load, space):
    plain = load(mat(space)).trajectory
    space["answer"] = space.pop("Uhis").T
    space["factors"] = space.pop("Fhis").T
    result = load(mat(space))
    np.testing.assert_array_equal(result.trajectory.positions(), plain.positions())
    np.testing.assert_array_equal(result.trajectory.input("load").value, plain.input("load").value)
    assert "answer is taken for the displacement history by its shape" in result.text
    assert "transposed from what MERLIN writes" in result.text
    assert "factors is taken for the load history by its length" in result.text


def test_square_history_is_read_as_merlin_writes_it(mat, load, space):
    short = samples.workspace(12)
    assert short["Uhis"].shape == (12, 12)
    tr = load(mat(short)).trajectory
    np.testing.assert_allclose(tr.positions()[-1, 3, 2], np.sin(1.1))


def test_roundoff_imaginary_part_is_dropped(mat, load, space):
    plain = load(mat(space)).trajectory.positions()
    space["Uhis"] = space["Uhis"] + 1e-15j
    result = load(mat(space))
    np.testing.assert_array_equal(result.trajectory.positions(), plain)
    assert "imaginary parts up to 1e-15 were dropped" in result.text


def test_divergence_is_cut_off_with_a_note(mat, load, space):
    space["Uhis"][:, 50:] = np.nan
    result = load(mat(space))
    assert result.trajectory.n_frames == 51
    assert "diverged at increment 51; 10 increments" in result.text
    np.testing.assert_allclose(
        result.trajectory.input("load").value[-1, 0], samples.load_factors(PHI)[49]
    )


def test_unfilled_end_is_pointed_out(mat, load, space):
    space["Uhis"][:, 55:] = 0.0
    result = load(mat(space))
    assert result.trajectory.n_frames == 61
    assert "last 5 increments of Uhis are exactly zero" in result.text


def test_initial_state_in_front_is_not_doubled(mat, load, space):
    plain = load(mat(space)).trajectory
    space["Uhis"] = np.hstack([np.zeros((12, 1)), space["Uhis"]])
    space["Fhis"] = np.vstack([[[0.0]], space["Fhis"]])
    result = load(mat(space))
    np.testing.assert_array_equal(result.trajectory.positions(), plain.positions())
    np.testing.assert_array_equal(result.trajectory.input("load").value, plain.input("load").value)
    assert "begins with the initial state" in result.text


def test_stored_results_follow_when_the_initial_state_is_in_front(mat, load, space):
    space["Uhis"] = np.hstack([np.zeros((12, 1)), space["Uhis"]])
    space["Fhis"] = np.vstack([[[0.0]], space["Fhis"]])
    space["STAT"] = {
        "fold": {"Angle": np.pi + np.concatenate([[0.0], PHI])[None]},
        "bend": {"Angle": np.zeros((0, 61))},
    }
    assert "stored angles" not in load(mat(space)).text
    space["STAT"]["fold"]["Angle"][0, 1:] = np.pi
    assert "60 stored angles differ" in load(mat(space)).text


def test_initial_displacement_is_frame_zero(mat, load, space):
    space["truss"]["U0"] = np.zeros((12, 1))
    space["truss"]["U0"][11] = 0.01
    tr = load(mat(space)).trajectory
    assert tr.positions()[0, 3, 2] == 0.01
    assert tr.node("rest")[3, 2] == 0.0


def spoil(space, **changes):
    """Set entries such as truss__Bars=...; None removes."""
    for key, value in changes.items():
        owner, _, name = key.partition("__")
        table, name = (space[owner], name) if name else (space, owner)
        if value is None:
            del table[name]
        else:
            table[name] = value
    return space


@pytest.mark.parametrize(
    ("changes", "error", "words"),
    [
        ({"Uhis": None}, MissingData, "no displacement history among: AnalyInputOpt struct"),
        ({"Uhis": np.zeros((13, 9))}, SchemaError, "shape 13x9 and the rest shape has 4 nodes"),
        ({"Uhis": np.ones((12, 60)) * (1 + 1j)}, SchemaError, "complex numbers with imaginary"),
        ({"Uhis": np.full((12, 60), np.nan)}, SchemaError, "huge displacements at increment 1"),
        ({"Uhis": np.zeros((12, 0))}, SchemaError, "has no increment"),
        ({"U_his": np.ones((12, 60))}, ConfigError, "several variables could be the displacement"),
        ({"LF_his": np.ones((60, 1))}, ConfigError, "several variables could be the load history"),
        ({"Fhis": np.zeros((7, 1))}, SchemaError, "shape 7x1 for 60 increments"),
        ({"Fhis": np.full((60, 1), np.inf)}, SchemaError, "60 values that are not finite"),
        ({"truss__Bars": np.array([[1.0, 9.0]])}, SchemaError, "node number 9 in row 1"),
        ({"truss__Bars": np.array([[0.0, 1.0]])}, SchemaError, "counts nodes from 1"),
        ({"truss__Bars": np.array([[1.0, 2.5]])}, SchemaError, "node number 2.5"),
        ({"truss__Bars": np.array([[1.0, np.nan]])}, SchemaError, "node number nan"),
        ({"truss__Bars": np.ones((5, 3))}, SchemaError, "shape 5x3"),
        ({"truss__Bars": np.array([[1.0, 1.0]]), "truss__L": None}, SchemaError, "rest length 0"),
        ({"truss__L": np.ones((3, 1))}, SchemaError, "3 values, 0 of them not finite"),
        (
            {"truss__Node": np.full((4, 3), np.nan)},
            SchemaError,
            "NaN, infinite or huge coordinates",
        ),
        ({"truss__Node": np.ones((4, 2))}, SchemaError, "shape 4x2"),
        ({"truss": None, "Node": None}, MissingData, r"no rest coordinates beside Uhis \(12x60\)"),
        ({"angles__fold": np.array([[2.0, 3.0, 1.0]])}, SchemaError, "4 node numbers a row"),
    ],
)
def test_messages(mat, load, space, tmp_path, changes, error, words):
    path = mat(spoil(space, **changes))
    with pytest.raises(error, match=words):
        load(path)
    assert sorted(file.name for file in tmp_path.iterdir()) == ["run.mat"]


def test_hole_in_the_history_is_an_error(mat, load, space):
    space["Uhis"][:, 20] = np.inf
    with pytest.raises(SchemaError, match="at increment 21, and 39 finite increments after it"):
        load(mat(space))


def test_missing_panel_centres_are_explained(mat, load, space):
    panel = np.empty((1, 1), dtype=object)
    panel[0, 0] = np.array([[1.0, 2.0, 4.0, 3.0]])
    path = mat({"Node": space["Node"], "Panel": panel, "Uhis": np.zeros((15, 8))})
    with pytest.raises(SchemaError, match="save truss as well, whose Node holds them"):
        load(path)


def test_workspace_without_truss_has_points_and_faces(mat, load, space):
    panel = np.empty((1, 1), dtype=object)
    panel[0, 0] = np.array([[1.0, 2.0, 4.0, 3.0]])
    result = load(mat({"Node": space["Node"], "Panel": panel, "U_his": space["Uhis"]}))
    assert result.trajectory.element_kinds == ("faces",)
    np.testing.assert_array_equal(result.trajectory.indices("faces"), [[0, 1, 3], [0, 3, 2]])
    assert "the file holds no load history" in result.text
    assert "panels were cut into triangles" in result.text


def test_supports_without_fixed_dofs(mat, load, space):
    del space["truss"]["FixedDofs"]
    space["Supp"] = np.array([[1, 1, 1, 1], [2, 1, 0, 1]], dtype=float)
    tr = load(mat(space)).trajectory
    np.testing.assert_array_equal(tr.node("fixed"), [1, 0, 0, 0])
