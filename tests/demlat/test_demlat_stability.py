"""The largest stable step: against closed forms, dense eigenvalues, and runs."""

from dataclasses import replace

import numpy as np
import pytest

from openprc.demlat.integrators import INTEGRATORS
from openprc.demlat.planning.stability import is_surely_sound, stable_step, step_limit
from openprc.demlat.planning.step_limits import (
    largest_step,
    pefrl_step,
    rk4_growth,
    rk4_loss,
    rk4_reach,
)
from openprc.demlat.planning.tangent_operators import TangentOperators
from openprc.demlat.statics import StaticProblem
from openprc.demlat.statics.element_shapes import hinge_gradients
from openprc.errors import Diverged

X, Y, Z = np.eye(3)
ROOT8 = 2.0 * np.sqrt(2.0)


# --- schemes on one mode -------------------------------------------------------------------------


def one_mode(scheme, zeta):
    return largest_step(scheme, np.array([[1.0]]), np.array([[2.0 * zeta]])).step


@pytest.mark.parametrize(
    ("scheme", "zeta", "limit"),
    [
        ("rk4", 0.0, ROOT8),
        ("rk4", 1.0, 2.7853),
        ("rk4", 2.0, 2.7853 / (2 + np.sqrt(3))),
        ("rk4", 5.0, 2.7853 / (5 + np.sqrt(24))),
        *(("verlet", z, 2 * (np.sqrt(1 + 4 * z * z) - 2 * z)) for z in (0.0, 0.1, 1.0, 3.0)),
        ("pefrl", 0.0, 2.9894),
    ],
)
def test_limits_on_one_mode_are_those_of_the_literature(scheme, zeta, limit):
    assert one_mode(scheme, zeta) == pytest.approx(limit, rel=2e-4)


def test_the_half_disc_of_rk4_is_stable_and_nearly_reached():
    reach = rk4_reach(np.exp(1j * np.linspace(np.pi / 2, np.pi, 2001)))
    assert 2.61 <= reach.min() < 2.63


def test_rk4_is_stable_all_the_way_to_its_reach():
    directions = np.exp(1j * np.linspace(np.pi / 2, np.pi, 201))
    inside = np.linspace(0.001, 0.999, 300)[:, None] * rk4_reach(directions)
    assert (np.abs(rk4_growth(inside * directions)) < 1.0).all()
    assert (np.abs(rk4_growth(1.001 * rk4_reach(directions) * directions)) > 1.0).all()


def test_the_loss_of_rk4_is_of_fifth_order_in_the_step():
    assert rk4_loss(0.02) == pytest.approx(2 * np.pi * 0.02**5 / 72, rel=1e-3)
    kept = abs(rk4_growth(np.array(0.5j))) ** (2 * 2 * np.pi / 0.5)
    assert rk4_loss(0.5) == pytest.approx(1 - kept, rel=1e-12)


def test_modes_that_grow_by_themselves_do_not_bound_the_step():
    still = np.zeros((2, 2))
    assert largest_step("verlet", np.diag([-1.0, -2.0]), still).step == np.inf
    assert largest_step("verlet", np.diag([-1.0, 4.0]), still).step == pytest.approx(1.0)
    assert largest_step("rk4", np.diag([-1.0, 4.0]), still).step == pytest.approx(ROOT8 / 2)
    assert largest_step("pefrl", np.diag([-1.0, 4.0]), still).step == pytest.approx(2.989 / 2)


def test_a_dashpot_on_another_mode_than_the_stiffest_counts():
    stiffness, damping = np.diag([1.0, 0.01]), np.diag([0.0, 10.0])
    fast = 5 + np.sqrt(25 - 0.01)
    assert largest_step("rk4", stiffness, damping).step == pytest.approx(2.78529 / fast, rel=1e-4)
    assert (
        pefrl_step(np.array([0.01]), np.array([10.0]))[0]
        < pefrl_step(np.array([1.0]), np.array([0.0]))[0]
    )


# --- bodies --------------------------------------------------------------------------------------


