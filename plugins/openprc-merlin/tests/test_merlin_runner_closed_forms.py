"""Equilibrium paths whose every point is known: trusses, a fold, a Kresling cell."""

from __future__ import annotations

from itertools import islice

import numpy as np
import pytest
from openprc_merlin.arc_length import arc_length_path
from openprc_merlin.displacement_control import Station, controlled_path
from openprc_merlin.equilibrium_path import Balance, PathSettings, newton

from openprc.demlat.statics import StaticProblem
from openprc.schema.geometry import Bars, Geometry, Hinges

B, H, K = 1.0, 0.3, 100.0
L0 = np.hypot(B, H)


def truss(law="linear"):
    """Two bars of half span B and rise H; the apex moves up and down only."""
    body = Geometry(
        positions=[[-B, 0, 0], [B, 0, 0], [0, 0, H]],
        masses=[1.0, 1.0, 1.0],
        fixed=[True, True, False],
        bars=Bars(indices=[[0, 2], [1, 2]], stiffness=[K, K], rest_length=[L0, L0], law=[law, law]),
    )
    return StaticProblem(geometry=body, held=[[0, 0, 0], [0, 0, 0], [1, 1, 0]])


def truss_load(w, law):
    """Return the force that pushes the apex down by w."""
    z = H - w
    length = np.hypot(B, z)
    stretch = length / L0
    tension = K * (length - L0) if law == "linear" else K * L0 * (stretch**4 - 1.0) / 4.0
    return -2.0 * tension * z / length


def down(problem):
    load = np.zeros_like(problem.positions)
    load[2, 2] = -1.0
    return load


def fitted_turn(w, load, at):
    """Return where a parabola through three neighbouring points turns."""
    a, b, c = np.polyfit(w[at - 1 : at + 2] - w[at], load[at - 1 : at + 2], 2)
    return w[at] - b / (2 * a), c - b * b / (4 * a)


