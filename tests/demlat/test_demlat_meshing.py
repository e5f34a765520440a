"""What every mesh has, the record itself, lattices and slender bodies."""

import math
from dataclasses import replace

import numpy as np
import pytest
from mesh_topology import edges_of, euler_characteristic

from openprc.demlat import SimulationSetup, meshing
from openprc.demlat.geometry_builder import GeometryBuilder
from openprc.demlat.meshing import Mesh, surface_mesh
from openprc.demlat.meshing.cutting import cut_along
from openprc.demlat.meshing.ordering import canonical_hinges, unit_stride_runs
from openprc.demlat.meshing.surface import split_quads
from openprc.errors import ConfigError
from openprc.schema.geometry_checks import check_geometry
from openprc.schema.mistakes import Mistakes

DEGREE = math.pi / 180
MESHES = {
    "square": lambda: meshing.square_lattice(5, 4, spacing=0.1),
    "square-none": lambda: meshing.square_lattice(5, 4, spacing=0.1, diagonals="none"),
    "plate": lambda: meshing.square_lattice(5, 4, spacing=0.1, diagonals="one", bending=True),
    "triangular": lambda: meshing.triangular_lattice(5, 4, spacing=0.1, bending=True),
    "hexagonal": lambda: meshing.hexagonal_lattice(3, 3, side=0.1),
    "delaunay": lambda: meshing.delaunay_lattice(
        60, np.random.default_rng(2), width=2.0, height=1.0, bending=True
    ),
    "chain": lambda: meshing.chain(4, link_length=0.1),
    "rod": lambda: meshing.rod(6, length=1.0, radius=0.1),
    "spring": lambda: meshing.tapered_spring(
        2, 24, height=0.3, coil_radius=(0.1, 0.05), wire_radius=(0.02, 0.01)
    ),
    "miura": lambda: meshing.miura_sheet(
        2, 3, a=0.03, b=0.02, sector_angle=55 * DEGREE, tilt=40 * DEGREE
    ),
    "miura-flat": lambda: meshing.miura_sheet(2, 3, a=0.03, b=0.02, sector_angle=1.0, tilt=0.0),
    "kresling": lambda: meshing.kresling(
        5, 3, radius=0.1, height=0.1, twist=50 * DEGREE, alternate=True
    ),
    "yoshimura": lambda: meshing.yoshimura(6, 4, radius=0.1, height=0.05),
    "cone": lambda: meshing.k_cone(4, radius=0.1, opening=1.2, rings=3),
    "cone-hole": lambda: meshing.k_cone(3, radius=0.1, opening=1.2, inner_radius=0.03, rings=2),
    "waterbomb": lambda: meshing.waterbomb(3, 4, cell=0.1),
    "kirigami": lambda: meshing.kirigami_sheet(9, 7, spacing=0.01, slit=4, bridge=2, slit_rows=2),
    "slab": lambda: meshing.bistable_slab(7, 3, span=1.0, width=0.3, rise=0.1),
}
SHEETS = [name for name in MESHES if len(MESHES[name]().hinges)]


@pytest.fixture(scope="module")
def made():
    return {name: make() for name, make in MESHES.items()}


def test_every_public_name_exists():
    for name in meshing.__all__:
        assert getattr(meshing, name).__name__ == name
    assert dir(meshing) == sorted(meshing.__all__)
    with pytest.raises(AttributeError, match="no attribute 'cube'"):
        meshing.cube  # noqa: B018


# --- what holds for all -----------------------------------------------------------------------


@pytest.mark.parametrize("name", MESHES)
def test_no_bar_is_there_twice_and_all_have_a_length(made, name):
    mesh = made[name]
    assert len(edges_of(mesh.bars)) == len(mesh.bars)
    assert mesh.bar_lengths.min() > 1e-3
    assert np.array_equal(mesh.rest_lengths, mesh.bar_lengths)
    assert np.unique(mesh.bars).tolist() == list(range(mesh.n_nodes)), "a node without bar"