def test_the_stability_limit_of_one_bar_is_exact(body):
    k, m = 100.0, 0.5
    scene = body([0 * X, X], [m, m], bars=[(0, 1, k, 1, 0)])
    omega = np.sqrt(2 * k / m)
    limit = step_limit(scene)
    assert limit.limit == pytest.approx(ROOT8 / omega, rel=1e-9)
    assert limit.omega == pytest.approx(omega, rel=1e-9)
    assert limit.setter == "bar 0 between nodes 0 and 1"
    damped = body([0 * X, X], [m, m], bars=[(0, 1, k, 1, 50.0)])
    rate = 50.0 / m + np.sqrt((50.0 / m) ** 2 - omega**2)
    assert stable_step(damped) == pytest.approx(2.78529 / rate, rel=1e-5)
    assert step_limit(damped).zeta == pytest.approx(2 * 50.0 / m / (2 * omega))


def test_nothing_stiff_has_no_limit(body):
    limit = step_limit(body([0 * X], [1.0]))
    assert (limit.limit, limit.omega, limit.setter) == (np.inf, 0.0, "nothing")
    assert limit.verdict(1e9) == "fine"


def test_drag_alone_bounds_the_step(body):
    scene = body([0 * X, X], [1.0, 3.0], damping=8.0)
    limit = step_limit(scene)
    assert limit.limit == pytest.approx(2.78529 / (8.0 / 2.0), rel=1e-5)
    assert limit.setter.startswith("the drag on node")


@pytest.mark.parametrize("n", [5, 60])
def test_the_highest_frequency_of_a_chain_is_its_closed_form(body, n):
    k, m = 3.0, 0.2
    positions = np.outer(np.arange(n + 2), X)
    fixed = np.zeros(n + 2, dtype=bool)
    fixed[[0, -1]] = True
    bars = [(i, i + 1, k, 1.0, 0.0) for i in range(n + 1)]
    scene = body(positions, np.full(n + 2, m), bars=bars, fixed=fixed)
    exact = 2 * np.sqrt(k / m) * np.sin(n * np.pi / (2 * (n + 1)))
    # The 60 frequencies crowd at the top, where Lanczos is allowed its margin of 2 %.
    slack = 1e-9 if n == 5 else 0.021
    assert exact * (1 - 1e-9) <= step_limit(scene).omega <= exact * (1 + slack)


def test_a_taut_string_swings_across_by_its_tension(body):
    k, m, tension = 2.0, 0.1, 1.8
    scene = body(
        [0 * X, X + Z, 2 * X + 2 * Z], [m] * 3, bars=[(0, 1, k, 1, 0), (1, 2, k, 1, 0)],
        fixed=[True, False, True], prestress=[np.sqrt(2) - 1 - tension / k] * 2,
    )  # fmt: skip
    stiffness = dense(TangentOperators(scene).stiffness, 3)
    across = 2 * tension / np.sqrt(2) / m
    assert np.linalg.eigvalsh(stiffness) == pytest.approx([across, across, 2 * k / m])


def crossed(body, **settings):
    """A folded quad with a pinned corner, every kind of element, and some tension."""
    positions = [0 * X, X, [0.5, 0.8, 0.1], [0.5, -0.7, 0.2], [1.5, 0.5, 0.6]]
    bars = [
        (0, 1, 90.0, 0.9, 0.3), (0, 2, 40.0, 1.0, 0.2), (1, 2, 70.0, 0.9, 0.1),
        (0, 3, 50.0, 0.8, 0.4), (1, 3, 60.0, 0.9, 0.0), (1, 4, 30.0, 0.8, 0.6),
    ]  # fmt: skip
    hinges = [(0, 1, 2, 3, 0.7, 2.5, 0.05)]
    masses = [0.4, 0.2, 0.3, 0.1, 0.2]
    fixed = [True, False, False, False, False]
    settings = {"damping": 0.3} | settings
    return body(positions, masses, bars=bars, hinges=hinges, fixed=fixed, **settings)


