"""Import of FOLD animations: closed form, inheritance, units, clocks, and refusals."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from openprc_merlin import fold_file, fold_sample, openprc_producers
from openprc_merlin.fold_importer import FoldImporter

from openprc.demlat.meshing import read_fold
from openprc.errors import (
    ConfigError,
    MissingData,
    NotATrajectory,
    OpenPRCError,
    SchemaError,
    UnreadableFile,
    UnsafeFile,
)
from openprc.hooks import import_file
from openprc.schema import Provenance, Trajectory, TrajectoryWriter
from openprc.schema.validate import validate_file


@pytest.fixture
def fold(tmp_path):
    """Write a document and import it."""
    opened = []

    def run(document, **options):
        path = tmp_path / f"run{len(opened)}.fold"
        if isinstance(document, str | bytes):
            path.write_bytes(document if isinstance(document, bytes) else document.encode())
        else:
            path.write_text(json.dumps(document))
        spec = next(spec for spec in openprc_producers() if spec.name == "fold")
        given = {option.name: option.default for option in spec.options} | options
        target = path.with_suffix(".h5")
        with TrajectoryWriter(
            target, provenance=Provenance("fold"), on_failure="discard"
        ) as writer:
            FoldImporter().import_run(path, writer, options=given)
            notes = writer.notes
        assert validate_file(target).ok
        trajectory = Trajectory(target)
        opened.append(trajectory)
        return SimpleNamespace(trajectory=trajectory, text="\n".join(notes), path=path)

    yield run
    for trajectory in opened:
        trajectory.close()


@pytest.fixture
def document():
    return fold_sample.document()


def test_sample_is_the_closed_form(tmp_path):
    sample = fold_sample.write_sample(tmp_path)
    assert FoldImporter().sniff(sample.path) == 1.0
    result = import_file(sample.path, tmp_path / "out.h5", options=sample.options)
    assert (result.producer, result.n_frames, result.time_kind) == ("fold", 41, "physical")
    angle = fold_sample.fold_angles()
    with Trajectory(result.path) as trajectory:
        assert trajectory.position_unit == "mm"
        np.testing.assert_allclose(trajectory.time, 0.01 * np.arange(41), rtol=1e-15)
        wing = trajectory.positions()[:, 3]
        expected = 10 * np.column_stack([np.cos(angle), 0 * angle, np.sin(angle)])
        np.testing.assert_allclose(wing, expected, rtol=0, atol=1e-14)
        # Valleys are positive in FOLD, and close the angle on the side of the normals.
        opening = trajectory.element("hinges", "angle")[:, 0]
        np.testing.assert_allclose(opening, np.pi - angle, atol=1e-14)
        length = trajectory.element("bars", "length")
        np.testing.assert_allclose(length, np.broadcast_to(length[0], length.shape), rtol=1e-14)
        assert trajectory.element_static("bars", "kind_code").tolist() == [1, 0, 0, 0, 0]
        assert trajectory.element_static("bars", "assignment").tolist() == list("VBBBB")


def test_angles_agree_with_the_reader_of_meshes(fold, document):
    """Two readers of the format, written apart, mean the same by a hinge angle."""
    result = fold(document)
    for frame in (3, 10, 33):
        mesh = read_fold(result.path, frame=frame)
        measured = result.trajectory.element("hinges", "angle")[frame]
        np.testing.assert_allclose(mesh.rest_angles, measured, atol=1e-12)


def test_chain_of_parents(fold, document):
    frames = document["file_frames"]
    for number in range(2, len(frames) + 1):
        frames[number - 1]["frame_parent"] = number - 1
    assert fold(document).trajectory.element_kinds == ("bars", "faces", "hinges")


def test_parents_may_stand_behind_and_chains_cost_nothing(fold):
    """Twenty thousand frames, each of which inherits from the next one."""
    count = 20_000
    frames = [
        {"frame_inherit": True, "frame_parent": n + 2, "vertices_coords": [[n, 0, 0], [n, 1, 2]]}
        for n in range(count)
    ]
    frames[-1]["frame_parent"] = 0
    document = {"vertices_coords": [[-1, 0, 0], [0, 1, 2]], "edges_vertices": [[0, 1]]}
    trajectory = fold({**document, "file_frames": frames}).trajectory
    assert trajectory.n_frames == count + 1
    assert trajectory.element_kinds == ("bars",)


def test_frames_that_inherit_nothing_share_the_mesh_of_the_key_frame(fold, document):
    for frame in document["file_frames"]:
        del frame["frame_inherit"], frame["frame_parent"]
    assert fold(document).trajectory.element_kinds == ("bars", "faces", "hinges")


def test_key_frame_without_coordinates_is_no_instant(fold, document):
    del document["vertices_coords"]
    assert fold(document).trajectory.n_frames == 40


def test_crease_pattern_gives_the_rest_lengths(fold, document):
    document["frame_classes"] = ["creasePattern"]
    document["vertices_coords"] = fold_sample.FLAT[:, :2].tolist()
    for frame in document["file_frames"]:
        frame["frame_classes"] = ["foldedForm"]
    result = fold(document)
    assert result.trajectory.n_frames == 40
    assert "crease pattern" in result.text
    rest = result.trajectory.element_static("bars", "rest_length")
    np.testing.assert_allclose(rest, [20.0] + [np.hypot(10, 10)] * 4)
    np.testing.assert_allclose(result.trajectory.element("bars", "strain"), 0.0, atol=1e-15)


def test_two_dimensions_stay_two(fold, document):
    for frame in [document, *document["file_frames"]]:
        frame["vertices_coords"] = [row[:2] for row in frame["vertices_coords"]]
    trajectory = fold(document).trajectory
    assert trajectory.dims == 2
    assert trajectory.element_kinds == ("bars", "faces")


def test_two_among_three_dimensions_lie_at_z_0(fold, document):
    document["vertices_coords"] = [row[:2] for row in document["vertices_coords"]]
    result = fold(document)
    assert result.trajectory.dims == 3
    assert "have z = 0" in result.text


@pytest.mark.parametrize(
    ("name", "unit", "factor"),
    [("m", "m", 1.0), ("nm", "um", 1e-3), ("in", "mm", 25.4), ("pt", "mm", 25.4 / 72)],
)
def test_units(fold, document, name, unit, factor):
    document["frame_unit"] = name
    trajectory = fold(document).trajectory
    assert trajectory.position_unit == unit
    np.testing.assert_allclose(trajectory.positions(slice(0, 1))[0], fold_sample.FLAT * factor)


def test_unit_is_asked_for_where_none_is_said(fold, document):
    document["frame_unit"] = "unit"
    assert fold(document).trajectory.position_unit == "arb"
    assert fold(document, unit="cm").trajectory.position_unit == "cm"
    document["frame_unit"] = "mm"
    with pytest.raises(ConfigError, match="unit=cm, and the file says mm"):
        fold(document, unit="cm")


def test_clocks(fold, document):
    plain = fold(document).trajectory
    assert (plain.time_kind, plain.time_unit) == ("pseudo", "1")
    frames = [document, *document["file_frames"]]
    for number, frame in enumerate(frames):
        frame["mine:t"] = 0.5 * number
        frame["openprc:time"] = 2.0 * number
    document["openprc:clock"] = {"unit": "ms", "kind": "physical"}
    named = fold(document, time="mine:t").trajectory
    assert (named.time[2], named.time_unit) == (1.0, "s")
    stated = fold(document).trajectory
    assert (stated.time[2], stated.time_unit) == (4.0, "ms")
    assert fold(document, time="increment").trajectory.time_kind == "pseudo"
    with pytest.raises(ConfigError, match="both dt and time"):
        fold(document, time="mine:t", dt=1.0)
    with pytest.raises(ConfigError, match="dt = -1"):
        fold(document, dt=-1.0)
    frames[3]["mine:t"] = 0.0
    with pytest.raises(ConfigError, match="do not increase"):
        fold(document, time="mine:t")
    del frames[3]["mine:t"]
    with pytest.raises(ConfigError, match="40 of 41 frames have a number under 'mine:t'"):
        fold(document, time="mine:t")


def test_cuts_have_no_hinge_and_joins_bend(fold, document):
    document["edges_assignment"][0] = "C"
    assert fold(document).trajectory.element_kinds == ("bars", "faces")
    document["edges_assignment"][0] = "J"
    trajectory = fold(document).trajectory
    assert trajectory.element_static("hinges", "kind_code").tolist() == [2]


def test_polygons_are_cut_where_a_corner_sees_all(fold):
    # An arrow head: only its tip and its notch see every other corner.
    arrow = [[0, 0, 0], [2, -2, 0], [0, 4, 0], [-2, -2, 0]]
    hook = [[0, 0], [10, 0], [10, 10], [9, 10], [9, 1], [1, 1], [1, 10], [0, 10]]
    low, high = ([[x, y, z] for x, y in hook] for z in (0, 1))
    lifted = [[x, y, 0.1] for x, y, _ in arrow]
    document = {"vertices_coords": arrow, "faces_vertices": [[1, 2, 3, 0]],
                "file_frames": [{"frame_inherit": True, "vertices_coords": lifted}]}  # fmt: skip
    result = fold(document)
    faces = result.trajectory.indices("faces")
    assert {frozenset(row) for row in faces.tolist()} == {
        frozenset({0, 1, 2}), frozenset({0, 2, 3})
    }  # fmt: skip
    assert "1 faces of more than three corners" in result.text
    # The cut is no edge of the file, so nothing bends there.
    assert result.trajectory.element_kinds == ("faces",)
    document = {
        "vertices_coords": low,
        "faces_vertices": [list(range(8))],
        "file_frames": [{"frame_inherit": True, "vertices_coords": high}],
    }
    # Nobody sees all of this one, so it is left out.
    result = fold(document)
    assert "faces" not in result.trajectory.element_kinds
    assert "1 faces that no corner sees all of" in result.text


# --- refusals --------------------------------------------------------------------------------


def _changed(**changes):
    document = fold_sample.document()
    for key, value in changes.items():
        if value is None:
            del document[key]
        else:
            document[key] = value
    return document


def _framed(number, **changes):
    document = fold_sample.document()
    frame = document["file_frames"][number]
    for key, value in changes.items():
        if value is None:
            del frame[key]
        else:
            frame[key] = value
    return document


WRONG = [
    (_changed(file_frames=None), NotATrajectory, "a single state .*read_fold"),
    (_changed(file_frames=[]), NotATrajectory, "a single state"),
    (_changed(file_frames={"a": 1}), SchemaError, "no list of objects"),
    (_changed(file_frames=[1]), SchemaError, "no list of objects"),
    (_framed(0, frame_parent=2), SchemaError, "nothing"),
    (_framed(4, vertices_coords=None), MissingData, "frame 5 has no coordinates of its own"),
    (_framed(4, vertices_coords=[[0, 0, 0]] * 5), MissingData, "frame 5 has 5 vertices"),
    (_framed(4, edges_vertices=[[0, 1]]), SchemaError, "the mesh of frame 5 is another one"),
    (_framed(4, frame_parent=99), SchemaError, "the parent 99"),
    (_framed(4, frame_parent="0"), SchemaError, "the parent '0'"),
    (_framed(4, frame_unit="cm"), SchemaError, "several units: cm, mm"),
    (_framed(4, vertices_coords=[[0, 0, "a"]] * 4), SchemaError, "found .*finite numbers"),
    (_framed(4, vertices_coords=[[0, 0, True]] * 4), SchemaError, "two or three finite"),
    (_framed(4, vertices_coords=[[0]] * 4), SchemaError, "two or three finite"),
    (_framed(4, vertices_coords=[[10**400, 0]] * 4), SchemaError, "two or three finite"),
    (_framed(4, vertices_coords=[]), SchemaError, "no list of coordinates"),
    (_changed(edges_vertices=[[0, 9]]), SchemaError, "different vertices from 0 to 3"),
    (_changed(edges_vertices=[[1, 1]]), SchemaError, "different vertices from 0 to 3"),
    (_changed(edges_vertices=[[0, 1, 2]]), SchemaError, "two vertices"),
    (_changed(edges_vertices=7), SchemaError, "a list|no list"),
    (_changed(edges_assignment=["M"]), SchemaError, "5 letters"),
    (_changed(edges_assignment=["Q"] * 5), SchemaError, "found 'Q'"),
    (_changed(faces_vertices=[[0, 1]]), SchemaError, "3 or more"),
    (_changed(faces_vertices=[[0, 1, -1]]), SchemaError, "different vertices"),
]


@pytest.mark.parametrize(("document", "error", "words"), WRONG)
def test_wrong_files_are_named(fold, document, error, words):
    if words == "nothing":
        document["file_frames"][1]["frame_parent"] = 1
        words = "inherits from itself"
    with pytest.raises(error, match=f"(?s){words}"):
        fold(document)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[1, 2]", "a JSON list"),
        ("{", "invalid JSON at line 1"),
        ('{"vertices_coords": [[NaN, 0, 0]]}', "NaN, which JSON does not have"),
        ('{"vertices_coords": [[-Infinity, 0, 0]]}', "-Infinity, which JSON does not have"),
        ('{"a":' * 100_000 + "1" + "}" * 100_000, "JSON that cannot be read"),
        ('{"a": ' + "1" * 10_000 + "}", "JSON that cannot be read"),
        (b"\xff\xfe{}", "byte 0 is not UTF-8"),
    ],
)
def test_text_that_is_no_json_is_named(fold, text, words):
    with pytest.raises(UnreadableFile, match=words):
        fold(text)


def test_size_is_bounded(fold, document, monkeypatch):
    monkeypatch.setattr(fold_file, "MAX_BYTES", 100)
    with pytest.raises(UnsafeFile, match="bytes of JSON"):
        fold(document)


def test_sniff(tmp_path, document):
    path = tmp_path / "a.fold"
    whole = json.dumps(document)
    for text, score in (
        (whole, 1.0),
        ("\ufeff" + whole, 1.0),
        (json.dumps(_changed(file_frames=None)), 0.6),
        (whole[: len(whole) // 2], 0.0),
        (whole[:-2] + "}", 0.0),
        ("", 0.0),
        ("{}", 0.0),
        ('{"edges_vertices": []}', 0.0),
        ("\x00\x01\x02", 0.0),
    ):
        path.write_text(text, encoding="utf-8")
        assert FoldImporter().sniff(path) == score, text[:40]
    assert FoldImporter().sniff(tmp_path) == 0.0
    assert FoldImporter().sniff(tmp_path / "nothing.fold") == 0.0


def test_random_damage_is_named(fold, tmp_path):
    """Cut, flipped and spliced text: a valid trajectory, or an error of the family."""
    whole = json.dumps(fold_sample.document(n_frames=4)).encode()
    rng = np.random.default_rng(11)
    pieces = [b"null", b"[]", b"{}", b"-1", b"1e999", b'"x"', b"true", b"9" * 30, b"[[", b",,"]
    refused = 0
    for _ in range(120):
        text = bytearray(whole)
        for _ in range(int(rng.integers(1, 4))):
            at = int(rng.integers(len(text)))
            text[at : at + int(rng.integers(0, 8))] = pieces[int(rng.integers(len(pieces)))]
        try:
            fold(bytes(text))
        except OpenPRCError as error:
            refused += bool(error.found)
    assert refused > 70
    assert not list(Path(tmp_path).glob("*.partial"))
