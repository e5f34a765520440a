"""Meshes from FOLD, OBJ and SVG files."""

import json
import math

import numpy as np
import pytest

from openprc.demlat.meshing import read_fold, read_obj
from openprc.errors import ConfigError, UnreadableFile, UnsafeFile

# --- FOLD -------------------------------------------------------------------------------------

VALLEY = {
    "file_spec": 1.2,
    "frame_unit": "mm",
    "vertices_coords": [[0, 0], [10, 0], [10, 10], [0, 10]],
    "edges_vertices": [[0, 1], [1, 2], [2, 3], [3, 0], [0, 2]],
    "edges_assignment": ["B", "B", "B", "B", "V"],
    "edges_foldAngle": [None, None, None, None, 90],
    "faces_vertices": [[0, 1, 2], [0, 2, 3]],
}


@pytest.fixture
def fold_file(tmp_path):
    def write(**changes):
        data = {key: value for key, value in (VALLEY | changes).items() if value is not ...}
        path = tmp_path / "a.fold"
        path.write_text(json.dumps(data))
        return path

    return write


def test_a_fold_file(fold_file):
    mesh = read_fold(fold_file())
    assert np.allclose(mesh.positions, 1e-3 * np.array([[0, 0, 0], [10, 0, 0], [10, 10, 0],
                                                        [0, 10, 0]]))  # fmt: skip
    assert mesh.hinges.tolist() == [[0, 2, 3, 1]]
    assert mesh.rest_angles.tolist() == [math.pi / 2]
    assert mesh.angles.tolist() == [math.pi]
    assert mesh.senses.tolist() == [1]
    assert sorted(mesh.bar_kinds.tolist()) == ["boundary"] * 4 + ["fold"]
    assert mesh.node_sets["right"].tolist() == [1, 2]


def test_the_sign_of_a_fold_angle_is_that_of_a_folded_sheet(fold_file):
    """A valley of 90 degrees, folded: the lifted wing is above the side the faces turn to."""
    up = 10 / math.sqrt(2)
    coords = [[0, 0, 0], [10, 0, 0], [10, 10, 0], [5, 5, up]]
    mesh = read_fold(fold_file(vertices_coords=coords, edges_foldAngle=...))
    assert mesh.rest_angles[0] == pytest.approx(math.pi / 2)
    flat = read_fold(fold_file())
    assert flat.rest_angles[0] == pytest.approx(mesh.rest_angles[0])


@pytest.mark.parametrize(("kind", "angle"), [("V", math.pi - 0.4), ("M", math.pi + 0.4),
                                             ("U", math.pi), ("F", math.pi)])  # fmt: skip
def test_folds_without_an_angle_take_the_one_that_is_given(fold_file, kind, angle):
    path = fold_file(edges_foldAngle=..., edges_assignment=["B", "B", "B", "B", kind])
    mesh = read_fold(path, fold_angle=0.4)
    assert mesh.rest_angles.tolist() == pytest.approx([angle])
    assert mesh.hinge_kinds.tolist() == ["facet" if kind == "F" else "fold"]
    assert read_fold(path).rest_angles.tolist() == [math.pi]


def test_panels_are_cut_into_triangles_and_faces_found_from_edges(fold_file):
    coords = [[0, 0], [1, 0], [2, 0], [2, 1], [1, 1], [0, 1]]
    edges = [[0, 1], [1, 2], [2, 3], [3, 4], [4, 5], [5, 0], [1, 4]]
    mesh = read_fold(
        fold_file(
            vertices_coords=coords,
            edges_vertices=edges,
            edges_assignment=["B"] * 6 + ["M"],
            edges_foldAngle=[0] * 6 + [-30],
            faces_vertices=...,
        )
    )
    assert len(mesh.faces) == 4
    assert sorted(mesh.hinge_kinds.tolist()) == ["facet", "facet", "fold"]
    fold = mesh.hinge_kinds == "fold"
    assert mesh.rest_angles[fold] == pytest.approx(math.pi + math.radians(30))
    assert mesh.senses[fold] == [-1]
    assert mesh.lumped_masses(1.0).sum() == pytest.approx(2e-6)


def test_a_cut_separates_the_sheet(fold_file):
    cut = read_fold(
        fold_file(edges_assignment=["B"] * 4 + ["C"], edges_foldAngle=..., frame_unit="m")
    )
    assert cut.n_nodes == 6
    assert len(cut.bars) == 6
    assert len(cut.hinges) == 0
    assert set(cut.bar_kinds) == {"boundary"}