@pytest.mark.parametrize("name", SHEETS)
def test_every_hinge_lies_between_two_faces_and_has_bars_on_all_edges(made, name):
    mesh = made[name]
    bars = edges_of(mesh.bars)
    faces = {tuple(np.roll(face, turn).tolist()) for face in mesh.faces for turn in range(3)}
    for j, k, i, l in mesh.hinges.tolist():  # noqa: E741
        assert j < k
        assert {tuple(sorted(p)) for p in ((j, k), (j, i), (k, i), (j, l), (k, l))} <= bars
        assert (j, k, i) in faces
        assert (k, j, l) in faces


@pytest.mark.parametrize("name", SHEETS)
def test_every_inner_edge_has_one_hinge(made, name):
    mesh = made[name]
    creases = edges_of(mesh.hinges[:, :2])
    rims = edges_of(mesh.bars[mesh.bar_kinds == "boundary"])
    assert len(creases) == len(mesh.hinges)
    if rims:
        assert creases | rims == edges_of(mesh.bars)
        assert not creases & rims
        assert np.unique(list(rims)).tolist() == mesh.node_sets["boundary"].tolist()


@pytest.mark.parametrize(
    ("name", "wanted"),
    [("plate", 1), ("triangular", 1), ("delaunay", 1), ("miura", 1), ("waterbomb", 1),
     ("slab", 1), ("cone", 1), ("kresling", 0), ("yoshimura", 0), ("cone-hole", 0)],
)  # fmt: skip
def test_sheets_are_discs_and_tubes_are_tubes(made, name, wanted):
    assert euler_characteristic(made[name]) == wanted


@pytest.mark.parametrize("name", MESHES)
def test_the_files_take_every_mesh(made, name):
    mesh = made[name]
    builder = GeometryBuilder()
    builder.add_node([9, 9, 9])
    nodes = mesh.to_setup(builder, mass=0.01, stiffness=100.0, hinge_stiffness=0.1, fixed=[0])
    geometry = builder.geometry()
    mistakes = Mistakes()
    check_geometry(geometry, mistakes)
    assert mistakes.found == []
    assert nodes.tolist() == list(range(1, mesh.n_nodes + 1))
    assert np.array_equal(geometry.positions[nodes], mesh.positions)
    assert np.array_equal(geometry.bars.indices - 1, mesh.bars)
    assert np.array_equal(geometry.bars.rest_length, mesh.rest_lengths)
    assert np.array_equal(geometry.hinges.indices - 1, mesh.hinges)
    assert np.array_equal(geometry.hinges.rest_angle, mesh.rest_angles)
    assert np.array_equal(geometry.faces - 1, mesh.faces)
    assert np.flatnonzero(geometry.fixed).tolist() == [1]


@pytest.mark.parametrize(
    ("make", "bars", "hinges"),
    [
        (lambda: meshing.square_lattice(30, 30, spacing=1.0), 28, 0),
        (lambda: meshing.triangular_lattice(30, 30, spacing=1.0, bending=True), 29, 20),
        (lambda: meshing.miura_sheet(8, 8, a=1, b=1, sector_angle=1.0, tilt=0.5), 15, 15),
        (lambda: meshing.rod(50, length=1.0, radius=0.01), 49, 0),
        (lambda: meshing.waterbomb(20, 20, cell=1.0), 18, 10),
        (lambda: meshing.hexagonal_lattice(20, 20, side=1.0), 19, 0),
    ],
)
def test_elements_of_one_direction_are_runs_with_unit_stride(make, bars, hinges):
    mesh = make()
    assert unit_stride_runs(mesh.bars).mean() > bars
    if hinges:
        assert unit_stride_runs(mesh.hinges).mean() > hinges


# --- the record -------------------------------------------------------------------------------

SQUARE = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]


def fold(height):
    """Two triangles; node 3, left of the crease 0-2, is lifted."""
    points = np.array(SQUARE, dtype=float)
    points[3] += [0, 0, height]
    return surface_mesh(points, [[0, 1, 2], [0, 2, 3]])


