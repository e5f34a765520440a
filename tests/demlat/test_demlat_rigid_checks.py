"""Rigid elements: stops, dependent rows, and what is refused before a run."""

import numpy as np
import pytest
from rigid_bodies import (
    TETRAHEDRON,
    braced,
    chain,
    constraints,
    dihedral,
    gauss_seidel,
    make,
    miura,
    moved,
)

from openprc.demlat import observables
from openprc.demlat.models.barhinge.constraint_table import satisfy
from openprc.errors import ConfigError

# --- stops ------------------------------------------------------------------------------------

TRIANGLES = [(0, 1), (0, 2), (1, 2), (0, 3), (1, 3)]


@pytest.mark.parametrize(("angle", "expected"), [(0.95, 1.0), (1.5, 1.5), (2.06, 2.0), (1.0, 1.0)])
def test_hinges_are_pushed_back_to_their_stops_and_left_alone_between_them(angle, expected):
    body = dihedral(angle, bars=TRIANGLES, hinges=[(0, 1, 2, 3)], limits=(1.0, 2.0))
    x = body.x
    _, residual = body.sweep(x)
    assert residual <= 1e-13
    after = observables.hinge_angles(body.columns(x)[None], body.geometry.hinges)[0, 0]
    assert after == pytest.approx(expected, abs=1e-12)
    if angle == expected == 1.5:
        np.testing.assert_array_equal(x, body.x)


@pytest.mark.parametrize(
    ("angle", "rate", "stays"),
    [(1.0, -1.0, False), (1.0, 1.0, True), (2.0, 1.0, False), (2.0, -1.0, True), (1.5, 1.0, True)],
)
def test_a_stop_takes_the_speed_that_runs_into_it(angle, rate, stays):
    body = dihedral(angle, bars=TRIANGLES, hinges=[(0, 1, 2, 3)], limits=(1.0, 2.0))
    free = rate * observables.hinge_gradients(
        body.geometry.positions[None], body.geometry.hinges.indices
    )
    start = np.zeros((4, 3))
    start[[0, 1, 2, 3]] = free[0, 0]
    v = body.flat(start)
    body.project_velocities(body.x, v)
    before = v.copy()
    constraints.gradients(body.x, body.inverse_mass, *body.tail)
    gauss_seidel.gauss_seidel_velocities(body.x, v, body.inverse_mass, *body.tail, 1e-14, 5000)
    after = observables.hinge_rates(
        body.geometry.positions[None], body.columns(v)[None], body.geometry.hinges
    )[0, 0]
    if stays:
        np.testing.assert_allclose(v, before, rtol=0, atol=1e-14)
        assert after * rate > 0.1
    else:
        assert abs(after) < 1e-12


# --- rank -------------------------------------------------------------------------------------


def rank(body, x):
    return np.linalg.matrix_rank(body.jacobian(x) * np.sqrt(body.inverse_mass), tol=1e-9)


def test_bars_that_others_imply_are_left_out_and_named():
    rng = np.random.default_rng(0)
    pairs = [(i, j) for i in range(6) for j in range(i)]
    body = make(rng.normal(size=(6, 3)), bars=pairs)
    assert body.system.n_rows == 3 * 6 - 6 == rank(body, body.x)
    assert len(body.system.redundant) == 15 - 12
    assert body.system.singular == ()
    assert all(name.startswith("bar ") for name in body.system.redundant)
    assert "3 rigid element(s) are implied by the others" in body.system.remarks[0]
    x = moved(body, 1e-4)
    assert body.project(x)[1] < 1e-13
    ends = body.columns(x)[body.geometry.bars.indices]
    lengths = np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1)
    np.testing.assert_allclose(lengths, body.geometry.bars.rest_length, rtol=1e-12)


@pytest.mark.parametrize("n", [4, 30])  # the large one is where pivots alone misjudge
def test_a_braced_lattice_in_its_plane_keeps_as_many_rows_as_it_has_rank(n):
    positions, bars = braced(n)
    in_plane = np.zeros((n * n, 3), dtype=bool)
    in_plane[:, 2] = True
    body = make(positions, bars=bars, held=in_plane)
    assert body.system.n_rows == 2 * n * n - 3
    assert body.system.singular == ()


def test_a_lattice_that_is_free_to_leave_its_plane_is_known_to_be_singular():
    positions, bars = braced()
    body = make(positions, bars=bars)
    assert rank(body, body.x) == 2 * 16 - 3
    assert body.system.n_rows - len(body.system.singular) == 2 * 16 - 3
    shaken = body.x + body.flat(0.1 * np.random.default_rng(0).normal(size=(16, 3)))
    assert rank(body, shaken) >= 42 - 1
    assert "in the starting shape only" in body.system.remarks[-1]


def test_a_sheet_that_starts_flat_loses_none_of_its_bars():
    body = miura(tilt=0.0)
    assert body.system.redundant == ()
    assert len(body.system.singular) > 0
    assert miura().system.singular == ()


