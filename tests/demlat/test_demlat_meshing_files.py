"""Meshes from FOLD, OBJ and SVG files."""

import json
import math

import numpy as np
import pytest

from openprc.demlat.meshing import read_fold, read_obj, read_svg
from openprc.demlat.meshing.planar_graph import panels_of, split_crossings
from openprc.demlat.meshing.polygons import triangulate, turned_alike
from openprc.errors import ConfigError, UnreadableFile, UnsafeFile

# --- polygons and planar graphs ---------------------------------------------------------------


def area_of(points, triangles):
    a, b, c = (points[triangles[:, corner]] for corner in range(3))
    return 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)


def test_a_concave_panel_with_corners_in_line_is_cut_without_slivers():
    points = np.array([[0, 0], [1, 0], [2, 0], [4, 0], [4, 4], [2, 1], [0, 4], [0, 2]], dtype=float)
    points = np.concatenate([points, np.zeros((8, 1))], axis=1)
    triangles, diagonals = triangulate(points, [list(range(8))])
    assert len(triangles) == 6
    assert len(diagonals) == 5
    areas = area_of(points, triangles)
    assert areas.sum() == pytest.approx(10.0)
    assert areas.min() > 0.4
    normal = np.cross(points[triangles[:, 1]] - points[triangles[:, 0]],
                      points[triangles[:, 2]] - points[triangles[:, 0]])  # fmt: skip
    assert (normal[:, 2] > 0).all()


def test_a_tilted_panel_is_cut_like_a_level_one():
    rng = np.random.default_rng(1)
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    angle = np.sort(rng.uniform(0, 2 * math.pi, 9))
    points = np.stack([np.cos(angle), np.sin(angle), np.zeros(9)], axis=1)
    level, _ = triangulate(points, [list(range(9))])
    tilted, _ = triangulate(points @ turn.T + [1, 2, 3], [list(range(9))])
    assert np.array_equal(level, tilted)


def test_a_panel_that_crosses_itself_is_refused():
    points = np.array([[0, 0, 0], [1, 1, 0], [1, 0, 0], [0, 1, 0]], dtype=float)
    with pytest.raises(ConfigError, match=r"panel 0 with the nodes(.|\n)*does not cross itself"):
        triangulate(points, [[0, 1, 2, 3]])
    with pytest.raises(ConfigError, match="faces/0: panel 0 has the nodes"):
        triangulate(points, [[0, 1, 0, 2]])


def test_panels_are_turned_alike_and_a_moebius_strip_is_refused():
    assert turned_alike([[0, 1, 2], [0, 3, 2]][::-1]) == [[0, 3, 2], [2, 1, 0]]
    strip = [[0, 1, 3, 2], [2, 3, 5, 4], [4, 5, 0, 1]]
    with pytest.raises(ConfigError, match="cannot be turned to one side"):
        turned_alike(strip)


def test_crossing_and_touching_lines_are_divided():
    lines = np.array(
        [[[0, 0], [4, 0]], [[4, 0], [4, 4]], [[4, 4], [0, 4]], [[0, 4], [0, 0]],
         [[0, 0], [4, 4]], [[0, 4], [4, 0]], [[2, 0], [2, 4]], [[1, 0], [3, 0]]],
        dtype=float,
    )  # fmt: skip
    points, edges, parents = split_crossings(lines, tolerance=1e-6)
    assert len(points) == 9
    # Sides: 4 + 1 + 4 + 1, the lower one divided at 1, 2 and 3; every diagonal and the middle: 2.
    assert len(edges) == 4 + 1 + 2 + 1 + 3 * 2
    assert set(parents) == {0, 1, 2, 3, 4, 5, 6}
    panels = panels_of(points, edges)
    assert len(panels) == 6
    flat = np.concatenate([points, np.zeros((9, 1))], axis=1)
    triangles, _ = triangulate(flat, panels)
    assert area_of(flat, triangles).sum() == pytest.approx(16.0)


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


# --- SVG --------------------------------------------------------------------------------------

FRAME = '<rect x="0" y="0" width="100" height="100" stroke="black" fill="none"/>'


@pytest.fixture
def svg_file(tmp_path):
    def write(body, *, head=""):
        path = tmp_path / "a.svg"
        path.write_text(f'{head}<svg xmlns="http://www.w3.org/2000/svg">{body}</svg>')
        return path

    return write