def test_a_cut_that_cannot_open_is_refused(fold_file):
    coords = [[0, 0], [4, 0], [4, 4], [0, 4], [1, 2], [3, 2]]
    faces = [[0, 1, 5, 4], [1, 2, 5], [2, 3, 4, 5], [3, 0, 4]]
    path = fold_file(
        vertices_coords=coords,
        faces_vertices=faces,
        edges_vertices=[[4, 5]],
        edges_assignment=["C"],
        edges_foldAngle=...,
    )
    with pytest.raises(ConfigError, match=r"the cut \[4, 5\] is one edge between two ends"):
        read_fold(path)


def test_faces_of_a_crease_pattern_are_turned_alike(fold_file):
    mesh = read_fold(fold_file(faces_vertices=[[0, 2, 1], [0, 2, 3]]))
    assert mesh.rest_angles.tolist() == [math.pi / 2]


def test_frames_inherit(fold_file):
    frames = [
        {"frame_parent": 0, "frame_inherit": True, "edges_foldAngle": [None] * 4 + [45]},
        {"frame_parent": 1, "frame_inherit": True, "frame_unit": "cm"},
    ]
    path = fold_file(file_frames=frames)
    assert read_fold(path, frame=1).rest_angles[0] == pytest.approx(0.75 * math.pi)
    last = read_fold(path, frame=2)
    assert last.rest_angles[0] == pytest.approx(0.75 * math.pi)
    assert last.positions.max() == pytest.approx(0.1)


@pytest.mark.parametrize(
    ("changes", "options", "words"),
    [
        ({"vertices_coords": ...}, {}, "vertices_coords: no coordinates"),
        ({"vertices_coords": [[0, 0], [1]]}, {}, r"vertices_coords/1: found \[1\]"),
        ({"vertices_coords": [[0, 0], [1, None]]}, {}, "vertices_coords/1: found None"),
        ({"vertices_coords": [[0, 0], [1, True]]}, {}, "vertices_coords/1: found True"),
        ({"edges_vertices": [[0, 9]]}, {}, r"edges_vertices/0: found \[0, 9\](.|\n)*from 0 to 3"),
        ({"edges_vertices": [[0, 0]]}, {}, "two different vertices"),
        ({"edges_vertices": [[0, 1], [1, 0]]}, {}, "edges_vertices: an edge twice"),
        ({"edges_vertices": 3}, {}, "edges_vertices: no list"),
        ({"edges_assignment": ["B"]}, {}, "edges_assignment: a list that does not fit"),
        ({"edges_assignment": ["B"] * 4 + ["X"]}, {}, "the assignment 'X'"),
        ({"edges_assignment": ["B"] * 5}, {}, r"the boundary edge \[0, 2\] lies between"),
        ({"edges_foldAngle": [None] * 4 + [181]}, {}, "edges_foldAngle/4: found 181"),
        ({"edges_foldAngle": [None] * 4 + ["a"]}, {}, "edges_foldAngle/4: found 'a'"),
        ({"edges_vertices": [[1, 3]], "edges_assignment": ..., "edges_foldAngle": ...}, {},
         r"the edge \[1, 3\] is an edge of no face"),
        ({"faces_vertices": [[0, 1]]}, {}, r"faces_vertices/0: found \[0, 1\]"),
        ({"faces_vertices": []}, {}, "faces_vertices: no list"),
        ({"faces_vertices": ..., "vertices_coords": [[0, 0, 0], [1, 0, 0], [1, 1, 1], [0, 1, 0]]},
         {}, "faces_vertices: no faces"),
        ({"faces_vertices": [[0, 1, 2], [0, 3, 2]],
          "vertices_coords": [[0, 0, 0], [1, 0, 0], [1, 1, 1], [0, 1, 0]]}, {},
         "turn to different sides"),
        ({"frame_unit": "unit"}, {}, "frame_unit: lengths in 'unit'(.|\n)*scale="),
        ({"frame_unit": ["m"]}, {}, "frame_unit: lengths in"),
        ({}, {"scale": 1.0}, "scale=1.0, and the file says that a unit is 1 mm"),
        ({"frame_unit": "unit"}, {"scale": -1.0}, "scale: scale -1.0"),
        ({}, {"frame": 1}, "frame: frame 1(.|\n)*from 0 to 0"),
        ({}, {"fold_angle": 4.0}, "fold_angle: found 4.0"),
        ({"file_frames": [3]}, {}, "file_frames: no list of frames"),
        ({"file_frames": [{"frame_inherit": True, "frame_parent": 1}]}, {"frame": 1},
         "frame_parent: frame 1 inherits from itself"),
        ({"file_frames": [{"frame_inherit": True, "frame_parent": 7}]}, {"frame": 1},
         "the parent 7 of frame 1"),
    ],
)  # fmt: skip
def test_fold_files_that_are_wrong_are_refused(fold_file, changes, options, words):
    path = fold_file(**changes)
    with pytest.raises(ConfigError, match=words) as caught:
        read_fold(path, **options)
    assert caught.value.file == str(path) or caught.value.key == "fold_angle"