def with_laws(scene):
    bars, hinges = scene.geometry.bars, scene.geometry.hinges
    laws = ["cubic", "ogden", "linear", "cable", "linear", "strut"]
    more = replace(bars, law=laws, stiffness_cubic=[500.0, 0, 0, 0, 0, 0])
    walls = replace(hinges, law=["enhanced-linear"], limit_low=[0.3], limit_high=[2.8])
    return replace(scene, geometry=replace(scene.geometry, bars=more, hinges=walls))


def dense(operator, n):
    return np.array([operator(row) for row in np.eye(n)]).T


@pytest.mark.parametrize("special", [False, True])
def test_the_tangent_is_the_second_derivative_of_the_energy(body, special):
    scene = with_laws(crossed(body)) if special else crossed(body)
    operators = TangentOperators(scene)
    problem = StaticProblem.from_experiment(scene)
    root = np.repeat(np.sqrt(scene.geometry.masses[1:]), 3)
    exact = problem.hessian(problem.positions).toarray()
    if special:  # the strut is slack, and counts as engaged
        start, end = scene.geometry.positions[[1, 4]]
        n = (end - start) / np.linalg.norm(end - start)
        exact[np.ix_([0, 1, 2, 9, 10, 11], [0, 1, 2, 9, 10, 11])] += 30.0 * np.kron(
            [[1, -1], [-1, 1]], np.outer(n, n)
        )
        # Its force is none, so it has no stiffness across.
        assert problem.bar_forces(problem.positions)[5] == 0.0
    stiffness = dense(operators.stiffness, 12)
    exact /= np.outer(root, root)
    if special:
        ratio = TangentOperators(replace(scene, geometry=scene.geometry))._ratio[5]
        assert ratio == 0.0
    assert stiffness == pytest.approx(exact, rel=1e-7, abs=1e-5)


@pytest.mark.parametrize("printed", [False, True])
def test_the_damping_is_that_of_the_laws(body, printed):
    scene = crossed(body, bar_damping="printed" if printed else "axial")
    operators, masses = TangentOperators(scene), scene.geometry.masses
    x, bars, hinges = scene.geometry.positions, scene.geometry.bars, scene.geometry.hinges
    v = np.random.default_rng(5).standard_normal((5, 3))
    v[0] = 0.0
    force = -0.3 / masses.mean() * masses[:, None] * v
    for (i, j), c, k in zip(bars.indices, bars.damping, bars.stiffness, strict=True):
        if printed:
            force[i] -= 2 * c * np.sqrt(masses[i] * k) * (v[i] - v[j])
            force[j] -= 2 * c * np.sqrt(masses[j] * k) * (v[j] - v[i])
        else:
            n = (x[j] - x[i]) / np.linalg.norm(x[j] - x[i])
            pull = c * np.dot(n, v[j] - v[i]) * n
            force[i] += pull
            force[j] -= pull
    gradient = hinge_gradients(x, hinges.indices)[0]
    force[hinges.indices[0]] -= 0.05 * np.sum(gradient * v[hinges.indices[0]]) * gradient
    root = np.sqrt(masses)[:, None]
    y = (root * v)[1:].ravel()
    expected = -(force / root)[1:].ravel()
    assert operators.damping(y) + operators.drag * y == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("scheme", ["rk4", "verlet", "pefrl"])
def test_a_small_body_has_the_limit_of_its_dense_matrices(body, scheme):
    scene = replace(crossed(body), integrator=scheme)
    operators = TangentOperators(scene)
    stiffness = dense(operators.stiffness, 12)
    damping = dense(operators.damping, 12) + operators.drag * np.eye(12)
    exact = largest_step(scheme, 0.5 * (stiffness + stiffness.T), damping).step
    assert stable_step(scene) == pytest.approx(exact, rel=1e-6)


