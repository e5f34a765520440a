"""Origami, kirigami and the slab against their closed forms."""

import math
from dataclasses import replace

import numpy as np
import pytest

from openprc.demlat import meshing
from openprc.errors import ConfigError

DEGREE = math.pi / 180


def sector_sums(mesh):
    """Return the sum of the angles of the faces around each node [rad]."""
    sums = np.zeros(mesh.n_nodes)
    corners = mesh.positions[mesh.faces]
    for corner in range(3):
        one = corners[:, (corner + 1) % 3] - corners[:, corner]
        two = corners[:, (corner + 2) % 3] - corners[:, corner]
        angle = np.arctan2(np.linalg.norm(np.cross(one, two), axis=1), (one * two).sum(axis=1))
        np.add.at(sums, mesh.faces[:, corner], angle)
    return sums


def inner_nodes(mesh):
    return np.setdiff1d(np.arange(mesh.n_nodes), mesh.node_sets["boundary"])


def energy(mesh, positions, *, k=1.0, bend=1.0):
    moved = replace(mesh, positions=positions)
    stretch = moved.bar_lengths - mesh.rest_lengths
    return (
        0.5 * k * (stretch**2).sum() + 0.5 * bend * ((moved.angles - mesh.rest_angles) ** 2).sum()
    )


@pytest.mark.parametrize(
    "mesh",
    [
        meshing.miura_sheet(3, 4, a=0.03, b=0.02, sector_angle=1.0, tilt=0.7),
        meshing.kresling(6, 4, radius=1.0, height=1.75, twist=50 * DEGREE),
        meshing.kresling(5, 4, radius=1.0, height=1.2, twist=1.3, alternate=True),
        meshing.yoshimura(7, 5, radius=1.0, height=0.4),
        meshing.k_cone(5, radius=1.0, opening=1.1, rings=3),
        meshing.waterbomb(3, 4, cell=1.0),
        meshing.bistable_slab(9, 5, span=1.0, width=0.4, rise=0.2),
    ],
    ids=["miura", "kresling", "kresling-alternate", "yoshimura", "cone", "waterbomb", "slab"],
)
def test_sheets_are_developable(mesh):
    inner = inner_nodes(mesh)
    assert len(inner) > 0
    assert np.abs(sector_sums(mesh)[inner] - 2 * math.pi).max() < 1e-13


# --- Miura ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("tilt", "h", "s", "l", "v", "minor"),
    [
        (15, 0.44828774, 1.71671253, 1.94911213, 1.02610823, 15.261480),
        (45, 1.22474487, 1.54919334, 1.58113883, 1.26491106, 53.130102),
        (75, 1.67303261, 0.81812985, 1.09588407, 1.82501056, 123.626429),
    ],
)
def test_a_miura_sheet_has_its_closed_form(tilt, h, s, l, v, minor):  # noqa: E741
    mesh = meshing.miura_sheet(4, 3, a=2.0, b=2.0, sector_angle=60 * DEGREE, tilt=tilt * DEGREE)
    width, length, height = np.ptp(mesh.positions, axis=0)
    assert width == pytest.approx(2 * 4 * s, abs=1e-7)
    assert length == pytest.approx(2 * 3 * l + v, abs=1e-7)
    assert height == pytest.approx(h, abs=1e-8)
    bend = np.abs(mesh.angles - math.pi) / DEGREE
    folds = mesh.hinge_kinds == "fold"
    assert np.abs(bend[~folds]).max() < 1e-12
    along_x = np.abs(np.diff(mesh.positions[mesh.hinges[folds, :2]][:, :, 0], axis=1))[:, 0] > s / 2
    assert np.allclose(bend[folds][along_x], 2 * tilt, atol=1e-10)
    assert np.allclose(bend[folds][~along_x], minor, atol=1e-6)


def test_the_panels_of_a_miura_sheet_are_plane_and_keep_their_edges():
    for tilt in np.linspace(0.0, 1.5, 7):
        mesh = meshing.miura_sheet(3, 3, a=1.3, b=0.7, sector_angle=1.1, tilt=tilt)
        rigid = mesh.bar_lengths[mesh.bar_kinds != "facet"]
        assert np.minimum(np.abs(rigid - 1.3), np.abs(rigid - 0.7)).max() < 1e-14
        facets = mesh.bar_lengths[mesh.bar_kinds == "facet"]
        short = math.sqrt(1.3**2 + 0.7**2 - 2 * 1.3 * 0.7 * math.cos(1.1))
        assert np.abs(facets - short).max() < 1e-14
        assert np.abs(mesh.angles[mesh.hinge_kinds == "facet"] - math.pi).max() < 1e-13


