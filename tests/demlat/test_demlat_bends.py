"""Bodies with bends in motion: closed forms, cantilevers, orders, balances, and SciPy."""

from dataclasses import replace

import numpy as np
import pytest
from slender_bodies import (
    cantilever,
    crooked_chain,
    experiment,
    scipy_motion,
    tip_deflection,
    triples,
)

from openprc.demlat import run_ensemble
from openprc.demlat.statics import StaticProblem, natural_modes
from openprc.schema.experiment import Actuator, Signal
from openprc.schema.geometry import Bars, Bends, Geometry

# --- one bend: closed forms ------------------------------------------------------------------


def arm(turn, *, velocity=0.0, sideways=0.0, damping=0.0, rotation=None):
    """Return a mass 2 kg on a rigid arm of 0.5 m, bent by `turn` at a clamp of 3 N*m/rad."""
    along = np.array([np.cos(turn), np.sin(turn), 0.0])
    ahead = np.array([-np.sin(turn), np.cos(turn), 0.0])
    turned = np.eye(3) if rotation is None else rotation
    return Geometry(
        positions=np.array([[-1.0, 0, 0], [0, 0, 0], 0.5 * along]) @ turned.T,
        masses=[1.0, 1.0, 2.0],
        fixed=[True, True, False],
        velocities=np.array([[0, 0, 0], [0, 0, 0], velocity * ahead + [0, 0, sideways]]) @ turned.T,
        bars=Bars(indices=[[1, 2]], stiffness=[0.0], rest_length=[0.5], rigid=[True]),
        bends=Bends(indices=[[0, 1, 2]], stiffness=[3.0], damping=[damping]),
    )


@pytest.mark.parametrize("damping", [0.0, 0.7])
def test_a_rigid_arm_swings_harmonically_at_any_amplitude(simulate, damping):
    """``m l^2 p'' + c p' + k p = 0`` holds for the turn p itself, through straight."""
    inertia, start = 2.0 * 0.5**2, 2.0
    scene = experiment(arm(start, damping=damping), integrator="rk4-dae", duration=3.0)
    run = simulate(scene)
    decay = damping / (2.0 * inertia)
    rate = np.sqrt(3.0 / inertia - decay**2)
    phase = rate * run.t
    turn = start * np.exp(-decay * run.t) * (np.cos(phase) + decay / rate * np.sin(phase))
    assert turn.min() < -0.5
    exact = 0.5 * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    np.testing.assert_allclose(run.x[:, 2, :2], exact, rtol=0, atol=1e-9)
    np.testing.assert_allclose(run.bend_angle[:, 0], np.pi - np.abs(turn), rtol=0, atol=1e-9)
    np.testing.assert_allclose(run.energy[:, 4], 1.5 * turn**2, rtol=0, atol=1e-8)
    if not damping:
        np.testing.assert_allclose(run.bend_moment[:, 0], -3.0 * np.abs(turn), rtol=0, atol=1e-8)
    assert np.abs(run.balance).max() < 1e-8 * run.energy[0, 4]


def test_a_straight_arm_is_damped_from_the_first_instant(simulate):
    """The direction of bending begins with the motion; half a step without it would show."""
    inertia, start, c = 0.5, 1.3, 0.7
    turned = np.linalg.qr(np.random.default_rng(1).standard_normal((3, 3)))[0]
    geometry = arm(0.0, velocity=0.5 * start, damping=c, rotation=turned)
    run = simulate(experiment(geometry, integrator="rk4-dae", duration=0.4, dt=0.01))
    decay = c / (2.0 * inertia)
    rate = np.sqrt(3.0 / inertia - decay**2)
    turn = start / rate * np.exp(-decay * run.t) * np.sin(rate * run.t)
    exact = 0.5 * np.stack([np.cos(turn), np.sin(turn), 0 * turn], axis=1) @ turned.T
    np.testing.assert_allclose(run.x[:, 2], exact, rtol=0, atol=2e-8)


def test_a_bent_arm_goes_round_steadily(simulate):
    """``m w^2 l sin p cos p = k p / l``, as for a pendulum on a cone; nothing is damped."""
    turn = 0.9
    spin = np.sqrt(3.0 * turn / (2.0 * 0.25 * np.sin(turn) * np.cos(turn)))
    geometry = arm(turn, sideways=spin * 0.5 * np.sin(turn), damping=0.4)
    run = simulate(experiment(geometry, integrator="rk4-dae", duration=2.0))
    around = 0.5 * np.sin(turn)
    exact = [around * np.cos(spin * run.t), around * np.sin(spin * run.t)]
    np.testing.assert_allclose(run.x[:, 2, 1:].T, exact, rtol=0, atol=1e-9)
    np.testing.assert_allclose(run.bend_angle[:, 0], np.pi - turn, rtol=0, atol=1e-10)
    assert np.abs(run.dissipated).max() < 1e-12