@pytest.mark.parametrize(("height", "sense"), [(0.2, 1), (0.0, 0), (-0.2, -1)])
def test_a_valley_has_an_angle_below_pi_seen_from_the_side_the_faces_turn_to(height, sense):
    mesh = fold(height)
    assert mesh.hinges.tolist() == [[0, 2, 3, 1]]
    assert mesh.senses.tolist() == [sense]
    assert mesh.angles[0] == pytest.approx(math.pi - math.atan(height * math.sqrt(2)))
    assert mesh.rest_angles.tolist() == mesh.angles.tolist()


def test_exchanging_crease_and_wings_together_keeps_the_angle():
    mesh = fold(0.3)
    turned = replace(mesh, hinges=[[2, 0, 1, 3]], rest_angles=None)
    assert turned.hinges.tolist() == mesh.hinges.tolist()
    assert turned.angles.tolist() == mesh.angles.tolist()
    other = replace(mesh, hinges=[[2, 0, 3, 1]], rest_angles=None)
    assert other.angles[0] == pytest.approx(2 * math.pi - mesh.angles[0])
    assert canonical_hinges([[5, 2, 7, 9]]).tolist() == [[2, 5, 9, 7]]


def test_folding_sets_rest_angles_by_sense():
    mesh = replace(fold(0.2), senses=[1]).folded(0.5)
    assert mesh.rest_angles.tolist() == [math.pi - 0.5]
    assert replace(mesh, senses=[-1]).folded(0.5).rest_angles.tolist() == [math.pi + 0.5]
    assert replace(mesh, senses=[0]).folded(2.0).rest_angles.tolist() == [math.pi - 0.5]


def test_moving_a_mesh_changes_no_length_and_no_angle(made):
    turn = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))
    mesh = made["miura"]
    moved = mesh.moved(by=[1, 2, 3], rotation=turn)
    assert np.allclose(moved.bar_lengths, mesh.bar_lengths, atol=1e-15)
    assert np.allclose(moved.angles, mesh.angles, atol=1e-13)
    assert np.allclose(moved.positions[0], [1, 2, 3])


def test_folds_facets_and_rims_have_their_own_stiffness(tmp_path, made):
    mesh = made["miura"]
    setup = SimulationSetup(tmp_path, overwrite=True)
    mesh.to_setup(
        setup,
        mass=mesh.lumped_masses(0.1),
        stiffness={"fold": 3.0, "facet": 2.0, "boundary": 1.0},
        damping=0.5,
        hinge_stiffness=mesh.hinge_values({"fold": 0.1, "facet": 1.0}) * mesh.crease_lengths,
        hinge_damping={"fold": 0.0, "facet": 0.2},
        rigid=["facet"],
        collidable=True,
    )
    geometry = setup.geometry()
    for kind, value in (("fold", 3.0), ("facet", 2.0), ("boundary", 1.0)):
        assert set(geometry.bars.stiffness[mesh.bar_kinds == kind]) == {value}
    folds = mesh.hinge_kinds == "fold"
    assert np.allclose(geometry.hinges.stiffness[folds], 0.1 * mesh.crease_lengths[folds])
    assert np.allclose(geometry.hinges.stiffness[~folds], mesh.crease_lengths[~folds])
    assert np.array_equal(geometry.hinges.damping, np.where(folds, 0.0, 0.2))
    assert np.array_equal(geometry.bars.rigid, mesh.bar_kinds == "facet")
    assert geometry.collidable.all()
    panels = 4 * 6 * 0.03 * 0.02 * math.sin(55 * DEGREE)
    assert geometry.masses.sum() == pytest.approx(0.1 * panels)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"hinge_stiffness": None}, "1 hinges without stiffness"),
        ({"stiffness": {"fold": 1.0}}, "no value for bars of the kind boundary"),
        ({"stiffness": {"fold": 1, "boundary": 1, "rim": 1}}, "no bars of the kind rim"),
        ({"hinge_stiffness": {"facet": 1.0}}, "no hinges of the kind facet"),
        ({"mass": [1.0, 2.0]}, r"nodes: shape \(2,\)"),
        ({"fixed": [4]}, r"fixed: nodes \[4\](.|\n)*from 0 to 3"),
        ({"fixed": [0.5]}, "fixed"),
        ({"rigid": ["edge"]}, "rigid: no bars of the kind edge"),
    ],
)
def test_settings_that_do_not_fit_the_mesh_are_refused(options, words):
    settings = {"mass": 1.0, "stiffness": 1.0, "hinge_stiffness": 1.0}
    builder = GeometryBuilder()
    with pytest.raises(ConfigError, match=words):
        fold(0.0).to_setup(builder, **{**settings, **options})
    assert builder.n_nodes == 0