@pytest.mark.parametrize("damping", [0.0, 0.02])
def test_a_lattice_has_the_limit_of_its_dense_matrices(lattice, damping):
    scene = lattice(9, damping=damping)
    operators = TangentOperators(scene)
    n = operators.n_free
    exact = np.sqrt(np.linalg.eigvalsh(dense(operators.stiffness, n))[-1])
    assert 0.9999 * exact <= step_limit(scene).omega <= 1.021 * exact
    assert np.sqrt(operators.stiffness_bound()) >= exact
    largest = np.linalg.eigvalsh(dense(operators.damping, n))[-1]
    assert operators.damping_bound() >= largest


def test_fixed_driven_and_planar_axes_do_not_move(body, drive):
    positions = [0 * X, X, 2 * X]
    bars = [(0, 1, 100.0, 1.0, 0), (1, 2, 1.0, 1.0, 0)]
    signal, actuator = drive(np.outer([1.0, 1.0], X), dt=1.0, node=1, type="position")
    scene = body(positions, [1.0] * 3, bars=bars, fixed=[True, False, False])
    held = replace(scene, signals={"u": signal}, actuators=(actuator,))
    assert step_limit(held).omega == pytest.approx(1.0)
    assert step_limit(held).setter == "bar 1 between nodes 1 and 2"
    assert TangentOperators(held).n_free == 2


def test_a_driven_node_stands_where_its_signal_begins(body, drive):
    # Stretched tenfold, the cubic spring has another tangent.
    signal, actuator = drive(np.outer([2.0, 2.0], X), dt=1.0, node=1, type="position")
    scene = body([0 * X, X, [1.0, 1.0, 0.0]], [1.0] * 3, bars=[(1, 2, 1.0, 1.0, 0)])
    cubic = replace(scene.geometry.bars, law=["cubic"], stiffness_cubic=[10.0])
    driven = replace(
        scene,
        geometry=replace(scene.geometry, bars=cubic),
        signals={"u": signal},
        actuators=(actuator,),
    )
    s = np.sqrt(2.0) - 1.0
    assert step_limit(driven).omega == pytest.approx(np.sqrt(1 + 30 * s * s), rel=1e-6)


def test_rigid_bars_add_no_stiffness(body):
    scene = body([0 * X, X, 2 * X], [1.0] * 3, bars=[(0, 1, 1e9, 1, 0), (1, 2, 2.0, 1, 0)])
    rigid = replace(scene.geometry.bars, rigid=[True, False])
    scene = replace(scene, geometry=replace(scene.geometry, bars=rigid))
    assert step_limit(scene).omega == pytest.approx(2.0)


def test_the_hinge_sets_the_limit_where_it_is_the_stiffest(body):
    k, m, h = 0.05, 0.01, 0.8
    scene = body([0 * X, X, [0.5, -h, 0], [0.5, h, 0]], [m] * 4, hinges=[(0, 1, 2, 3, k, np.pi, 0)])
    # The gradient of the angle is 1 / h at the wings and -1 / h at either end of the crease.
    omega = np.sqrt(k / m * 4 / h**2)
    assert stable_step(scene) == pytest.approx(ROOT8 / omega, rel=1e-6)
    assert step_limit(scene).setter == "hinge 0 on the crease 0-1"


def test_respa_is_bounded_by_its_hinges_alone(body):
    scene = replace(crossed(body, damping=0.0), integrator="respa")
    bars = replace(scene.geometry.bars, stiffness=1e6 * scene.geometry.bars.stiffness)
    stiff = replace(scene, geometry=replace(scene.geometry, bars=bars))
    assert stable_step(stiff) == stable_step(scene)
    assert step_limit(stiff).setter.startswith("hinge 0")


@pytest.mark.parametrize("scheme", ["rk45", "dop853"])
def test_schemes_that_choose_their_step_have_no_limit(body, scheme):
    limit = step_limit(replace(crossed(body), integrator=scheme))
    assert limit.limit == np.inf
    assert limit.omega > 0
    assert limit.verdict(1.0) == "fine"


# --- the limit separates what runs from what blows up --------------------------------------------


def growth(simulate, scene, share):
    """Largest velocity at the end of many steps, relative to the largest at the start."""
    h = share * stable_step(scene)
    timing = {"dt": h, "save_interval": h, "duration": 500 * h, "step_check": "warn"}
    try:
        speed = np.abs(simulate(replace(scene, **timing)).v).max(axis=(1, 2))
    except Diverged:
        return np.inf
    return speed[-20:].max() / speed[0]