def test_three_free_nodes_vibrate_with_the_frequency_of_the_triple(simulate):
    """``w^2 = (k / l^2) (1 / m_1 + 4 / m_2 + 1 / m_3)`` for small motions across."""
    masses, k, l = np.array([0.5, 0.8, 0.5]), 2.0, 0.4  # noqa: E741
    shape = np.array([1.0, -2.0, 1.0]) / masses
    geometry = Geometry(
        positions=[[0, 0, 0], [l, 0, 0], [2 * l, 0, 0]],
        masses=masses,
        velocities=1e-6 * shape[:, None] * np.array([0, 0.6, 0.8]),
        bars=Bars(indices=[[0, 1], [1, 2]], stiffness=[1e3, 1e3], rest_length=[l, l]),
        bends=Bends(indices=triples(3), stiffness=[k]),
    )
    run = simulate(experiment(geometry, integrator="rk4", duration=1.0, save_interval=0.01))
    omega = np.sqrt(k / l**2 * (1 / 0.5 + 4 / 0.8 + 1 / 0.5))
    across = run.x @ np.array([0, 0.6, 0.8])
    exact = 1e-6 * shape * np.sin(omega * run.t)[:, None] / omega
    np.testing.assert_allclose(across, exact, rtol=0, atol=1e-8 * np.abs(exact).max())


# --- cantilevers -------------------------------------------------------------------------------

TIP = {5: 0.00954815, 10: 0.01133811, 20: 0.01228276}


@pytest.mark.parametrize("n", [5, 10])
def test_a_cantilever_settles_where_other_simulators_have_it(simulate, n):
    """The tips of a Cosserat rod without its shear, and of hinged rigid links."""
    down = Signal(name="down", values=[[0.0, 0.0, -0.005]], dt=60.0, interpolation="hold")
    scene = experiment(
        cantilever(n),
        signals={"down": down},
        actuators=(Actuator(node=n, signal="down", type="force"),),
        damping=0.3,
        duration=60.0,
        save_interval=60.0,
        dt=1e-3,
        integrator="verlet",
    )
    run = simulate(scene)
    tip = -run.x[-1, -1, 2]
    assert tip == pytest.approx(TIP[n], rel=1e-5)
    assert tip == pytest.approx(tip_deflection(n, 0.005), rel=2e-4)
    assert run.kinetic[-1] < 1e-20
    assert abs(run.balance[-1]) < 1e-6 * run.work_in[-1]


@pytest.mark.parametrize(("n", "frequency"), [(10, 0.195729), (20, 0.186072)])
def test_a_cantilever_vibrates_with_its_first_bending_frequency(simulate, n, frequency):
    geometry = cantilever(n)
    problem = StaticProblem(geometry=geometry)
    shape = natural_modes(problem, geometry.positions, n=1).shapes[0]
    start = 1e-6 * shape / np.abs(shape).max()
    scene = experiment(
        replace(geometry, velocities=start),
        integrator="verlet",
        duration=6.0,
        save_interval=0.05,
        dt=5e-4,
    )
    run = simulate(scene)
    omega = 2.0 * np.pi * frequency
    tip = np.einsum("ta,a->t", run.x[:, -1] - geometry.positions[-1], start[-1])
    exact = start[-1] @ start[-1] / omega * np.sin(omega * run.t)
    np.testing.assert_allclose(tip, exact, rtol=0, atol=4e-6 * np.abs(exact).max())


# --- large motions ------------------------------------------------------------------------------

ORDERS = {
    "rk4": 4, "verlet": 2, "pefrl": 4, "respa": 2, "midpoint": 2,
}  # fmt: skip
RIGID_ORDERS = {"rattle": 2, "rk4-dae": 4, "rk4-projection": 4}


@pytest.fixture(scope="module")
def swing():
    """A heavy chain of six nodes that hangs from the first, and SciPy's motion of it."""
    scene = experiment(
        crooked_chain(6, damping=0.5, fixed=(0,)), gravity=(0.0, 0.0, -9.81), damping=0.3
    )
    return scene, scipy_motion(scene)[0]


def orders(simulate, swing, integrator):
    scene, exact = swing
    found, balance = [], []
    for dt in (1e-2, 5e-3):
        run = simulate(replace(scene, integrator=integrator, dt=dt))
        found.append(np.abs(run.x - exact).max())
        balance.append(np.abs(run.balance).max())
    return np.log2(found[0] / found[1]), found[1], np.log2(balance[0] / balance[1])


@pytest.mark.parametrize("integrator", ORDERS)
def test_schemes_keep_their_order_with_bends(simulate, swing, integrator):
    order, error, balance = orders(simulate, swing, integrator)
    assert order == pytest.approx(ORDERS[integrator], abs=0.15)
    assert error < (1e-3 if ORDERS[integrator] == 2 else 1e-6)
    assert balance > ORDERS[integrator] - 0.6


@pytest.mark.slow
@pytest.mark.parametrize("integrator", RIGID_ORDERS)
def test_schemes_for_rigid_bars_keep_their_order_with_bends(simulate, swing, integrator):
    assert orders(simulate, swing, integrator)[0] == pytest.approx(
        RIGID_ORDERS[integrator], abs=0.15
    )


