"""Export to FOLD: what is written, that it comes back, and what is refused."""

from __future__ import annotations

import json

import numpy as np
import pytest
from openprc_merlin import samples
from openprc_merlin.fold_exporter import FoldExporter

from openprc.demlat.meshing import read_fold
from openprc.errors import ConfigError, MissingData, ResultExists, SchemaError
from openprc.hooks import export_file, import_file
from openprc.schema import Provenance, Trajectory, TrajectoryWriter

RUNS = (
    "merlin1_kresling_folding.mat",
    "merlin1_miura_bending.mat",
    "merlin2_gmiura_n5b8_disp.mat",
    "merlin2_polygon_n5b8_force.mat",
    "gmiura_obj",
)


def test_sample_in_closed_form(mat, load, space, tmp_path):
    source = load(mat(space), unit="mm")
    export_file(source.path, tmp_path / "run.fold")
    document = json.loads((tmp_path / "run.fold").read_text())
    assert document["file_spec"] == 1.2
    assert document["frame_unit"] == "mm"
    assert len(document["file_frames"]) == 60
    assert document["edges_vertices"] == (samples.BARS - 1).tolist()
    assert document["edges_assignment"] == ["F", "B", "B", "B", "B"]
    # The triangles of the sample run clockwise seen from above, and node 4 is raised: a mountain.
    angles = [frame["edges_foldAngle"] for frame in [document, *document["file_frames"]]]
    expected = -np.rad2deg(np.concatenate([[0.0], samples.fold_angles()]))
    np.testing.assert_allclose([row[0] for row in angles], expected, atol=1e-12)
    assert all(row[1:] == [0.0] * 4 for row in angles)
    assert {frame["frame_parent"] for frame in document["file_frames"]} == {0}


@pytest.mark.parametrize("name", RUNS)
def test_recorded_runs_come_back_bit_for_bit(data, load, tmp_path, name):
    path = data / name
    first = load(path, unit="mm").trajectory
    export_file(first.path, tmp_path / "run.fold")
    result = import_file(tmp_path / "run.fold", tmp_path / "again.h5")
    assert result.producer == "fold"
    with Trajectory(result.path) as second:
        np.testing.assert_array_equal(second.positions(), first.positions())
        np.testing.assert_array_equal(second.time, first.time)
        assert second.time_kind == first.time_kind == "pseudo"
        assert second.element_kinds == first.element_kinds
        for kind in first.element_kinds:
            np.testing.assert_array_equal(second.indices(kind), first.indices(kind))
            for quantity in first.element_series(kind):
                stored = first.element(kind, quantity)
                np.testing.assert_array_equal(second.element(kind, quantity), stored)
        for quantity in ("rest", "fixed", "id", "label"):
            if first.has(f"/topology/nodes/{quantity}"):
                np.testing.assert_array_equal(second.node(quantity), first.node(quantity))
        for signal in first.inputs:
            one, two = first.input(signal), second.input(signal)
            assert (two.unit, two.quantity, two.columns) == (one.unit, one.quantity, one.columns)
            np.testing.assert_array_equal(two.value, one.value)


def test_assignments_are_those_of_the_pattern(data, load, tmp_path):
    """A Miura sheet has three creases of one sign and one of the other at every inner node."""
    source = load(data / "merlin1_miura_folding.mat", unit="mm")
    export_file(source.path, tmp_path / "miura.fold", options={"stride": 20})
    document = json.loads((tmp_path / "miura.fold").read_text())
    assert len(document["file_frames"]) == 3
    letters: dict[int, list[str]] = {}
    for edge, letter in zip(document["edges_vertices"], document["edges_assignment"], strict=True):
        for node in edge:
            letters.setdefault(node, []).append(letter)
    inner = [row for row in letters.values() if "B" not in row]
    assert len(inner) == 81
    for row in inner:
        counts = sorted((row.count("M"), row.count("V")))
        assert counts == [1, 3], row
    # Fold angles of M are negative and of V positive, in every frame of this run.
    for frame in [document, *document["file_frames"]]:
        for letter, angle in zip(
            document["edges_assignment"], frame["edges_foldAngle"], strict=True
        ):
            assert letter not in "MV" or (angle > 0) == (letter == "V")


def test_another_reader_sees_the_same_angles(data, load, tmp_path):
    source = load(data / "merlin2_kresling_n4b5_disp.mat", unit="mm")
    export_file(source.path, tmp_path / "tower.fold")
    mesh = read_fold(tmp_path / "tower.fold", frame=30)
    positions = source.trajectory.positions(slice(30, 31), unit="m")[0]
    np.testing.assert_allclose(mesh.positions, positions, rtol=1e-15)
    ours = {
        frozenset(row[:2]): angle
        for row, angle in zip(
            source.trajectory.indices("hinges").tolist(),
            source.trajectory.element("hinges", "angle")[30].tolist(),
            strict=True,
        )
    }
    for row, angle in zip(mesh.hinges.tolist(), mesh.rest_angles.tolist(), strict=True):
        mine = ours[frozenset(row[:2])]
        assert min(abs(angle - mine), abs(2 * np.pi - angle - mine)) < 1e-9


def test_equal_runs_are_equal_files(mat, load, space, tmp_path):
    source = load(mat(space))
    made = []
    for name in ("a.fold", "b.fold"):
        export_file(source.path, tmp_path / name)
        made.append((tmp_path / name).read_bytes())
    assert made[0] == made[1]
    assert json.loads(made[0])["frame_unit"] == "unit"