@pytest.mark.parametrize("law", ["linear", "ogden"])
def test_von_mises_truss_snaps_through_along_the_closed_form(law):
    problem = truss(law)
    path = arc_length_path(
        Balance(problem, down(problem)), problem.positions, first_factor=0.1, arc_length=0.006
    )
    points = list(islice(path, 110))
    w = H - np.array([point.positions[2, 2] for point in points])
    load = np.array([point.factor for point in points])
    assert w[-1] > 2 * H > w[-12]
    assert (np.diff(w) > 0).all()
    np.testing.assert_allclose(load, truss_load(w, law), rtol=0, atol=1e-11)
    # Unstable under the load between the limit points, and only there.
    exact = np.gradient(truss_load(w, law), w) < 0
    negative = np.array([point.n_negative for point in points])
    changes = np.flatnonzero(np.diff(negative))
    assert set(negative.tolist()) == {0, 1}
    assert (negative[1:-1] == exact[1:-1]).mean() > 0.95
    assert len(changes) == 2
    top = int(load[: len(load) // 2].argmax())
    where, most = fitted_turn(w, load, top)
    if law == "linear":
        limit = 2 * K * (L0 ** (2 / 3) - B ** (2 / 3)) ** 1.5
        z = np.sqrt((L0 * B**2) ** (2 / 3) - B**2)
        assert limit == pytest.approx(0.99499170, abs=1e-8)
        assert (most, where) == (pytest.approx(limit, rel=1e-5), pytest.approx(H - z, rel=1e-3))


def test_easy_steps_grow_until_they_are_a_fiftieth_of_a_bar():
    problem = truss()
    path = arc_length_path(Balance(problem, down(problem)), problem.positions, first_factor=0.02)
    height = [H, *(point.positions[2, 2] for point in islice(path, 20))]
    steps = -np.diff(height)
    np.testing.assert_allclose(steps[1:5] / steps[:4], 1.5, rtol=1e-6)
    np.testing.assert_allclose(steps[-8:], 0.02 * L0, rtol=1e-6)


def test_reactions_balance_the_load():
    problem = truss()
    path = arc_length_path(Balance(problem, down(problem)), problem.positions, first_factor=0.1)
    point = next(path)
    np.testing.assert_allclose(point.reactions.sum(axis=0), [0, 0, point.factor], atol=1e-12)
    assert point.reactions[2, 2] == 0.0
    assert point.residual < 1e-12


def test_load_beyond_the_limit_snaps_to_the_far_branch():
    problem = truss()
    start = problem.positions
    stations = [Station(positions=start, loads=f * down(problem)) for f in (0.5, 0.9, 1.1)]
    rest = Station(positions=start, loads=np.zeros_like(start))
    found = list(controlled_path(Balance(problem), start, stations, begin=rest, unstable="settle"))
    for point, load in zip(found, (0.5, 0.9, 1.1), strict=True):
        assert truss_load(H - point.positions[2, 2], "linear") == pytest.approx(load, abs=1e-10)
        assert point.n_negative == 0
    assert H - found[1].positions[2, 2] < 0.13
    assert H - found[2].positions[2, 2] > 2 * H


def test_displacement_control_passes_both_limit_points():
    problem = truss()
    held = problem.held | [[False] * 3, [False] * 3, [False, False, True]]
    body = StaticProblem(geometry=problem.geometry, held=held)
    depths = np.linspace(0, 0.65, 14)
    stations = []
    for w in depths:
        x = body.positions.copy()
        x[2, 2] = H - w
        stations.append(Station(positions=x, loads=np.zeros_like(x)))
    points = controlled_path(Balance(body), body.positions, stations[1:], begin=stations[0])
    pull = [-point.reactions[2, 2] for point in points]
    np.testing.assert_allclose(pull, truss_load(depths[1:], "linear"), atol=1e-12)


def test_fold_is_lifted_by_the_closed_form_force():
    # Crease 2 long, wing 1 high, K = 0.4 N m: F = K phi / (r cos phi), sin phi = z / r.
    x = np.array([[-1.0, 0, 0], [0, 1, 0], [0, -1, 0], [1, 0, 0]])
    pairs = np.array([[1, 2], [0, 1], [0, 2], [1, 3], [2, 3]])
    body = Geometry(
        positions=x,
        masses=np.ones(4),
        bars=Bars(
            indices=pairs,
            stiffness=np.full(5, 1e6),
            rest_length=np.linalg.norm(x[pairs[:, 0]] - x[pairs[:, 1]], axis=1),
            law=["ogden"] * 5,
        ),
        hinges=Hinges(
            indices=[[1, 2, 0, 3]],
            stiffness=[0.4],
            rest_angle=[np.pi],
            law=["enhanced-linear"],
            limit_low=[np.pi / 4],
            limit_high=[7 * np.pi / 4],
        ),
    )
    held = np.zeros((4, 3), bool)
    held[:3] = True
    held[3, 2] = True
    problem = StaticProblem(geometry=body, held=held)
    heights = np.linspace(0, 0.6, 7)
    stations = []
    for z in heights:
        moved = x.copy()
        moved[3, 2] = z
        stations.append(Station(positions=moved, loads=np.zeros((4, 3))))
    path = controlled_path(Balance(problem), x, stations[1:], begin=stations[0])
    for z, point in zip(heights[1:], path, strict=True):
        phi = np.arcsin(z)
        assert point.reactions[3, 2] == pytest.approx(0.4 * phi / np.cos(phi), rel=1e-6)


def test_kresling_cell_is_free_of_strain_in_its_second_state():
    # psi2 = pi - psi1, h2^2 = h1^2 - 4 R^2 cos(psi1) cos(pi / n), whatever the stiffness.
    n, h1, psi = 6, 1.75, np.radians(50.0)
    h2 = np.sqrt(h1**2 - 4.0 * np.cos(psi) * np.cos(np.pi / n))
    assert h2 == pytest.approx(0.91423104, abs=1e-8)
    turn = 2 * np.pi * np.arange(n) / n
    bottom = np.stack([np.cos(turn), np.sin(turn), np.zeros(n)], axis=1)
    top = np.stack([np.cos(turn + psi - np.pi / n), np.sin(turn + psi - np.pi / n)], axis=1)
    x = np.concatenate([bottom, np.column_stack([top, np.full(n, h1)])])
    k = np.arange(n)
    pairs = np.concatenate(
        [
            np.stack([n + k, n + (k + 1) % n], 1),
            np.stack([k, n + k], 1),
            np.stack([k, n + (k + 1) % n], 1),
        ]
    )
    length = np.linalg.norm(x[pairs[:, 0]] - x[pairs[:, 1]], axis=1)
    np.testing.assert_allclose(np.unique(length.round(8)), [1.0, 1.78412857, 2.17145197])
    body = Geometry(
        positions=x,
        masses=np.ones(2 * n),
        fixed=np.repeat([True, False], n),
        bars=Bars(
            indices=pairs, stiffness=500.0 / length, rest_length=length, law=["ogden"] * len(pairs)
        ),
    )
    held = np.zeros((2 * n, 3), bool)
    held[n:, 2] = True
    problem = StaticProblem(geometry=body, held=held)
    stations = []
    for z in [*np.linspace(h1, 0.95, 17), h2]:
        moved = x.copy()
        moved[n:, 2] = z
        stations.append(Station(positions=moved, loads=np.zeros_like(x)))
    balance = Balance(problem, settings=PathSettings(max_iterations=50))
    points = list(controlled_path(balance, x, stations[1:], begin=stations[0]))
    pull = np.array([point.reactions[n:, 2].sum() for point in points])
    assert np.abs(pull).max() > 10.0
    assert abs(pull[-1]) < 1e-9
    ends = points[-1].positions[pairs]
    assert np.abs(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) / length - 1).max() < 1e-12
    twist = np.degrees(np.arctan2(*points[-1].positions[n, 1::-1])) + 180.0 / n
    assert twist == pytest.approx(180.0 - 50.0, abs=1e-8)


def test_correction_is_quadratic():
    problem = truss("ogden")
    balance = Balance(problem, 0.5 * down(problem))
    x, iterations, negative = newton(balance, problem.positions.copy())
    assert (iterations, negative) == (4, 0)
    assert balance.point(x, 1.0, iterations=0, n_negative=0).residual < 1e-13