@pytest.mark.parametrize("integrator", ["dop853", pytest.param("rk45", marks=pytest.mark.slow)])
def test_adaptive_schemes_reach_scipys_motion(simulate, swing, integrator):
    scene, exact = swing
    run = simulate(replace(scene, integrator=integrator, tolerance=1e-9))
    np.testing.assert_allclose(run.x, exact, rtol=0, atol=5e-9)


@pytest.mark.parametrize("damping", [0.0, 0.4])
def test_a_free_chain_keeps_its_momenta_and_books_its_energy(simulate, damping):
    geometry = crooked_chain(8, damping=damping)
    run = simulate(experiment(geometry, duration=2.0, integrator="rk4"))
    momentum = np.einsum("n,tna->ta", geometry.masses, run.v)
    spin = np.einsum("n,tna->ta", geometry.masses, np.cross(run.x, run.v))
    np.testing.assert_allclose(momentum, momentum[:1].repeat(len(run.t), 0), rtol=0, atol=1e-13)
    np.testing.assert_allclose(spin, spin[:1].repeat(len(run.t), 0), rtol=0, atol=1e-9)
    assert np.abs(run.balance).max() < 1e-7 * run.kinetic[0]
    assert (run.ledger[-1, 5] > 0.1) == bool(damping)


def test_symplectic_schemes_neither_gain_nor_lose_energy(simulate):
    geometry = crooked_chain(6, fixed=(0,), rest="straight", speed=0.3)
    run = simulate(
        experiment(geometry, duration=100.0, save_interval=0.5, dt=2e-3, integrator="verlet")
    )
    error = run.balance / run.kinetic[0]
    assert np.abs(error).max() < 0.005
    assert abs(np.polyfit(run.t, error, 1)[0]) * 100.0 < 0.001


def test_stiff_bending_can_be_stepped_over(simulate):
    """Steps of 80 times the limit of rk4; the energy of the slow swing stays."""
    geometry = cantilever(20)
    mode = natural_modes(StaticProblem(geometry=geometry), geometry.positions, n=1).shapes[0]
    start = replace(geometry, velocities=0.02 * mode / np.abs(mode).max())
    scene = experiment(start, integrator="midpoint", dt=0.1, save_interval=0.1, duration=6.0)
    run = simulate(scene)
    assert run.energy[:, 4].max() > 0.9 * run.kinetic[0]
    assert np.abs(run.balance).max() < 1e-3 * run.kinetic[0]


# --- lanes ----------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def long_chain():
    scene = experiment(
        crooked_chain(60, damping=0.3, fixed=(0,)), gravity=(0, 0, -1.0), duration=0.2
    )
    return scene, scipy_motion(scene)[0]


def test_vectors_of_bends_move_as_single_ones(simulate, long_chain):
    scene, exact = long_chain
    np.testing.assert_allclose(simulate(scene).x, exact, rtol=0, atol=2e-9)


def test_single_precision_keeps_six_digits_of_the_motion(simulate, long_chain):
    scene, exact = long_chain
    run = simulate(replace(scene, precision="float32"))
    np.testing.assert_allclose(run.x, exact, rtol=0, atol=2e-6)


def test_small_bending_survives_single_precision(simulate):
    """Nodes move by 1e-6 of the length, of which coordinates in float32 would keep a digit."""
    scene = experiment(
        cantilever(59, bar_damping=0.01, bend_damping=1e-6),
        gravity=(0.0, 0.0, -1e-3),
        duration=0.04,
        dt=2e-4,
        save_interval=0.02,
    )
    exact = simulate(scene)
    found = simulate(replace(scene, precision="float32"))
    scale = np.abs(exact.x[-1, :, 2]).max()
    assert scale < 1e-6
    np.testing.assert_allclose(found.x[..., 2], exact.x[..., 2], rtol=0, atol=1e-5 * scale)


def test_planar_chains_are_stepped_in_the_plane(simulate):
    chain = crooked_chain(60, fixed=(0,), rest="straight")
    flat = {"positions": chain.positions * [1, 1, 0], "velocities": chain.velocities * [1, 1, 0]}
    scene = experiment(replace(chain, **flat), duration=0.2, gravity=(0, -1.0, 0))
    assert scene.planar
    run = simulate(scene)
    assert run.x.shape[2] == 2
    np.testing.assert_allclose(run.x, scipy_motion(scene)[0][..., :2], rtol=0, atol=1e-7)


def test_an_ensemble_steps_designs_with_bends_side_by_side(simulate):
    scene = experiment(crooked_chain(6, damping=0.5, fixed=(0,)), gravity=(0.0, 0.0, -9.81))
    bends = scene.geometry.bends
    designs = [
        replace(
            scene,
            geometry=replace(
                scene.geometry,
                bends=replace(bends, stiffness=factor * bends.stiffness, damping=0 * bends.damping),
            ),
        )
        for factor in (0.5, 1.0, 2.0)
    ]
    together = run_ensemble(designs)
    for number, design in enumerate(designs):
        np.testing.assert_allclose(
            together.positions[number], simulate(design).x, rtol=0, atol=1e-11
        )