def relaxed(scene):
    """The scene with every bar and hinge at rest, hit by small random velocities."""
    rng = np.random.default_rng(3)
    geometry = scene.geometry
    ends = geometry.positions[geometry.bars.indices]
    lengths = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    hits = 1e-7 * rng.uniform(-1, 1, geometry.positions.shape)
    hits[geometry.fixed] = 0.0
    bars = replace(geometry.bars, rest_length=lengths)
    return replace(scene, geometry=replace(geometry, bars=bars, velocities=hits))


@pytest.mark.parametrize("scheme", ["rk4", "verlet", "pefrl"])
@pytest.mark.parametrize("dashpots", [0.0, 1.0, 40.0])
def test_the_limit_is_sharp(body, simulate, scheme, dashpots):
    scene = relaxed(replace(crossed(body, damping=0.02), integrator=scheme))
    bars = replace(scene.geometry.bars, damping=dashpots * scene.geometry.bars.damping)
    hinges = replace(scene.geometry.hinges, stiffness=[0.7], rest_angle=[flat_angle(scene)])
    scene = replace(scene, geometry=replace(scene.geometry, bars=bars, hinges=hinges))
    assert growth(simulate, scene, 0.98) < 3.0
    assert growth(simulate, scene, 1.05) > 100.0


def flat_angle(scene):
    problem = StaticProblem.from_experiment(scene)
    return problem.bends(problem.positions)[0] + np.pi


# --- verdicts ------------------------------------------------------------------------------------


def test_verdicts_follow_the_step(lattice):
    limit = step_limit(lattice(3))
    assert [limit.verdict(s * limit.limit) for s in (0.3, 0.5, 0.9, 1.01)] == [
        "fine",
        "dissipative",
        "marginal",
        "unstable",
    ]
    assert limit.remark(0.3 * limit.limit) == ""
    assert "of the energy of the fastest mode" in limit.remark(0.5 * limit.limit)
    assert "deformation may lower it" in limit.remark(0.9 * limit.limit)
    assert "expect divergence" in limit.remark(1.01 * limit.limit)


def test_dissipation_is_no_matter_where_the_body_damps_more(lattice):
    limit = step_limit(lattice(3, damping=0.5))
    assert limit.zeta > 0.1
    assert limit.verdict(0.5 * limit.limit) == "fine"


def test_the_recommended_step_damps_no_more_than_the_body(lattice):
    undamped = step_limit(lattice(3))
    assert undamped.recommended == pytest.approx(0.35 * undamped.limit, rel=1e-6)
    some = step_limit(lattice(3, damping=0.2))
    phase = some.recommended * some.omega
    assert phase**5 / 144 == pytest.approx(some.zeta, rel=1e-6)
    much = step_limit(lattice(3, damping=2.0))
    assert much.recommended == pytest.approx(0.85 * much.limit)
    verlet = step_limit(replace(lattice(3), integrator="verlet"))
    assert verlet.recommended == pytest.approx(0.8 * verlet.limit)


@pytest.mark.parametrize("scheme", list(INTEGRATORS))
@pytest.mark.parametrize("damping", [0.0, 0.05, 2.0])
def test_what_is_surely_sound_is_fine(lattice, scheme, damping):
    scene = replace(lattice(3, damping=damping), integrator=scheme)
    sound = [is_surely_sound(replace(scene, dt=dt)) for dt in (1e-5, 1e-4, 1e-3, 1e-2)]
    limit = step_limit(scene)
    verdicts = [limit.verdict(dt) for dt in (1e-5, 1e-4, 1e-3, 1e-2)]
    assert sound[0]
    assert all(v == "fine" for s, v in zip(sound, verdicts, strict=True) if s)


def test_the_estimate_is_made_once(lattice):
    scene = lattice(3)
    assert step_limit(scene) is step_limit(scene)