@pytest.mark.parametrize(
    ("content", "error", "words"),
    [
        ("{", UnreadableFile, "invalid JSON at line 1"),
        ("[]", UnreadableFile, "a JSON list"),
        ("[" * 100_000, UnreadableFile, "cannot be read"),
        ("", UnreadableFile, "empty"),
        ('{"vertices_coords": [[0, NaN]]}', ConfigError, "frame_unit|nan"),
    ],
)
def test_files_that_are_no_fold_files_are_refused(tmp_path, content, error, words):
    path = tmp_path / "a.fold"
    path.write_text(content)
    with pytest.raises(error, match=words):
        read_fold(path)


def test_text_that_is_no_text_and_huge_files_are_refused(tmp_path, monkeypatch):
    path = tmp_path / "a.fold"
    path.write_bytes(b"\xff\xfe{}")
    with pytest.raises(UnreadableFile, match="byte 0 is not UTF-8"):
        read_fold(path)
    monkeypatch.setattr("openprc.demlat.meshing.mesh_text.MAX_BYTES", 3)
    with pytest.raises(UnsafeFile, match="4 bytes of text"):
        read_fold(path)
    with pytest.raises(UnreadableFile, match="does not exist"):
        read_fold(tmp_path / "b.fold")


# --- OBJ --------------------------------------------------------------------------------------

OBJ = """# a sheet of two panels and a stray vertex
mtllib ../../etc/passwd
v 0 0 0
v 1 0 0 # comment
v 9 9 9
v 2 0 0.5
v 2 1 0.5
v 1 1 0
v 0 1 0
vt 0 0
f 1/1 2/1 6/1 7/1
f -4 -3 \\
-2 2
"""


@pytest.fixture
def obj_file(tmp_path):
    def write(text):
        path = tmp_path / "a.obj"
        path.write_text(text)
        return path

    return write


def test_an_obj_file(obj_file):
    mesh = read_obj(obj_file(OBJ), scale=0.01)
    assert mesh.n_nodes == 6
    assert len(mesh.faces) == 4
    assert sorted(mesh.hinge_kinds.tolist()) == ["facet", "facet", "fold"]
    fold = mesh.hinge_kinds == "fold"
    assert mesh.rest_angles[fold] == pytest.approx(math.pi - math.atan(0.5))
    assert mesh.rest_angles[~fold] == pytest.approx([math.pi] * 2)
    assert mesh.positions.max() == pytest.approx(0.02)
    soft = read_obj(obj_file(OBJ), scale=0.01, facet_bend=0.5)
    assert set(soft.hinge_kinds) == {"facet"}


def test_faces_of_an_obj_file_are_turned_alike(obj_file):
    mesh = read_obj(obj_file(OBJ.replace("-4 -3 \\\n-2 2", "2 6 5 4")), scale=0.01)
    fold = mesh.hinge_kinds == "fold"
    assert mesh.rest_angles[fold] == pytest.approx(math.pi - math.atan(0.5))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("v 0 0\n", "line 1: a vertex with 2 numbers"),
        ("v 0 0 x\n", "line 1: found 'x'"),
        ("v 0 0 nan\n", "line 1: found 'nan'"),
        ("v 0 0 0\n", "1 vertices and no faces"),
        ("v 0 0 0\nf 1 2 3\n", "a face with vertex 3"),
        ("v 0 0 0\nf 1 0 1\n", "line 2: the corner '0'"),
        ("v 0 0 0\nf 1 -2 1\n", "line 2: the corner '-2'"),
        ("v 0 0 0\nf 1 a 1\n", "line 2: the corner 'a'"),
        ("v 0 0 0\nv 1 0 0\nf 1 2\n", "faces/0: panel 0 has the nodes"),
        ("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nv 0 -1 0\nf 1 2 3\nf 1 2 4\nf 1 2 5\n",
         "3 triangles meet at the edge"),
    ],
)  # fmt: skip
def test_obj_files_that_are_wrong_are_refused(obj_file, text, words):
    path = obj_file(text)
    with pytest.raises(ConfigError, match=words) as caught:
        read_obj(path, scale=1.0)
    assert caught.value.file == str(path)