def test_a_crease_pattern(svg_file):
    body = (
        FRAME
        + '<line x1="0" y1="100" x2="100" y2="0" stroke="#f00" stroke-opacity="0.5"/>'
        + '<g style="stroke:blue"><path d="M0 0 L 50 50l50 50"/></g>'
        + '<polyline points="50,0 50,50 50,100" stroke="rgb(255, 255, 0)"/>'
    )
    mesh = read_svg(svg_file(body), scale=1e-3, fold_angle=1.0)
    assert mesh.n_nodes == 7
    assert len(mesh.faces) == 6
    assert np.ptp(mesh.positions, axis=0).tolist() == pytest.approx([0.1, 0.1, 0.0])
    kinds = dict(zip(*np.unique(mesh.bar_kinds, return_counts=True), strict=True))
    assert kinds == {"boundary": 6, "fold": 4, "facet": 2}
    along = mesh.positions[mesh.hinges[:, 1]] - mesh.positions[mesh.hinges[:, 0]]
    rising = along[:, 0] * along[:, 1] > 1e-9
    falling = along[:, 0] * along[:, 1] < -1e-9
    # Drawn with y down, the first line rises when y points up.
    assert mesh.rest_angles[rising].tolist() == pytest.approx([math.pi + 0.5] * 2)
    assert mesh.rest_angles[falling].tolist() == pytest.approx([math.pi - 1.0] * 2)
    assert mesh.senses[rising].tolist() == [-1, -1]
    assert mesh.hinge_kinds[~rising & ~falling].tolist() == ["facet"] * 2
    flat = read_svg(svg_file(body), scale=1e-3)
    assert flat.rest_angles.tolist() == [math.pi] * 6


def test_a_slit_is_cut(svg_file):
    body = (
        FRAME
        + '<path d="M 30 50 H 70" stroke="lime"/>'
        + '<path d="M 0 50 h 30 M 70,50 H100" stroke="yellow"/>'
    )
    mesh = read_svg(svg_file(body), scale=1.0)
    assert mesh.lumped_masses(1.0).sum() == pytest.approx(1e4)
    # Four corners, the ends of the slit and of the yellow lines, and the middle of the slit twice.
    assert mesh.n_nodes == 10
    middle = np.flatnonzero((np.abs(mesh.positions[:, :2] - 50.0) < 1e-9).all(axis=1))
    assert len(middle) == 2
    rims = mesh.bars[mesh.bar_kinds == "boundary"]
    assert [np.isin(rims, node).sum() for node in middle] == [2, 2]
    assert len(mesh.bars) - mesh.n_nodes - len(mesh.faces) == 0, "a sheet with one hole"


def test_transforms_classes_and_colours_of_your_own(svg_file):
    body = (
        "<style>.rim, .x{stroke:#123456;} .f{stroke:#abc}</style>"
        '<g transform="translate(10 20) rotate(90) scale(2)">'
        '<polygon class="rim" points="0,0 10,0 10,10 0,10"/>'
        '<line class="f" x1="0" y1="0" x2="10" y2="10"/></g>'
        '<defs><circle r="3" stroke="red"/></defs><circle r="3" stroke="none"/>'
        '<line x1="0" y1="0" x2="9" y2="9" stroke="red" display="none"/><text>hello</text>'
    )
    colours = {"#123456": "boundary", "#AABBCC": "mountain"}
    mesh = read_svg(svg_file(body), scale=0.5, colours=colours)
    assert np.ptp(mesh.positions, axis=0).tolist() == pytest.approx([10, 10, 0])
    assert mesh.senses.tolist() == [-1]
    assert mesh.angles.tolist() == [math.pi]


@pytest.mark.parametrize(
    "transform",
    [
        "matrix(0 2 -2 0 10 20)",
        "translate(10,20) rotate(90)scale(2)",
        "rotate(90,10,20) translate(10 20) scale(2,2)",
    ],
)
def test_transforms_are_applied_from_the_right(transform, tmp_path):
    from openprc.demlat.meshing.svg_shapes import transform_matrix

    wanted = [[0, -2, 10], [2, 0, 20], [0, 0, 1]]
    assert np.allclose(transform_matrix(transform, tmp_path), wanted, atol=1e-12)
    skew = transform_matrix("skewX(45) skewY(0)", tmp_path)
    assert np.allclose(skew, [[1, 1, 0], [0, 1, 0], [0, 0, 1]])


def test_lines_upon_each_other_count_once_and_cuts_win(svg_file):
    body = FRAME + ('<path d="M0 50 H100" stroke="red"/><path d="M0 50 H100" stroke="lime"/>')
    mesh = read_svg(svg_file(body), scale=1.0)
    assert mesh.n_nodes == 8
    assert set(mesh.hinge_kinds) == {"facet"}