@pytest.mark.parametrize(("tilt", "wanted"), [(15, -2.799038), (45, -1.5), (75, -0.200962)])
def test_the_poisson_ratio_of_a_miura_sheet(tilt, wanted):
    def size(angle):
        mesh = meshing.miura_sheet(1, 1, a=2.0, b=2.0, sector_angle=60 * DEGREE, tilt=angle)
        s = mesh.positions[3, 0]
        return s, mesh.positions[2, 1] - mesh.positions[0, 1]

    step = 1e-5
    (s0, l0), (s1, l1) = size(tilt * DEGREE - step), size(tilt * DEGREE + step)
    ratio = -((l1 - l0) / (l1 + l0)) / ((s1 - s0) / (s1 + s0))
    assert ratio == pytest.approx(wanted, abs=1e-5)


def test_every_vertex_of_a_miura_sheet_obeys_maekawa_and_a_flat_one_knows_its_folds():
    folded = meshing.miura_sheet(3, 3, a=1.0, b=1.0, sector_angle=1.0, tilt=0.8)
    flat = meshing.miura_sheet(3, 3, a=1.0, b=1.0, sector_angle=1.0, tilt=0.0)
    assert np.array_equal(flat.hinges, folded.hinges)
    assert np.array_equal(flat.senses, folded.senses)
    assert np.array_equal(np.sign(math.pi - folded.angles[folded.senses != 0]),
                          folded.senses[folded.senses != 0])  # fmt: skip
    excess = np.zeros(flat.n_nodes)
    for end in range(2):
        np.add.at(excess, flat.hinges[:, end], flat.senses)
    assert set(np.abs(excess[inner_nodes(flat)])) == {2.0}


def test_the_rest_shape_of_one_miura_sheet_suits_another():
    flat = meshing.miura_sheet(2, 2, a=1.0, b=1.0, sector_angle=1.0, tilt=0.1)
    folded = meshing.miura_sheet(2, 2, a=1.0, b=1.0, sector_angle=1.0, tilt=0.8)
    mesh = replace(flat, rest_angles=folded.angles)
    assert energy(mesh, folded.positions) < 1e-24
    assert energy(mesh, flat.positions) > 1.0


# --- towers -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("sides", "twist", "height", "other"),
    [(6, 50, 1.75, 0.91423104), (6, 45, 1.6, 0.33243083), (8, 60, 1.5, 0.63422467)],
)
def test_both_states_of_a_kresling_tower_have_the_same_bars(sides, twist, height, other):
    form = {"radius": 1.0, "height": height, "twist": twist * DEGREE}
    low, turned = meshing.kresling_second_state(sides, **form)
    assert low == pytest.approx(other, abs=1e-8)
    assert turned == pytest.approx(math.pi - twist * DEGREE)
    one = meshing.kresling(sides, 3, **form)
    two = meshing.kresling(sides, 3, radius=1.0, height=low, twist=turned)
    assert np.array_equal(one.bars, two.bars)
    assert np.abs(one.bar_lengths - two.bar_lengths).max() < 1e-14
    assert np.abs(one.angles - two.angles).max() > 0.1
    back = meshing.kresling_second_state(sides, radius=1.0, height=low, twist=turned)
    assert back == pytest.approx((height, twist * DEGREE))


def test_the_bars_of_a_kresling_tower():
    mesh = meshing.kresling(6, radius=1.0, height=1.75, twist=50 * DEGREE)
    lengths = np.unique(mesh.bar_lengths.round(8))
    assert lengths.tolist() == [1.0, 1.78412857, 2.17145197]
    assert (mesh.n_nodes, len(mesh.bars), len(mesh.hinges)) == (12, 24, 12)
    assert mesh.node_sets["top"].tolist() == list(range(6, 12))


def test_alternating_levels_do_not_turn_the_top():
    form = {"radius": 1.0, "height": 1.0, "twist": 1.0}
    tower = meshing.kresling(6, 2, alternate=True, **form)
    assert np.allclose(tower.positions[12:, :2], tower.positions[:6, :2], atol=1e-15)
    turned = meshing.kresling(6, 2, **form)
    azimuth = math.atan2(turned.positions[12, 1], turned.positions[12, 0])
    assert azimuth == pytest.approx(2 * (1.0 - math.pi / 6))


