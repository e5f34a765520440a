"""Crease patterns drawn as SVG."""

import math

import numpy as np
import pytest

from openprc.demlat.meshing import read_svg
from openprc.errors import ConfigError, UnreadableFile, UnsafeFile

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
