"""Cutting panels and drawings into what a mesh is made of."""

import math

import numpy as np
import pytest

from openprc.demlat.meshing.planar_graph import panels_of, split_crossings
from openprc.demlat.meshing.polygons import triangulate, turned_alike
from openprc.errors import ConfigError

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