def test_a_node_without_face_has_no_lumped_mass():
    with pytest.raises(ConfigError, match="node 0, 1, 2, 3, 4 belongs to no face"):
        meshing.chain(4, link_length=1.0).lumped_masses(1.0)


@pytest.mark.parametrize(
    ("columns", "words"),
    [
        ({"bars": [[0, 1], [1, 0]], "bar_kinds": ["a", "a"]}, r"two bars between nodes \[0, 1\]"),
        ({"bars": [[0, 4]], "bar_kinds": ["a"]}, "mesh/bars: node 4(.|\n)*from 0 to 3"),
        ({"bars": [[0, 1]], "bar_kinds": []}, r"mesh/bar_kinds: shape \(0,\)(.|\n)*\(1,\)"),
        ({"bars": [[0, 1]], "bar_kinds": ["a"], "node_sets": {"x": [9]}}, "mesh/x: node 9"),
    ],
)
def test_a_mesh_that_does_not_fit_together_is_refused(columns, words):
    with pytest.raises(ConfigError, match=words):
        Mesh(positions=SQUARE, **columns)


@pytest.mark.parametrize(
    ("faces", "words"),
    [
        ([[0, 1, 2], [0, 3, 2]], r"two triangles at edge \[0, 2\] turn to different sides"),
        ([[0, 1, 2], [0, 2, 3], [0, 4, 2]], r"3 triangles meet at the edge \[0, 2\]"),
    ],
)
def test_faces_that_make_no_sheet_are_refused(faces, words):
    with pytest.raises(ConfigError, match=words):
        surface_mesh([*SQUARE, [0.5, 0.5, 1.0]], faces)


def test_quads_are_cut_along_the_shorter_diagonal():
    points = np.array([[0, 0, 0], [2, 0, 0], [3, 1, 0], [1, 1, 0]], dtype=float)
    triangles, diagonals = split_quads(points, [[0, 1, 2, 3]])
    assert diagonals.tolist() == [[1, 3]]
    twice_areas = np.cross(points[triangles[:, 1]] - points[triangles[:, 0]],
                     points[triangles[:, 2]] - points[triangles[:, 0]])[:, 2]  # fmt: skip
    assert twice_areas.tolist() == [2.0, 2.0]
    assert split_quads(points, [[0, 1, 2, 3]], short=False)[1].tolist() == [[0, 2]]


def test_a_slit_that_ends_in_the_sheet_opens_between_its_tips():
    mesh = meshing.square_lattice(5, 3, spacing=1.0, diagonals="one")
    torn, origin = cut_along(15, mesh.faces, [[6, 7], [7, 8]])
    assert origin.tolist() == [*range(15), 7]
    assert np.array_equal(origin[torn], mesh.faces)
    same, whole = cut_along(15, mesh.faces, [])
    assert np.array_equal(same, mesh.faces)
    assert len(whole) == 15
    split, parts = cut_along(15, mesh.faces, [[n, n + 1] for n in range(5, 9)])
    assert len(parts) == 20
    assert not set(split[:4].ravel().tolist()) & set(split[4:8].ravel().tolist())
