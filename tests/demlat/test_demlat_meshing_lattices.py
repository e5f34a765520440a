"""Lattices and slender bodies against what is known of them."""

import math

import numpy as np
import pytest
from mesh_topology import euler_characteristic

from openprc.demlat import meshing
from openprc.demlat.meshing.surface import shared_edges
from openprc.errors import ConfigError

# --- lattices ---------------------------------------------------------------------------------


@pytest.mark.parametrize(("diagonals", "bars"), [("none", 180), ("one", 261), ("both", 342)])
def test_a_square_lattice(diagonals, bars):
    mesh = meshing.square_lattice(10, 10, spacing=0.1, diagonals=diagonals)
    assert len(mesh.bars) == bars
    sides = mesh.bar_lengths[mesh.bar_kinds == "edge"]
    assert np.allclose(sides, 0.1, rtol=1e-14)
    assert np.allclose(mesh.bar_lengths[mesh.bar_kinds == "diagonal"], 0.1 * math.sqrt(2))
    assert mesh.node_sets["left"].tolist() == list(range(0, 100, 10))
    assert mesh.node_sets["top"].tolist() == list(range(90, 100))
    assert np.ptp(mesh.positions, axis=0).tolist() == pytest.approx([0.9, 0.9, 0.0])


def test_a_triangular_lattice_has_equal_bars_and_six_neighbours():
    mesh = meshing.triangular_lattice(6, 5, spacing=0.3)
    assert np.allclose(mesh.bar_lengths, 0.3, rtol=1e-14)
    degree = np.bincount(mesh.bars.ravel())
    inner = np.setdiff1d(np.arange(30), mesh.node_sets["boundary"])
    assert set(degree[inner]) == {6}
    assert len(mesh.bars) == 69
    assert len(mesh.faces) == 40


@pytest.mark.parametrize(("columns", "rows"), [(1, 1), (3, 2), (4, 5)])
def test_a_honeycomb_has_equal_bars_and_closed_cells(columns, rows):
    mesh = meshing.hexagonal_lattice(columns, rows, side=0.3)
    assert np.allclose(mesh.bar_lengths, 0.3, rtol=1e-14)
    degree = np.bincount(mesh.bars.ravel())
    assert set(degree) <= {2, 3}
    # Euler: bars - nodes + 1 closed cells.
    assert len(mesh.bars) - mesh.n_nodes + 1 == columns * rows


def test_a_random_lattice_keeps_its_distance_and_its_seed():
    one, two = (
        meshing.delaunay_lattice(300, np.random.default_rng(4), width=2.0, height=1.0)
        for _ in range(2)
    )
    assert np.array_equal(one.positions, two.positions)
    gap = 0.6 * math.sqrt(2.0 / 300)
    distance = np.linalg.norm(one.positions[:, None] - one.positions, axis=2)
    assert distance[~np.eye(300, dtype=bool)].min() >= gap
    assert one.n_nodes == 300
    assert len(one.node_sets["left"]) > 5
    corners = one.positions[one.faces]
    area = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[:, 2]
    assert area.min() > 0.0


@pytest.mark.parametrize("seed", range(6))
def test_the_rim_of_a_random_lattice_is_one_line(seed):
    rng = np.random.default_rng(seed)
    mesh = meshing.delaunay_lattice(12 + 9 * seed, rng, width=2.0, height=1.0, min_distance=0.0)
    rims = shared_edges(mesh.faces)[0]
    assert set(np.bincount(rims.ravel(), minlength=mesh.n_nodes)) <= {0, 2}
    assert euler_characteristic(mesh) == 1


# --- slender bodies ---------------------------------------------------------------------------


def stiffness_matrix(mesh, k):
    """Return the stiffness of the bars against small motions: (3 N, 3 N) [N/m]."""
    along = np.diff(mesh.positions[mesh.bars], axis=1)[:, 0] / mesh.bar_lengths[:, None]
    rows = np.zeros((len(mesh.bars), mesh.n_nodes, 3))
    number = np.arange(len(mesh.bars))
    rows[number, mesh.bars[:, 0]], rows[number, mesh.bars[:, 1]] = -along, along
    compatibility = rows.reshape(len(mesh.bars), -1)
    return compatibility.T @ (k[:, None] * compatibility)


def test_a_rod_has_no_mechanism():
    mesh = meshing.rod(4, length=1.0, radius=0.1)
    values = np.linalg.eigvalsh(stiffness_matrix(mesh, np.ones(len(mesh.bars))))
    assert (np.abs(values) < 1e-12).sum() == 6


