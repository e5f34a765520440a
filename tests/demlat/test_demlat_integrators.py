"""Schemes with a fixed step: measured order, energy and momentum, multiple time steps."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from openprc.demlat.integrators import INTEGRATORS, Settings
from openprc.demlat.integrators.respa import RESPA, inner_steps
from openprc.demlat.models.barhinge.assembly import assemble
from openprc.errors import ConfigError

X, Y, Z = np.eye(3)
SCHEMES = ["verlet", "pefrl", "respa"]


def slope(errors):
    """Mean order over successive halvings of the step."""
    return np.mean(np.log2(np.array(errors[:-1]) / np.array(errors[1:])))


@pytest.fixture(scope="module")
def orbit(body):
    """A mass on a spring that turns about its fixed end, with the exact period unknown."""

    def make(**settings):
        return body(
            [0 * X, 1.2 * X],
            [1.0, 1.0],
            bars=[(0, 1, 100.0, 1.0, 0.0)],
            fixed=[True, False],
            velocities=[0 * X, 3.0 * Y + 0.5 * Z],
            **settings,
        )

    return make


@pytest.mark.parametrize("damping", [0.0, 2.0])
@pytest.mark.parametrize("scheme", SCHEMES)
def test_declared_order_on_an_oscillator_with_closed_form(body, simulate, scheme, damping):
    k, m, a = 100.0, 1.0, 0.1
    scene = body(
        [0 * X, (1 + a) * X],
        [m, m],
        bars=[(0, 1, k, 1.0, damping)],
        fixed=[True, False],
        save_interval=0.5,
        duration=2.0,
        dt=0.05,
        integrator=scheme,
    )
    rate = damping / (2 * m)
    omega = np.sqrt(k / m - rate**2)
    errors, gaps = [], []
    for dt in 0.025 / 2 ** np.arange(5):
        run = simulate(replace(scene, dt=dt))
        exact = np.cos(omega * run.t) + rate / omega * np.sin(omega * run.t)
        exact *= a * np.exp(-rate * run.t)
        errors.append(np.abs(run.x[:, 1, 0] - 1 - exact).max())
        gaps.append(np.abs(run.balance).max())
    assert slope(errors) == pytest.approx(INTEGRATORS[scheme].order, abs=0.1)
    assert slope(gaps) == pytest.approx(INTEGRATORS[scheme].order, abs=0.25)


@pytest.mark.parametrize("damping", [0.0, 0.02])
@pytest.mark.parametrize("interpolation", ["hold", "linear", "cubic"])
@pytest.mark.parametrize("kind", ["force", "position"])
@pytest.mark.parametrize("scheme", SCHEMES)
def test_driven_lattices_keep_the_order(
    lattice, simulate, drive, scheme, kind, interpolation, damping
):
    # Jumps and kinks of signals fall on ends of steps, where forces are carried over.
    scene = lattice(3, damping=damping)
    values = np.random.default_rng(1).uniform(-1, 1, (13, 3))
    if kind == "position":
        values = scene.geometry.positions[8] + 0.01 * values
    signal, actuator = drive(values, dt=0.025, node=8, type=kind, interpolation=interpolation)
    scene = replace(
        scene,
        signals={"u": signal},
        actuators=(actuator,),
        save_interval=0.1,
        duration=0.3,
        damping=damping,
        gravity=(0.0, 0.0, -9.81),
        integrator=scheme,
    )
    runs = [simulate(replace(scene, dt=0.1 / n)) for n in (256, 512, 1024, 2048)]
    order = INTEGRATORS[scheme].order
    errors = [np.abs(a.x - b.x).max() for a, b in pairwise(runs)]
    assert slope(errors) == pytest.approx(order, abs=0.2)
    gaps = [np.abs(run.balance).max() for run in runs[:-1]]
    assert slope(gaps) == pytest.approx(order, abs=0.35)
    assert gaps[-1] < 5e-3 * np.ptp(runs[-1].work_in)


@pytest.mark.parametrize("scheme", SCHEMES)
def test_second_order_or_more_with_damped_hinges(body, simulate, scheme):
    positions = [0 * X, X, [0.5, -0.8, 0.2], [0.5, 0.8, 0.3]]
    pairs = [(0, 1), (0, 2), (1, 2), (0, 3), (1, 3)]
    lengths = [np.linalg.norm(np.subtract(positions[i], positions[j])) for i, j in pairs]
    scene = body(
        positions,
        [0.1] * 4,
        bars=[(i, j, 50, 1.02 * n, 0.01) for (i, j), n in zip(pairs, lengths, strict=True)],
        hinges=[(0, 1, 2, 3, 0.5, np.pi + 0.5, 0.01)],
        save_interval=0.25,
        duration=1.0,
        dt=0.25 / 16,
        integrator=scheme,
    )
    runs = [simulate(replace(scene, dt=0.25 / n)) for n in (32, 64, 128, 256)]
    errors = [np.abs(a.x - b.x).max() for a, b in pairwise(runs)]
    order = INTEGRATORS[scheme].order
    assert slope(errors) == pytest.approx(order, abs=0.2)
    gaps = [np.abs(run.balance).max() for run in runs[:-1]]
    assert slope(gaps) == pytest.approx(order, abs=0.5)


@pytest.mark.parametrize(
    ("scheme", "bound"), [("verlet", 1.5e-2), ("respa", 1.5e-2), ("pefrl", 2e-4)]
)
def test_energy_errors_stay_bounded_over_ten_thousand_periods(orbit, simulate, scheme, bound):
    period = 2 * np.pi / 10
    scene = orbit(
        duration=1e4 * period, save_interval=10 * period, dt=period / 20, integrator=scheme
    )
    run = simulate(scene)
    energy = run.kinetic + run.potential
    error = np.abs(energy / energy[0] - 1)
    assert error.max() < bound
    assert error[-100:].max() < 1.5 * error[1:101].max()


def test_the_runge_kutta_scheme_loses_energy_where_verlet_does_not(orbit, simulate):
    # What the bound above is worth: at the same step the default scheme loses the vibration.
    period = 2 * np.pi / 10
    run = simulate(orbit(duration=1e4 * period, save_interval=10 * period, dt=period / 20))
    energy = run.kinetic + run.potential
    assert energy[-1] < 0.95 * energy[0]


@pytest.mark.parametrize("scheme", SCHEMES)
def test_free_bodies_keep_their_momenta(lattice, simulate, scheme):
    scene = lattice(3, pinned=False, duration=2.0, dt=1e-3, integrator=scheme)
    run = simulate(scene)
    m = scene.geometry.masses[:, np.newaxis]
    momentum = np.sum(m * run.v, axis=1)
    spin = np.sum(m * np.cross(run.x, run.v), axis=1)
    np.testing.assert_allclose(
        momentum - momentum[0], 0, atol=1e-13 * np.abs(m * run.v).sum(1).max()
    )
    np.testing.assert_allclose(spin - spin[0], 0, atol=1e-12 * np.linalg.norm(spin[0]))


def test_runs_can_be_taken_backwards(orbit, simulate):
    # Verlet's scheme is reversible: with velocities turned round it goes back to the start.
    scene = orbit(duration=1.0, save_interval=0.01, dt=0.01, integrator="verlet")
    there = simulate(scene)
    geometry = replace(scene.geometry, positions=there.x[-1], velocities=-there.v[-1])
    back = simulate(replace(scene, geometry=geometry))
    np.testing.assert_allclose(back.x[-1], there.x[0], atol=1e-12)


# --- multiple time steps ----------------------------------------------------------------------


def folded(body, **settings):
    """Two stiff panels on a soft, lightly damped fold."""
    positions = [0 * X, X, [0.5, -0.8, 0.2], [0.5, 0.8, 0.3]]
    pairs = [(0, 1), (0, 2), (1, 2), (0, 3), (1, 3)]
    bars = [
        (i, j, 1e5, np.linalg.norm(np.subtract(positions[i], positions[j])), 0.5) for i, j in pairs
    ]
    hinge = (0, 1, 2, 3, 0.5, np.pi + 0.5, 0.0)
    return body(positions, [0.1] * 4, bars=bars, hinges=[hinge], **settings)


def test_a_step_of_the_hinges_is_enough_where_bars_are_stiff(body, simulate):
    scene = folded(body, duration=1.0, save_interval=0.1)
    exact = simulate(replace(scene, dt=5e-5)).x
    assembly = assemble([scene])
    h = 0.01 / assembly.scaler.time
    # Verlet's scheme alone would be stable for steps of 1.4 ms.
    assert inner_steps(assembly.body, h) > 8
    outer = simulate(replace(scene, dt=0.01, integrator="respa"))
    motion = np.abs(exact[-1] - exact[0]).max()
    assert np.abs(outer.x - exact).max() < 0.02 * motion


@pytest.mark.parametrize("damping", [0.0, 0.5])
def test_the_bound_that_sets_the_inner_steps_is_on_the_safe_side(lattice, damping):
    scene = lattice(3, damping=damping)
    geometry, bars = scene.geometry, scene.geometry.bars
    free = np.flatnonzero(~geometry.fixed)
    matrices = np.zeros((2, 9, 3, 9, 3))
    for (i, j), k, c in zip(bars.indices, bars.stiffness, bars.damping, strict=True):
        unit = geometry.positions[j] - geometry.positions[i]
        unit = unit / np.linalg.norm(unit)
        for a, b, sign in ((i, i, 1), (j, j, 1), (i, j, -1), (j, i, -1)):
            matrices[0, a, :, b] += sign * k * np.outer(unit, unit)
            matrices[1, a, :, b] += sign * c * np.outer(unit, unit)
    matrices = matrices[:, free][:, :, :, free] / geometry.masses[free][:, None, None, None]
    squares, rates = (np.linalg.eigvals(m.reshape(3 * len(free), -1)).real.max() for m in matrices)
    omega, zeta = np.sqrt(squares), rates / (2 * np.sqrt(squares))
    limit = 2 * (np.sqrt(1 + 4 * zeta**2) - 2 * zeta) / omega
    assembly = assemble([scene])
    inner = inner_steps(assembly.body, 100.0)
    step = 100.0 / inner * assembly.scaler.time
    assert 0.3 * limit < step < 0.8 * limit


def test_the_number_of_inner_steps_can_be_given(body):
    assembly = assemble([folded(body)])
    settings = Settings(h=0.1, frame_time=1.0)
    assert RESPA.for_body(assembly.body, settings, inner=7).inner == 7
    with pytest.raises(ConfigError, match="0 inner steps"):
        RESPA.for_body(assembly.body, settings, inner=0)


def test_bodies_without_bars_take_no_inner_steps(body):
    scene = body([0 * X], [1.0])
    assert inner_steps(assemble([scene]).body, 1.0) == 1