def test_dependent_rows_do_no_harm_while_they_last():
    body = chain(2, fixed=(0, 2))  # straight between two walls
    assert len(body.system.singular) == 1
    v = body.flat([[0, 0, 0], [0.5, 1.0, 0], [0, 0, 0]])
    body.project_velocities(body.x, v)
    np.testing.assert_allclose(body.columns(v)[1], [0.0, 1.0, 0.0], atol=1e-15)


def test_a_long_truss_is_not_taken_for_dependent():
    n = 40
    positions = np.zeros((2 * n, 3))
    positions[0::2, 0] = positions[1::2, 0] = np.arange(n)
    positions[1::2, 1] = 0.05
    bars = [
        *((2 * i, 2 * i + 1) for i in range(n)),
        *((2 * i, 2 * i + 2) for i in range(n - 1)),
        *((2 * i + 1, 2 * i + 3) for i in range(n - 1)),
        *((2 * i, 2 * i + 3) for i in range(n - 1)),
    ]
    held = np.zeros((2 * n, 3), dtype=bool)
    held[:, 2] = True
    body = make(positions, bars=bars, held=held)
    assert body.system.n_rows == len(bars)
    x = moved(body, 1e-3)
    assert body.project(x)[1] < 1e-12


# --- input ------------------------------------------------------------------------------------


def test_elements_between_held_nodes_are_no_rows():
    body = make([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], bars=TETRAHEDRON, fixed=(0, 1, 2))
    assert body.system.n_rows == 3
    nothing = make([[0, 0, 0], [1, 0, 0]], bars=[(0, 1)], fixed=(0, 1))
    assert nothing.system.n_rows == 0
    assert nothing.project(nothing.x) == (0, 0.0)


def test_held_nodes_at_the_wrong_distance_or_angle():
    with pytest.raises(ConfigError, match=r"bar 0 \(nodes 0-1\).*of 1\.1 m, .*held 1 m apart"):
        make([[0, 0, 0], [1, 0, 0]], bars=[(0, 1)], fixed=(0, 1), rest={("bar", 0): 1.1})
    with pytest.raises(ConfigError, match=r"hinge 0 .*rest angle of 1\.2 rad, .*held at 1 rad"):
        dihedral(1.0, hinges=[(0, 1, 2, 3)], fixed=range(4), rest={("hinge", 0): 1.2})


def test_positions_that_contradict_a_rest_length_or_angle():
    with pytest.raises(ConfigError, match=r"bar 1 \(nodes 1-2\) is rigid, .*gap of -0\.00"):
        make([[0, 0, 0], [1, 0, 0], [2, 0, 0]], bars=[(0, 1), (1, 2)], rest={("bar", 1): 1.005})
    with pytest.raises(ConfigError, match=r"hinge 0 \(nodes 0-1-2-3\) is rigid, .*gap of .* rad"):
        dihedral(1.0, hinges=[(0, 1, 2, 3)], rest={("hinge", 0): 1.2})


def test_redundant_bar_that_contradicts_the_others():
    rng = np.random.default_rng(0)
    pairs = [(i, j) for i in range(5) for j in range(i)]
    positions = rng.normal(size=(5, 3))
    length = np.linalg.norm(positions[4] - positions[3])
    with pytest.raises(ConfigError, match="is rigid and contradicts the other rigid elements by"):
        make(positions, bars=pairs, rest={("bar", 9): length * (1 + 5e-4)})
    within = make(positions, bars=pairs, rest={("bar", 9): length * (1 + 1e-7)})
    assert len(within.system.redundant) == 1


def test_small_gaps_at_the_start_can_be_closed():
    positions = miura().geometry.positions.astype(np.float32)
    lengths = miura().geometry.bars.rest_length
    source = miura()
    body = make(
        positions,
        bars=source.geometry.bars.indices,
        fixed=np.flatnonzero(source.geometry.fixed),
        rest={("bar", b): length for b, length in enumerate(lengths) if b not in (0, 1)},
    )
    x = body.x
    gap = satisfy(body.system, x=x, inverse_mass=body.inverse_mass)
    assert 1e-9 < gap < 1e-6
    assert constraints.values(x, *body.tail) < 1e-13
    assert satisfy(body.system, x=x, inverse_mass=body.inverse_mass) < 1e-13


def test_a_gap_that_no_positions_close():
    body = chain(2, fixed=(0, 2))
    x = body.x
    x[2] += 1e-5
    with pytest.raises(ConfigError, match=r"bar \d .*cannot be closed together with the others"):
        satisfy(body.system, x=x, inverse_mass=body.inverse_mass)


def test_a_bar_without_length_and_a_wing_on_its_crease():
    with pytest.raises(ConfigError, match=r"bar 0 .*rest length of 0 m"):
        make([[0, 0, 0], [0, 0, 0]], bars=[(0, 1)])
    with pytest.raises(ConfigError, match="a wing of it lies on the crease"):
        make([[0, 0, 0], [1, 0, 0], [0.5, 0, 0], [0, 1, 0]], hinges=[(0, 1, 2, 3)])