@pytest.mark.parametrize("sides", [3, 4, 6])
def test_a_slender_rod_bends_like_a_beam(sides):
    """Tip deflection F L^3 / (3 E I) with E I = n EA r^2 / 2, braces being stiff."""
    radius, axial = 0.02, 50.0
    mesh = meshing.rod(40, length=2.0, radius=radius, sides=sides)
    rigidity = np.where(mesh.bar_kinds == "longeron", axial, 100 * axial)
    matrix = stiffness_matrix(mesh, rigidity / mesh.bar_lengths)
    force = np.zeros((mesh.n_nodes, 3))
    force[mesh.node_sets["right"], 2] = 1.0 / sides
    free = np.setdiff1d(np.arange(mesh.n_nodes), mesh.node_sets["left"])
    dofs = (3 * free[:, None] + np.arange(3)).ravel()
    moved = np.linalg.solve(matrix[np.ix_(dofs, dofs)], force[free].ravel())
    tip = moved.reshape(-1, 3)[np.isin(free, mesh.node_sets["right"]), 2].mean()
    assert tip == pytest.approx(2.0**3 / (3 * sides * axial * radius**2 / 2), rel=0.02)


def test_a_spring_tapers_and_does_not_twist():
    mesh = meshing.tapered_spring(
        3, 90, height=0.3, coil_radius=(0.1, 0.05), wire_radius=(0.01, 0.005)
    )
    rows = mesh.positions.reshape(3, 91, 3)
    centre = rows.mean(axis=0)
    assert np.allclose(np.hypot(*centre[:, :2].T), np.linspace(0.1, 0.05, 91), rtol=1e-12)
    wire = np.linalg.norm(rows - centre, axis=2)
    assert np.allclose(wire, np.linspace(0.01, 0.005, 91), rtol=1e-12)
    tangent = np.gradient(centre, axis=0)
    assert np.abs(np.einsum("csa,sa->cs", rows - centre, tangent)).max() < 1e-4 * 0.01 * 0.02 * 1e3
    # A frame without twist turns only as much as its tangent turns.
    spoke = (rows[0] - centre) / wire[0][:, None]
    turn = np.arccos(np.clip((spoke[1:] * spoke[:-1]).sum(1), -1, 1))
    unit = tangent / np.linalg.norm(tangent, axis=1, keepdims=True)
    bend = np.arccos(np.clip((unit[1:] * unit[:-1]).sum(1), -1, 1))
    assert (turn <= bend * (1 + 1e-6) + 1e-7).all()


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: meshing.square_lattice(0, 3, spacing=1.0), "columns: found 0"),
        (lambda: meshing.square_lattice(2.5, 3, spacing=1.0), "columns: found 2.5"),
        (lambda: meshing.square_lattice(5000, 5000, spacing=1.0), "25000000 nodes"),
        (lambda: meshing.square_lattice(3, 3, spacing=-1.0), "spacing: found -1.0"),
        (lambda: meshing.square_lattice(3, 3, spacing=float("inf")), "spacing: found inf"),
        (lambda: meshing.square_lattice(3, 3, spacing="1"), "spacing: found '1'"),
        (lambda: meshing.square_lattice(3, 3, spacing=1, diagonals="two"), "diagonals 'two'"),
        (lambda: meshing.square_lattice(3, 3, spacing=1, bending=True), "bending with 'both'"),
        (lambda: meshing.delaunay_lattice(50, np.random.default_rng(1), width=1, height=1,
                                          min_distance=0.3), "only [0-9]+ of 50 nodes fit 0.3 m"),
        (lambda: meshing.delaunay_lattice(2, np.random.default_rng(1), width=1, height=1),
         "n_nodes: found 2"),
        (lambda: meshing.rod(5, length=1.0, radius=0.1, sides=9), "9 sides"),
        (lambda: meshing.rod(5, length=1.0, radius=0.1, sides=2), "sides: found 2"),
        (lambda: meshing.tapered_spring(3, 20, height=1, coil_radius=1, wire_radius=0.1),
         "segments: found 20(.|\n)*from 24"),
        (lambda: meshing.tapered_spring(3, 30, height=0.1, coil_radius=1, wire_radius=0.1),
         "a wire radius of 0.1 m in a coil of radius 1 m"),
        (lambda: meshing.tapered_spring(3, 30, height=1, coil_radius=(1, 2, 3), wire_radius=0.1),
         "one radius, or two"),
    ],
)  # fmt: skip
def test_numbers_that_make_no_lattice_are_refused(make, words):
    with pytest.raises(ConfigError, match=words):
        make()