def test_points_faces_and_planes(tmp_path):
    """Faces without bars get edges that are no bars; planar bodies two coordinates."""
    path = tmp_path / "faces.h5"
    rest = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]]
    with TrajectoryWriter(path, provenance=Provenance("test")) as writer:
        writer.declare_nodes(4, 2, unit="um", mass=[1, 2, 3, 4.5], labels=["a", "b", "c", "ö"])
        writer.declare_elements("bars", [[0, 3]])
        writer.declare_elements("faces", [[0, 1, 2], [1, 2, 3]])
        for frame in range(3):
            writer.append(0.1 * frame, positions=np.array(rest) * (1 + frame))
    export_file(path, tmp_path / "faces.fold")
    document = json.loads((tmp_path / "faces.fold").read_text())
    assert document["frame_attributes"] == ["2D"]
    assert document["edges_vertices"][0] == [0, 3]
    assert sorted(document["edges_assignment"]) == ["B"] * 4 + ["U"] * 2
    result = import_file(tmp_path / "faces.fold", tmp_path / "again.h5")
    with Trajectory(path) as first, Trajectory(result.path) as second:
        np.testing.assert_array_equal(second.positions(), first.positions())
        np.testing.assert_array_equal(second.time, first.time)
        assert second.time_unit == "s"
        # The faces were not wound alike, and come back as they were.
        np.testing.assert_array_equal(second.indices("faces"), [[0, 1, 2], [1, 2, 3]])
        np.testing.assert_array_equal(second.indices("bars"), [[0, 3]])
        np.testing.assert_array_equal(second.node("mass"), [1, 2, 3, 4.5])
        assert second.node("label").tolist() == ["a", "b", "c", "ö"]


def test_refusals(mat, load, space, tmp_path):
    source = load(mat(space))
    with pytest.raises(ConfigError, match="stride is 0"):
        export_file(source.path, tmp_path / "a.fold", options={"stride": 0})
    (tmp_path / "there.fold").write_text("x")
    with pytest.raises(ResultExists, match="a file of this name exists"):
        FoldExporter().export(source.trajectory, tmp_path / "there.fold", options={})
    sensors = tmp_path / "sensors.h5"
    with TrajectoryWriter(sensors, provenance=Provenance("test")) as writer:
        writer.declare_channel("s", ["a"], unit="1")
        writer.append([0.0, 1.0], channels={"s": [[0.0], [1.0]]})
    with pytest.raises(MissingData, match="the trajectory has no positions"):
        export_file(sensors, tmp_path / "a.fold")
    gap = tmp_path / "gap.h5"
    with TrajectoryWriter(gap, provenance=Provenance("test")) as writer:
        writer.declare_nodes(2, 2, unit="m", observed=True)
        writer.append(0.0, positions=np.eye(2), observed=[1, 1])
        writer.append(1.0, positions=[[0, 0], [np.nan] * 2], observed=[1, 0])
    with pytest.raises(MissingData, match="node 1 is missing in frame 1"):
        export_file(gap, tmp_path / "a.fold")
    with Trajectory(gap) as trajectory, pytest.raises(MissingData, match="node 1 is missing"):
        FoldExporter().export(trajectory, tmp_path / "a.fold", options={})
    assert not (tmp_path / "a.fold").exists()


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda d: d["openprc:nodes"].update(unit="ell"), "the unit 'ell'"),
        (lambda d: d["openprc:nodes"].update(rest=[[0, 0]]), "finite numbers of shape"),
        (lambda d: d["openprc:nodes"].update(label=["a"]), "a list that does not fit"),
        (lambda d: d["openprc:nodes"].update(id=[1 << 70] * 4), "a huge number"),
        (lambda d: d["openprc:bars"].update(count=9), "found 9"),
        (lambda d: d["openprc:hinges"].update(vertices=[[0, 1, 2]]), "a row of another length"),
        (lambda d: d["openprc:hinges"].update(vertices=[[0, 1, 2, 9]]), "vertices from 0 to 3"),
        (lambda d: d["openprc:bars"]["static"].update(x=3), "no object"),
        (lambda d: d["openprc:bars"]["static"].update(x={"values": [1]}), "no numbers and no"),
        (
            lambda d: d["openprc:bars"]["static"].update(x={"type": "i", "values": [0.5] * 5}),
            "no whole numbers",
        ),
        (lambda d: d["openprc:inputs"].update(load=[]), "no columns"),
        (lambda d: d["openprc:inputs"]["load"].update(values=[[1.0]]), "of shape"),
        (lambda d: d["openprc:inputs"]["load"].update(columns=[1]), "names that are no text"),
        (lambda d: d["openprc:inputs"]["load"].update(targets=4), "a list"),
        (lambda d: d.update({"openprc:clock": {"kind": "x"}}), "kind 'x'"),
        (lambda d: d.update({"openprc:nodes": 3}), "a JSON int"),
    ],
)
def test_what_the_exporter_said_is_checked(mat, load, space, tmp_path, change, words):
    source = load(mat(space))
    export_file(source.path, tmp_path / "run.fold", options={"stride": 20})
    document = json.loads((tmp_path / "run.fold").read_text())
    change(document)
    (tmp_path / "run.fold").write_text(json.dumps(document))
    with pytest.raises(SchemaError, match=words):
        import_file(tmp_path / "run.fold", tmp_path / "again.h5")
