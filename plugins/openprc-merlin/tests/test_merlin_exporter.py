"""Export to MERLIN: what is written, that it comes back, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest
from openprc_merlin import exporter, exporter_mesh, samples
from openprc_merlin.exporter import MerlinExporter
from scipy.io import loadmat

from openprc.errors import ConfigError, MissingData, ResultExists, SchemaError, UnsupportedScene
from openprc.hooks import export_file, import_file
from openprc.schema import Provenance, Trajectory, TrajectoryWriter

RUNS = (
    "merlin1_kresling_folding",
    "merlin1_miura_bending",
    "merlin1_miura_folding",
    "merlin2_gmiura_n5b8_disp",
    "merlin2_kresling_n4b5_disp",
    "merlin2_polygon_n5b8_force",
    "merlin2_simplefold_n4b5_disp",
    "merlin2_waterbomb_n5b8_disp",
)


def same_run(one, two):
    """Compare everything that MERLIN has a place for, to the last digits."""
    size = np.abs(one.positions()).max()
    np.testing.assert_allclose(two.positions(), one.positions(), rtol=0, atol=1e-15 * size)
    np.testing.assert_array_equal(two.time, one.time)
    assert (two.time_unit, two.position_unit) == (one.time_unit, one.position_unit)
    assert two.element_kinds == one.element_kinds
    for kind in one.element_kinds:
        np.testing.assert_array_equal(two.indices(kind), one.indices(kind))
        for name in ("rest_length", "rest_angle", "stiffness", "area", "crease_length",
                     "moment_coefficient", "moment_exponent", "kind_code"):  # fmt: skip
            path = f"/topology/{kind}/{name}"
            assert two.has(path) == one.has(path), path
            if one.has(path):
                stored = one.element_static(kind, name)
                np.testing.assert_allclose(two.element_static(kind, name), stored, rtol=1e-14)
    assert two.inputs == one.inputs
    for name in one.inputs:
        assert two.input(name).columns == one.input(name).columns
        value = one.input(name).value
        np.testing.assert_allclose(two.input(name).value, value, rtol=0, atol=2e-15 * size)
    for name in one.channels:
        np.testing.assert_array_equal(two.channel(name), one.channel(name))
    for name in one.extension_names("openprc-merlin"):
        stored = one.extension("openprc-merlin", name)
        np.testing.assert_array_equal(two.extension("openprc-merlin", name), stored)


@pytest.mark.parametrize("name", RUNS)
def test_recorded_runs_come_back(data, load, tmp_path, name):
    first = load(data / f"{name}.mat")
    export_file(first.path, tmp_path / "again.mat")
    second = load(tmp_path / "again.mat", verify="true")
    same_run(first.trajectory, second.trajectory)
    residual = float(second.text.split("largest residual ")[1].split()[0])
    assert residual < (1e-4 if "miura_folding" in name else 1e-7)


@pytest.mark.parametrize("unit", ["mm", "m"])
def test_units_and_instants_come_back_without_options(mat, load, space, tmp_path, unit):
    first = load(mat(space), unit=unit, force_unit="mN", dt=0.25)
    export_file(first.path, tmp_path / "again.mat")
    second = load(tmp_path / "again.mat")
    assert second.trajectory.time_kind == "physical"
    same_run(first.trajectory, second.trajectory)
    assert "MERLIN stores no unit" not in second.text


def test_a_pause_at_the_start_is_not_taken_for_the_initial_state(mat, load, space, tmp_path):
    space["Uhis"][:, 0] = 0.0
    space["truss"]["U0"] = np.full((12, 1), 1e-3)
    space["Uhis"][:, 0] = 1e-3
    space["Uhis"][:, 1] = 1e-3
    first = load(mat(space))
    export_file(first.path, tmp_path / "again.mat")
    same_run(first.trajectory, load(tmp_path / "again.mat").trajectory)


@pytest.mark.parametrize("name", ["merlin1_miura_bending", "merlin2_gmiura_n5b8_disp"])
def test_variables_are_those_that_merlin_made(data, load, tmp_path, name):
    source = load(data / f"{name}.mat")
    export_file(source.path, tmp_path / "again.mat")
    ours, theirs = (loadmat(path) for path in (tmp_path / "again.mat", data / f"{name}.mat"))
    for struct, names in (
        ("truss", ("Node", "Bars", "Trigl", "L", "FixedDofs", "U0")),
        ("angles", ("fold", "bend", "pf0", "pb0")),
    ):
        for field in names:
            a, b = ours[struct][0, 0][field], theirs[struct][0, 0][field]
            assert a.dtype == np.float64, field
            np.testing.assert_allclose(a, b, rtol=1e-14, err_msg=f"{struct}.{field}")
    # B maps displacements to elongations: its values, not its bits, are MERLIN's.
    difference = ours["truss"][0, 0]["B"] - theirs["truss"][0, 0]["B"]
    assert abs(difference).max() < 1e-14
    np.testing.assert_allclose(ours["Node"], theirs["Node"], rtol=1e-15)
    panels = [[set(map(int, p.ravel())) for p in d["Panel"].ravel()] for d in (ours, theirs)]
    assert sorted(map(sorted, panels[0])) == sorted(map(sorted, panels[1]))
    if "Data" in theirs:
        for field, tolerance in (("Exbar", 1e-14), ("FdAngle", 1e-7), ("LFdAngle", 1e-14),
                                 ("BdAngle", 1e-7), ("LBdAngle", 1e-14)):  # fmt: skip
            a, b = ours["Data"][0, 0][field], theirs["Data"][0, 0][field]
            np.testing.assert_allclose(a, b, rtol=0, atol=tolerance * 10)


def test_names_of_the_first_merlin(mat, load, space, tmp_path):
    source = load(mat(space))
    (path,) = MerlinExporter().export(
        source.trajectory, tmp_path / "v1.mat", options={"version": "1"}
    )
    found = loadmat(path)
    assert {"U_his", "LF_his", "F", "Data", "limlft"} - set(found) == {"limlft"}
    assert found["angles"]["kpf"][0, 0].shape == (1, 1)
    again = load(path).trajectory
    np.testing.assert_array_equal(again.positions(), source.trajectory.positions())
    np.testing.assert_array_equal(again.input("load").value, source.trajectory.input("load").value)


def test_equal_runs_are_equal_files(mat, load, space, tmp_path):
    source = load(mat(space))
    texts = []
    for name in ("a.mat", "b.mat"):
        export_file(source.path, tmp_path / name, options={"stride": 7})
        texts.append((tmp_path / name).read_bytes())
    assert texts[0] == texts[1]
    assert texts[0].startswith(b"MATLAB 5.0 MAT-file")
    found = loadmat(tmp_path / "a.mat")
    kept = source.trajectory.positions(slice(7, None, 7))[:, 3, 2]
    np.testing.assert_array_equal(found["Uhis"][11], kept - samples.REST[3, 2])


def test_laws_of_a_simulated_sheet_become_constants(tmp_path):
    """k = C0 A / L for bars, K L for hinges; limits in degrees; a signal becomes the load."""
    path = _sheet(tmp_path / "run.h5", static={
        "stiffness": (np.full(5, 40.0), "N/m"), "rest_length": (np.full(5, 2.0), "m"),
        "prestress": (np.full(5, 0.25), "1"),
    }, hinge_static={
        "stiffness": (np.array([0.4]), "N*m/rad"), "rest_angle": (np.array([3.0]), "rad"),
        "limit_low": (np.array([np.pi / 4]), "rad"), "limit_high": (np.array([5.5]), "rad"),
    })  # fmt: skip
    with Trajectory(path) as trajectory:
        made = exporter.workspace(trajectory)
    assert made["C0"] * made["truss"]["A"][0, 0] / made["truss"]["L"][0, 0] == 40.0
    np.testing.assert_array_equal(made["truss"]["L"], 2.5)
    assert made["angles"]["Kf"][0, 0] == pytest.approx(0.4 / 2.5)
    assert made["limlft"] == 45.0
    assert made["AnalyInputOpt"]["LoadType"] == "Force"
    assert np.flatnonzero(made["AnalyInputOpt"]["Load"]).tolist() == [11]
    assert "only their product enters" in made["openprc"]["note"]
    # Without faces, the triangles are those beside the hinge.
    assert {frozenset(row) for row in made["truss"]["Trigl"].tolist()} == {
        frozenset({1, 2, 3}),
        frozenset({2, 3, 4}),
    }


def test_native_runs_that_say_their_load_are_whole_workspaces(tmp_path):
    """What a runner of the plugin keeps under its extension is the reference load and supports."""
    path = tmp_path / "native.h5"
    reference = np.zeros((4, 3))
    reference[3, 2] = 2.5
    held = np.ones((4, 3), "u1")
    held[3] = 0
    with TrajectoryWriter(path, provenance=Provenance("test")) as writer:
        writer.declare_time(unit="1", kind="pseudo")
        writer.declare_nodes(4, 3, unit="m", rest=samples.REST)
        writer.declare_elements("bars", samples.BARS - 1)
        static = {"law": (["enhanced-linear"], None), "limit_low": (np.array([0.5]), "rad"),
                  "limit_high": (np.array([5.5]), "rad"), "rest_angle": (np.array([3.0]), "rad"),
                  "stiffness": (np.array([0.4]), "N*m/rad")}  # fmt: skip
        writer.declare_elements("hinges", [[1, 2, 0, 3]], static=static)
        writer.declare_input("load", ["load factor"], quantity="load factor", unit="1")
        writer.declare_extension("openprc-merlin", "1.0")
        writer.put_extension("openprc-merlin", "held", held)
        writer.put_extension("openprc-merlin", "reference_load", reference, unit="N")
        for frame in range(3):
            points = samples.REST + np.outer([0, 0, 0, 1], [0, 0, 0.1 * frame])
            writer.append(float(frame), positions=points, inputs={"load": [0.25 * frame]})
    with Trajectory(path) as trajectory:
        made = exporter.workspace(trajectory)
    assert made["AnalyInputOpt"]["LoadType"] == "Force"
    np.testing.assert_array_equal(made["Load"], [[4.0, 0.0, 0.0, 2.5]])
    np.testing.assert_array_equal(made["Fhis"], [[0.25], [0.5]])
    assert made["truss"]["FixedDofs"].ravel().tolist() == list(range(1, 10))
    assert made["limlft"] == pytest.approx(np.rad2deg(0.5))


def test_planar_bodies_get_a_held_third_axis(tmp_path):
    path = tmp_path / "flat.h5"
    with TrajectoryWriter(path, provenance=Provenance("test")) as writer:
        writer.declare_nodes(3, 2, unit="m", rest=[[0, 0], [1, 0], [0, 1]])
        writer.declare_elements("bars", [[0, 1], [1, 2], [2, 0]])
        writer.declare_elements("faces", [[0, 1, 2]])
        for frame in range(3):
            writer.append(0.1 * frame, positions=[[0, 0], [1, 0], [0, 1 + 0.1 * frame]])
    with Trajectory(path) as trajectory:
        made = exporter.workspace(trajectory)
    assert made["truss"]["FixedDofs"].ravel().tolist() == [3.0, 6.0, 9.0]
    assert "z is 0 and held" in made["openprc"]["note"]
    # A run that begins with frame 0 at rest moves from the next frame on.
    assert made["Uhis"][7].tolist() == pytest.approx([0.1, 0.2])


def test_panels_are_joined_over_bends():
    square = np.array([[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]])
    spokes = {(0, 4), (1, 4), (2, 4), (3, 4)}
    assert exporter_mesh.merged_panels(square, spokes, n_nodes=5) == (((0, 1, 2, 3),), 4)
    # A centre that does not come last cannot have been appended.
    moved = np.array([[4, 1, 0], [1, 2, 0], [2, 3, 0], [3, 4, 0]])
    panels, n_input = exporter_mesh.merged_panels(
        moved, {(0, 1), (0, 2), (0, 3), (0, 4)}, n_nodes=5
    )
    assert (len(panels), n_input) == (4, 5)
    strip = np.array([[0, 1, 2], [0, 2, 3]])
    assert exporter_mesh.merged_panels(strip, {(0, 2)}, n_nodes=4)[0] == ((0, 1, 2, 3),)


# --- refusals --------------------------------------------------------------------------------


def _sheet(path, *, static=None, hinge_static=None, hinges=((1, 2, 0, 3),), bars=None, **nodes):
    """Write the two triangles of the sample as a simulated experiment would be."""
    nodes.setdefault("rest", samples.REST)
    table = samples.BARS - 1 if bars is None else bars
    with TrajectoryWriter(path, provenance=Provenance("test")) as writer:
        writer.declare_nodes(4, 3, unit="m", **nodes)
        if len(table):
            writer.declare_elements("bars", table, static=static)
        if hinges:
            writer.declare_elements("hinges", np.array(hinges), static=hinge_static)
        writer.declare_input("u", ["value"], quantity="force", unit="N", targets=["node 3 z"])
        for frame in range(3):
            points = samples.REST + np.outer([0, 0, 0, 1], [0, 0, 0.1 * frame])
            writer.append(0.5 * frame, positions=points, inputs={"u": [float(frame)]})
    return path


@pytest.mark.parametrize(
    ("changes", "error", "words"),
    [
        ({"bars": []}, MissingData, "no bars"),
        ({"hinges": ()}, MissingData, "no faces"),
        ({"rest": None}, MissingData, "no rest shape"),
        ({"bars": samples.BARS[1:] - 1}, UnsupportedScene, "hinge 0 on nodes 1 and 2 lies on no"),
        (
            {"hinges": ((1, 2, 0, 3), (1, 2, 3, 0))},
            UnsupportedScene,
            "hinge 1 on nodes 1 and 2 shares its bar",
        ),
        (
            {"static": {"law": (["cable"] * 5, None)}},
            UnsupportedScene,
            "bars of the kind cable",
        ),
        (
            {"hinge_static": {"rigid": (np.ones(1, "u1"), None)}},
            UnsupportedScene,
            "hinges of the kind rigid",
        ),
    ],
)
def test_what_merlin_has_no_place_for_is_refused(tmp_path, changes, error, words):
    path = _sheet(tmp_path / "run.h5", **changes)
    with pytest.raises(error, match=words):
        export_file(path, tmp_path / "out.mat")
    assert not (tmp_path / "out.mat").exists()


def test_frame_0_may_be_said_to_be_the_rest_shape(tmp_path):
    path = _sheet(tmp_path / "run.h5", rest=None)
    export_file(path, tmp_path / "out.mat", options={"rest": "first"})
    np.testing.assert_array_equal(loadmat(tmp_path / "out.mat")["Node"], samples.REST)


def test_gaps_bad_options_and_existing_files_are_refused(mat, load, space, tmp_path, monkeypatch):
    source = load(mat(space))
    with pytest.raises(ConfigError, match="stride is 0"):
        export_file(source.path, tmp_path / "o.mat", options={"stride": 0})
    monkeypatch.setattr(exporter, "MAX_VARIABLE", 8 * 12 * 30)
    with pytest.raises(ConfigError, match="thin the run out with the option stride=3"):
        export_file(source.path, tmp_path / "o.mat")
    (tmp_path / "there.mat").write_bytes(b"x")
    with pytest.raises(ResultExists, match="a file of this name exists"):
        MerlinExporter().export(source.trajectory, tmp_path / "there.mat", options={"stride": 9})
    gap = tmp_path / "gap.h5"
    with TrajectoryWriter(gap, provenance=Provenance("test")) as writer:
        writer.declare_nodes(3, 3, unit="m", observed=True, rest=np.eye(3))
        writer.declare_elements("bars", [[0, 1]])
        writer.declare_elements("faces", [[0, 1, 2]])
        points = np.eye(3)
        points[2] = np.nan
        writer.append(0.0, positions=np.eye(3), observed=[1, 1, 1])
        writer.append(1.0, positions=points, observed=[1, 1, 0])
    with pytest.raises(MissingData, match="node 2 is missing in frame 1"):
        export_file(gap, tmp_path / "o.mat")


@pytest.mark.parametrize("name", ["merlin2_gmiura_n5b8_disp", "merlin2_kresling_n4b5_disp"])
def test_first_merlin_has_no_such_run(data, load, tmp_path, name):
    with pytest.raises(ConfigError, match="which the first MERLIN does not have"):
        export_file(load(data / f"{name}.mat").path, tmp_path / "o.mat", options={"version": "1"})


@pytest.mark.parametrize(("key", "value"), [("length_unit", "N"), ("force_unit", "parsec")])
def test_stated_units_are_checked(mat, load, space, key, value):
    space["openprc"] = {"length_unit": "mm", "force_unit": "N", key: value}
    with pytest.raises(SchemaError, match=f"the unit '{value}'"):
        load(mat(space))


def test_through_the_registry(mat, load, space, tmp_path):
    source = load(mat(space))
    export_file(source.path, tmp_path / "odd.name", to="merlin")
    result = import_file(tmp_path / "odd.name", tmp_path / "back.h5", as_name="merlin")
    assert result.n_frames == 61