def test_a_drawn_miura_pattern_is_developable_and_simulated_as_drawn(svg_file):
    from openprc.demlat.meshing import miura_sheet

    flat = miura_sheet(2, 2, a=10.0, b=10.0, sector_angle=1.0, tilt=0.0)
    signs = {tuple(h[:2]): s for h, s in zip(flat.hinges.tolist(), flat.senses, strict=True)}
    lines = []
    for (i, j), kind in zip(flat.bars.tolist(), flat.bar_kinds, strict=True):
        if kind == "facet":
            continue
        colour = {0: "black", 1: "blue", -1: "red"}[int(signs.get((i, j), 0))]
        (x1, y1, _), (x2, y2, _) = flat.positions[i], flat.positions[j]
        lines.append(f'<line x1="{x1}" y1="{-y1}" x2="{x2}" y2="{-y2}" stroke="{colour}"/>')
    mesh = read_svg(svg_file("".join(lines)), scale=1.0)
    assert (mesh.n_nodes, len(mesh.bars), len(mesh.hinges)) == (25, len(flat.bars), 40)
    assert np.allclose(np.sort(mesh.bar_lengths), np.sort(flat.bar_lengths), atol=1e-9)
    assert np.array_equal(np.bincount(mesh.senses + 1), np.bincount(flat.senses + 1))


@pytest.mark.parametrize(
    ("body", "words"),
    [
        ("", "no lines"),
        ('<circle r="5" stroke="red"/>', "<circle> is a curve"),
        ('<path d="M0 0 C 1 1 2 2 3 3" stroke="red"/>', "path command C is a curve"),
        ('<path d="0 0 L1 1" stroke="red"/>', "the number 0 without a command"),
        ('<path d="M0 0 L1" stroke="red"/>', "too few numbers after L"),
        ('<path d="M0 0 ? 1" stroke="red"/>', r"'\?' in a path"),
        ('<rect width="9" height="9" rx="2" stroke="red"/>', "round corners"),
        ('<line x2="5%" stroke="red"/>', "x2: found '5%'"),
        ('<polyline points="0,0 1" stroke="red"/>', "pairs of numbers"),
        ('<line x2="5" stroke="teal"/>', "lines of the colour 'teal'(.|\n)*colours="),
        ('<g transform="spin(3)"><line x2="5" stroke="red"/></g>', r"the transform 'spin\(3\)'"),
        ('<g transform="rotate(3"><line x2="5" stroke="red"/></g>', "the transform"),
        ('<use href="#a"/>', "a <use> element"),
        ('<line x2="5" stroke="red" opacity="half"/>', "opacity: found 'half'"),
        (FRAME + '<path d="M10 10 H 50" stroke="red"/>', r"a line ends at \("),
        (FRAME + '<rect x="20" y="20" width="9" height="9" stroke="red"/>',
         "2 groups of lines that are not connected"),
        (FRAME + '<path d="M0 0 L100 100" stroke="black"/>', "a boundary line lies inside"),
    ],
)  # fmt: skip
def test_drawings_that_are_wrong_are_refused(svg_file, body, words):
    path = svg_file(body)
    with pytest.raises(ConfigError, match=words) as caught:
        read_svg(path, scale=1.0)
    assert caught.value.file == str(path)


@pytest.mark.parametrize(
    ("head", "error", "words"),
    [
        ('<!DOCTYPE svg [<!ENTITY a "aaaa">]>', UnsafeFile, "a document type or entities"),
        ('<!doctype svg SYSTEM "http://example.org/x">', UnsafeFile, "a document type"),
        ("<a>", UnreadableFile, "this is no XML"),
    ],
)
def test_drawings_that_could_do_harm_are_refused(svg_file, head, error, words):
    with pytest.raises(error, match=words):
        read_svg(svg_file(FRAME, head=head), scale=1.0)


def test_deep_groups_other_roots_and_wrong_kinds_are_refused(svg_file, tmp_path):
    with pytest.raises(UnsafeFile, match="at most 64 levels"):
        read_svg(svg_file("<g>" * 80 + FRAME + "</g>" * 80), scale=1.0)
    path = tmp_path / "b.svg"
    path.write_text("<html/>")
    with pytest.raises(UnreadableFile, match="root of the document is <html>"):
        read_svg(path, scale=1.0)
    with pytest.raises(ConfigError, match="the kind 'ridge' for 'red'"):
        read_svg(svg_file(FRAME), scale=1.0, colours={"red": "ridge"})
    with pytest.raises(ConfigError, match="scale: scale 0"):
        read_svg(svg_file(FRAME), scale=0)


def test_too_many_lines_are_refused(monkeypatch, svg_file):
    monkeypatch.setattr("openprc.demlat.meshing.planar_graph.MOST_SEGMENTS", 3)
    with pytest.raises(UnsafeFile, match="4 line segments"):
        read_svg(svg_file(FRAME), scale=1.0)