def test_a_kresling_tower_with_one_state_is_refused():
    with pytest.raises(ConfigError, match=r"one state without strain only(.|\n)*above 1.6"):
        meshing.kresling_second_state(6, radius=1.0, height=0.5, twist=0.7)


def test_a_yoshimura_tube_has_two_lengths_and_valleys_on_its_rings():
    n, radius, height = 6, 1.0, 0.5
    mesh = meshing.yoshimura(n, 4, radius=radius, height=height)
    ring = 2 * radius * math.sin(math.pi / n)
    leg = math.hypot(height, 2 * radius * math.sin(math.pi / (2 * n)))
    level = np.abs(np.diff(mesh.positions[mesh.bars][:, :, 2], axis=1))[:, 0] < 1e-12
    assert np.allclose(mesh.bar_lengths, np.where(level, ring, leg), rtol=1e-14)
    flat = np.abs(np.diff(mesh.positions[mesh.hinges[:, :2]][:, :, 2], axis=1))[:, 0] < 1e-12
    assert set(mesh.senses[flat]) == {1}
    assert set(mesh.senses[~flat]) == {-1}
    centre = mesh.positions[mesh.faces].mean(axis=1)
    corners = mesh.positions[mesh.faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert ((normal * centre)[:, :2].sum(axis=1) > 0).all(), "faces turn outwards"


# --- cone and waterbomb -----------------------------------------------------------------------


@pytest.mark.parametrize("k", [2, 3, 4, 7])
def test_both_states_of_a_cone_have_plane_sectors_of_the_same_size(k):
    one = meshing.k_cone(k, radius=1.0, opening=1.2, rings=2)
    two = meshing.k_cone(k, radius=1.0, opening=1.2, rings=2, popped=True)
    flat = meshing.k_cone(k, radius=1.0, opening=math.pi / 2, rings=2)
    for mesh in (one, two):
        assert np.abs(mesh.bar_lengths - flat.bar_lengths).max() < 1e-7 * (1 + k)
        assert np.abs(mesh.angles[mesh.hinge_kinds == "facet"] - math.pi).max() < 1e-12
    assert np.abs(one.bar_lengths - two.bar_lengths).max() < 1e-14
    assert np.abs(flat.positions[:, 2]).max() < 1e-7
    assert (one.positions[one.node_sets["troughs"], 2] < 0.9 * np.cos(1.2)).all()
    assert (
        two.positions[two.node_sets["troughs"], 2] > one.positions[one.node_sets["troughs"], 2]
    ).all()


def test_the_folds_of_a_cone_alternate_and_a_narrow_sheet_is_no_disc():
    mesh = meshing.k_cone(4, radius=1.0, opening=1.2)
    assert sorted(mesh.senses.tolist()) == [-1] * 4 + [1] * 4
    narrow = meshing.k_cone(4, radius=1.0, opening=0.9, sheet_angle=1.6 * math.pi)
    assert sector_sums(narrow)[narrow.node_sets["apex"][0]] == pytest.approx(1.6 * math.pi)


def test_a_cone_with_a_hole():
    mesh = meshing.k_cone(5, radius=1.0, opening=1.2, inner_radius=0.25, rings=3)
    distance = np.linalg.norm(mesh.positions, axis=1)
    assert np.allclose(distance[mesh.node_sets["hole"]], 0.25)
    assert np.allclose(distance[mesh.node_sets["rim"]], 1.0)
    assert mesh.n_nodes == 40


def test_every_vertex_of_a_waterbomb_sheet_obeys_maekawa_and_kawasaki():
    mesh = meshing.waterbomb(4, 5, cell=1.0)
    inner = inner_nodes(mesh)
    excess = np.zeros(mesh.n_nodes)
    for end in range(2):
        np.add.at(excess, mesh.hinges[:, end], mesh.senses)
    assert set(np.abs(excess[inner])) == {2.0}
    for node in inner:
        creases = mesh.hinges[(mesh.hinges[:, :2] == node).any(axis=1), :2]
        ends = creases.sum(axis=1) - node
        arm = mesh.positions[ends] - mesh.positions[node]
        angle = np.sort(np.arctan2(arm[:, 1], arm[:, 0]))
        sectors = np.diff(np.append(angle, angle[0] + 2 * math.pi))
        assert len(sectors) == 6
        assert sectors[::2].sum() == pytest.approx(math.pi)
    assert mesh.lumped_masses(1.0).sum() == pytest.approx(20.0)
    folded = mesh.folded(0.3)
    assert np.allclose(folded.rest_angles, math.pi - 0.3 * mesh.senses)


# --- kirigami and slab ------------------------------------------------------------------------


def test_the_slits_of_a_kirigami_sheet_separate_it():
    whole = meshing.square_lattice(13, 9, spacing=0.1, diagonals="one")
    mesh = meshing.kirigami_sheet(12, 8, spacing=0.1, slit=4, bridge=2, slit_rows=2)
    assert len(mesh.faces) == len(whole.faces)
    assert mesh.lumped_masses(1.0).sum() == pytest.approx(1.2 * 0.8)
    # Each cut edge is one more bar; hinges across cuts are gone.
    cut = len(mesh.bars) - len(whole.bars)
    assert cut == (4 + 4) + (1 + 4 + 3) + (4 + 4)
    inner = len(whole.bars) - 2 * (12 + 8)
    assert len(mesh.hinges) == inner - cut
    assert set(mesh.hinge_kinds) == {"facet"}
    shared = np.unique(mesh.positions.round(9), axis=0)
    assert len(shared) == whole.n_nodes
    assert mesh.n_nodes > whole.n_nodes
    assert len(mesh.node_sets["top"]) == 13


def test_the_mirrored_shape_of_a_slab_has_the_same_energy_and_a_barrier_between():
    mesh = meshing.bistable_slab(15, 4, span=1.0, width=0.3, rise=0.12)
    up = mesh.positions
    assert np.ptp(up[:, 2]) == pytest.approx(0.12)
    assert np.ptp(up[:, 0]) == pytest.approx(1.0)
    assert np.allclose(up[mesh.node_sets["left"], 2], 0.0, atol=1e-16)
    mirror, flat = up * [1, 1, -1], up * [1, 1, 0]
    assert energy(mesh, mirror) == pytest.approx(energy(mesh, up), rel=1e-10)
    assert energy(mesh, up, bend=0.0) < 1e-28
    assert energy(mesh, flat, bend=1e-6) > 50 * energy(mesh, up, bend=1e-6)
    sides = mesh.bar_lengths[np.diff(mesh.bars, axis=1)[:, 0] == 1]
    assert np.ptp(sides) < 1e-14


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: meshing.miura_sheet(1, 1, a=1, b=1, sector_angle=1.6, tilt=0.5),
         "sector_angle: found 1.6(.|\n)*between 0 and 1.57"),
        (lambda: meshing.miura_sheet(1, 1, a=1, b=1, sector_angle=1, tilt=math.pi / 2), "tilt"),
        (lambda: meshing.miura_sheet(1, 1, a=0, b=1, sector_angle=1, tilt=0.1), "a: found 0"),
        (lambda: meshing.kresling(2, radius=1, height=1, twist=1), "sides: found 2"),
        (lambda: meshing.kresling(6, radius=1, height=1, twist=4.0), "twist: found 4.0"),
        (lambda: meshing.yoshimura(6, 2, radius=1, height=math.nan), "height: found nan"),
        (lambda: meshing.k_cone(1, radius=1, opening=1), "k: found 1"),
        (lambda: meshing.k_cone(4, radius=1, opening=1, inner_radius=1), "a hole of 1 m"),
        (lambda: meshing.k_cone(4, radius=1, opening=1.5, sheet_angle=3.0),
         "an opening of 1.5 rad for sectors of 3 rad in all"),
        (lambda: meshing.kirigami_sheet(9, 9, spacing=1, slit=3, bridge=2), "an even sum"),
        (lambda: meshing.kirigami_sheet(9, 2, spacing=1, slit=4, bridge=2, slit_rows=2),
         "no slit in 2 rows"),
        (lambda: meshing.bistable_slab(9, 3, span=1, width=1, rise=0.5), "rise: found 0.5"),
        (lambda: meshing.bistable_slab(2, 3, span=1, width=1, rise=0.1), "columns: found 2"),
        (lambda: meshing.waterbomb(1, 0, cell=1), "rows: found 0"),
    ],
)  # fmt: skip
def test_numbers_that_make_no_sheet_are_refused(make, words):
    with pytest.raises(ConfigError, match=words):
        make()
