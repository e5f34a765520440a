"""Runs with PyElastica against closed forms and figures that were measured without this code.

PyElastica compiles its kernels when it is first used, which takes half a minute: all of this is
slow. The figures of "PyElastica alone" were taken with version 1.0.0 and scripts of its own API.
"""

from __future__ import annotations

import importlib.util
import math
from dataclasses import replace

import numpy as np
import pytest
from openprc_pyelastica.samples import driven_chain

from openprc.demlat.producer import DemlatProducer
from openprc.hooks.running import simulate
from openprc.schema import Provenance, Trajectory
from openprc.schema.experiment import Actuator, Signal

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(importlib.util.find_spec("elastica") is None, reason="needs pyelastica"),
    pytest.mark.filterwarnings("default"),  # the simulator's own warnings are not ours
]

C = math.sqrt(1e6 / 1000.0)  # speed of stretching waves in the default chain [m/s]
GRAVITY = 9.81


def constant_force(value, *, node, axis):
    axes = tuple(index == axis for index in range(3))
    return {
        "signals": {"F": Signal(name="F", values=np.array([value]), dt=1.0)},
        "actuators": (Actuator(node=node, signal="F", type="force", axes=axes),),
    }


def fitting_step(interval, longest):
    return interval / math.ceil(interval / longest)


def frequency(time, signal):
    """Return the mean frequency [Hz] between the first and the last rising zero of a sine."""
    rises = np.flatnonzero((signal[:-1] < 0.0) & (signal[1:] >= 0.0))
    share = signal[rises] / (signal[rises] - signal[rises + 1])
    zeros = time[rises] + share * (time[rises + 1] - time[rises])
    return (len(zeros) - 1) / (zeros[-1] - zeros[0])


# --- the cantilever -------------------------------------------------------------------------------

PLANE_SHEAR = 0.005 / (27 / 28 * 1e6 / 3 * math.pi * 0.02**2)  # F L / (a G A) [m]


@pytest.mark.parametrize(
    ("n", "step", "alone", "without_shear"),
    [
        (5, 5e-4, 0.00956053, 0.00954815),
        (10, 0.03 / C, 0.01135049, 0.01133811),
        (20, 0.015 / C, 0.01229514, 0.01228276),
    ],
)
def test_cantilever(make_chain, make_experiment, run_rods, n, step, alone, without_shear):
    geometry = make_chain(n, fixed=(0, 1))
    experiment = make_experiment(
        geometry,
        duration=40.0,
        dt=fitting_step(0.5, step),
        save_interval=0.5,
        damping=2.0 * geometry.masses.mean(),
        **constant_force(-0.005, node=n, axis=1),
    )
    run = run_rods(experiment)
    tip = -run.positions()[-1, -1, 1]
    assert tip == pytest.approx(alone, rel=1e-5)
    assert tip - PLANE_SHEAR == pytest.approx(without_shear, rel=1e-5)
    # F L^3 / 3EI (1 - 3/2n + 1/2n^2): bends of l/EI, the first of them at node 1.
    stiffness = 1e6 * math.pi * 0.02**4 / 4
    formula = 0.005 / (3 * stiffness) * (1 - 1.5 / n + 0.5 / n**2)
    assert tip - PLANE_SHEAR == pytest.approx(formula, rel=2e-4)
    # Every element of the clamped rod shears, also the one whose director is held.
    assert -run.positions()[-1, 1, 1] == pytest.approx(PLANE_SHEAR / n, rel=1e-3)
    assert run.node("fixed").tolist() == [1, 1] + [0] * (n - 1)  # of the experiment
    moment = -run.element("bends", "torque")[-1]
    np.testing.assert_allclose(moment, 0.005 * (1.0 - np.arange(1, n) / n), rtol=2e-3)


def test_two_held_nodes_keep_their_place(make_chain, make_experiment, run_rods):
    n, geometry = 10, make_chain(10, fixed=(0, 1))
    held = geometry.positions[:2, :2]
    experiment = make_experiment(
        geometry,
        duration=40.0,
        dt=fitting_step(0.5, 0.03 / C),
        save_interval=0.5,
        damping=2.0 * geometry.masses.mean(),
        **constant_force(-0.005, node=n, axis=1),
    )
    run = run_rods(experiment, clamp="nodes", shear_scale=1.0)
    np.testing.assert_array_equal(run.positions()[:, :2], np.tile(held, (run.n_frames, 1, 1)))
    tip = -run.positions()[-1, -1, 1]
    assert tip - PLANE_SHEAR * (1 - 1 / n) == pytest.approx(0.01133811, rel=1e-5)


@pytest.mark.parametrize(("n", "alone"), [(10, 0.195550), (20, 0.185880)])
def test_first_bending_frequency(make_chain, make_experiment, run_rods, rod_modes, n, alone):
    """Linear theory to 1e-5; chains without shear and rotary inertia are 1e-3 faster."""
    area, element = math.pi * 0.02**2, 1.0 / n
    masses = make_chain(n).masses
    frequencies, shapes = rod_modes(
        shear=27 / 28 * 1e6 / 3 * area,
        bend=1e6 * area * 0.02**2 / 4,
        mass=masses,
        inertia=1000 * area * 0.02**2 / 4 * element,
        length=element,
        held=[0],
        turned=[0],
    )
    velocities = np.zeros((n + 1, 3))
    velocities[:, 1] = 1e-3 * shapes[:, 0] / np.abs(shapes[:, 0]).max()
    experiment = make_experiment(
        make_chain(n, fixed=(0, 1), velocities=velocities),
        duration=26.0,
        dt=fitting_step(0.02, 0.3 * element / C),
        save_interval=0.02,
    )
    run = run_rods(experiment)
    measured = frequency(run.time, run.positions()[:, :, 1] @ (masses * velocities[:, 1]))
    assert measured == pytest.approx(frequencies[0], rel=2e-5)
    assert measured == pytest.approx(alone, rel=3e-4)
    assert measured == pytest.approx({10: 0.195729, 20: 0.186072}[n], rel=1.5e-3)


@pytest.mark.parametrize("n", [10, 20])
def test_axial_frequency(make_chain, make_experiment, run_rods, n):
    """2 c/l sin(pi/4n) / 2 pi of masses and springs, half a mass at the free end."""
    shape = np.sin(0.5 * np.pi * np.linspace(0.0, 1.0, n + 1))
    velocities = np.zeros((n + 1, 3))
    velocities[:, 0] = 1e-5 * shape
    geometry = make_chain(n, fixed=(0,), velocities=velocities)
    experiment = make_experiment(geometry, duration=1.5, dt=1e-4, save_interval=1e-3)
    run = run_rods(experiment)
    motion = (run.positions()[:, :, 0] - geometry.positions[:, 0]) @ (geometry.masses * shape)
    exact = 2.0 * C * n * math.sin(math.pi / (4 * n)) / (2.0 * math.pi)
    assert exact == pytest.approx({10: 7.897569, 20: 7.903662}[n], rel=1e-6)
    assert frequency(run.time, motion) == pytest.approx(exact, rel=1e-5)


# --- hanging --------------------------------------------------------------------------------------


def hanging(positions, masses, tension_stiffness):
    """Return the positions of a vertical chain that hangs at rest from node 0, stretched."""
    element = np.abs(np.diff(positions[:, 2]))
    below = GRAVITY * (masses.sum() - np.cumsum(masses)[:-1])
    stretched = element / (1.0 - below / tension_stiffness)
    hung = positions.copy()
    hung[1:, 2] = -np.cumsum(stretched)
    return hung


def test_a_rod_that_swings_from_a_pin(make_chain, make_experiment, run_rods, rod_modes):
    """Linear theory to 2e-5; PyElastica alone and the hanging chain 2.404826/2 sqrt(g/L) / 2 pi."""
    n, radius, modulus = 20, 0.005, 5e6
    area = math.pi * radius**2
    plain = make_chain(n, radius=radius, modulus=modulus, along="-z")
    hung = hanging(plain.positions, plain.masses, modulus * area)
    tension = GRAVITY * (plain.masses.sum() - np.cumsum(plain.masses)[:-1])
    frequencies, shapes = rod_modes(
        shear=27 / 28 * modulus / 3 * area,
        bend=modulus * area * radius**2 / 4,
        mass=plain.masses,
        inertia=1000 * area * radius**2 / 4 / n,
        length=1.0 / n,
        held=[0],
        tension=tension,
        stretch=1.0 / (1.0 - tension / (modulus * area)),
    )
    shape = shapes[:, 0] / np.abs(shapes[:, 0]).max()
    hung[:, 0] = 1e-4 * shape
    geometry = make_chain(n, radius=radius, modulus=modulus, along="-z", fixed=(0,), positions=hung)
    experiment = make_experiment(
        geometry, duration=9.0, dt=1e-4, save_interval=0.01, gravity=(0.0, 0.0, -GRAVITY)
    )
    run = run_rods(experiment)
    measured = frequency(run.time, run.positions()[:, :, 0] @ (geometry.masses * shape))
    assert measured == pytest.approx(frequencies[0], rel=2e-5)
    assert measured == pytest.approx(0.599621, rel=3e-4)
    assert measured == pytest.approx(0.599388, rel=1e-3)


def point_masses(make_chain, along, **given):
    """Return five point masses of 0.1 kg on stiff bars of 0.2 m that hang from node 0."""
    geometry = make_chain(5, along=along, fixed=(0,), bend=None, masses=np.full(6, 0.1), **given)
    bars = geometry.bars
    stiff = type(bars)(
        indices=bars.indices, stiffness=np.full(5, 1e5), rest_length=bars.rest_length
    )
    return type(geometry)(
        positions=geometry.positions,
        masses=geometry.masses,
        fixed=geometry.fixed,
        bars=stiff,
        velocities=geometry.velocities,
    )


def test_a_chain_without_bends_swings(make_chain, make_experiment, run_rods):
    """f = sqrt(g x / l) / 2 pi with the least zero x of the Laguerre polynomial L_5."""
    zero = np.polynomial.laguerre.lagroots([0, 0, 0, 0, 0, 1]).min()
    exact = math.sqrt(GRAVITY * zero / 0.2) / (2.0 * math.pi)
    assert exact == pytest.approx(0.572242, rel=1e-6)
    masses = np.full(6, 0.1)
    hung = hanging(np.outer(np.arange(6.0), [0, 0, -0.2]), masses, 1e5 * 0.2)
    # L_5 mode: laguerre polynomial of each order at the zero, from the free end upwards.
    shape = np.array([np.polynomial.laguerre.lagval(zero, [0] * k + [1]) for k in range(6)])[::-1]
    hung[1:, 0] = 1e-3 * shape[1:]
    experiment = make_experiment(
        point_masses(make_chain, "-z", positions=hung),
        duration=9.0,
        dt=1e-4,
        save_interval=0.01,
        gravity=(0.0, 0.0, -GRAVITY),
    )
    run = run_rods(experiment, radius=0.01, substeps="auto")
    motion = run.positions()[:, :, 0] @ (masses * shape)
    # Elements have rotary inertia m R^2 / 4, some 6e-4 of m l^2.
    assert frequency(run.time, motion) == pytest.approx(exact, rel=3e-4)


def test_a_large_swing(make_chain, make_experiment, run_rods):
    """Five links released from the horizontal; DOP853 at 1e-12 for inextensible links."""
    experiment = make_experiment(
        point_masses(make_chain, "x"),
        duration=0.5,
        dt=1e-4,
        save_interval=0.25,
        gravity=(0.0, 0.0, -GRAVITY),
    )
    run = run_rods(experiment, radius=0.004, substeps="auto")
    tips = run.positions()[1:, -1][:, [0, 2]]
    np.testing.assert_allclose(
        tips, [[0.89026677, -0.30656040], [-0.05666454, -0.97580233]], atol=5e-3
    )
    np.testing.assert_allclose(tips[0], [0.89026677, -0.30656040], atol=1e-3)
    assert np.abs(run.element("bars", "strain")).max() < 2e-3


@pytest.mark.parametrize(("section", "exact"), [("thinning", 0.053663), ("constant", 0.050930)])
def test_axial_stretching(make_chain, make_experiment, run_rods, section, exact):
    """F L / (EA - F) of a rod of constant volume (PyElastica alone: 0.053660), F L / EA of bars."""
    n, radius, modulus = 19, 0.025, 1e4
    area = math.pi * radius**2
    assert exact == pytest.approx(1.0 / (modulus * area - (section == "thinning")), rel=1e-5)
    geometry = make_chain(n, radius=radius, modulus=modulus, fixed=(0,))
    experiment = make_experiment(
        geometry,
        duration=40.0,
        dt=1e-3,
        save_interval=1.0,
        damping=2.0 * geometry.masses.mean(),
        **constant_force(1.0, node=n, axis=0),
    )
    run = run_rods(experiment, section=section, substeps="auto")
    assert run.positions()[-1, -1, 0] - 1.0 == pytest.approx(exact, rel=1e-4)
    np.testing.assert_allclose(run.element("bars", "force")[-1], 1.0, rtol=1e-6)


def test_it_moves_as_bars_and_bends_do(make_experiment, run_rods, tmp_path):
    """Against the native engine, with what it has not made small: strain, shear, inertia."""
    plain = driven_chain(n_symbols=6)
    bars = plain.geometry.bars
    stiff = replace(plain.geometry, bars=replace(bars, stiffness=400.0 * bars.stiffness))
    experiment = replace(plain, geometry=stiff, dt=2.5e-5)
    path = tmp_path / "bars.h5"
    simulate(
        experiment,
        DemlatProducer(),
        target=path,
        provenance=Provenance("demlat"),
        owner="openprc/demlat",
    )
    rod = run_rods(experiment, clamp="nodes", section="constant", radius=0.002, substeps="auto")
    with Trajectory(path) as native:
        reach = np.ptp(native.positions()[:, -1, 0])
        assert np.abs(rod.positions() - native.positions()).max() < 2e-3 * reach
        angle = native.element("bends", "angle")
        assert np.abs(rod.element("bends", "angle") - angle).max() < 3e-3
        np.testing.assert_array_equal(rod.input("push").value, native.input("push").value)
        np.testing.assert_array_equal(rod.time, native.time)
        assert rod.node("fixed").tolist() == native.node("fixed").tolist()


# --- motion that is closed form -------------------------------------------------------------------


def test_free_fall_with_damping(make_chain, make_experiment, run_rods):
    geometry = make_chain(4, velocities=np.tile([0.3, 0.0, 0.1], (5, 1)))
    rate = 2.0
    experiment = make_experiment(
        geometry,
        duration=1.0,
        dt=5e-4,
        save_interval=0.1,
        gravity=(0.0, 0.0, -GRAVITY),
        damping=rate * geometry.masses.mean(),
    )
    run = run_rods(experiment)
    assert run.n_frames == 11
    np.testing.assert_array_equal(run.time, 0.1 * np.arange(11))
    t = run.time[:, np.newaxis]
    decay = (1.0 - np.exp(-rate * t)) / rate
    # Kicks and damping take turns, which is of first order: g dt / 2 in the final speed.
    np.testing.assert_allclose(
        run.positions()[:, :, 0] - geometry.positions[:, 0], 0.3 * decay * np.ones(5), atol=2e-4
    )
    falling = 0.1 * decay - GRAVITY / rate * (t - decay)
    np.testing.assert_allclose(run.positions()[:, :, 2], falling * np.ones(5), atol=3e-3)


def test_momentum_is_the_impulse(make_chain, make_experiment, run_rods):
    geometry = make_chain(6, velocities=np.zeros((7, 3)))
    hold = {"dt": 0.02, "interpolation": "hold"}
    values = np.array([[1.0, 2.0, 3.0], [-1.0, 0.5, 0.0], [0.0, 0.0, 0.0]]) * 1e-2
    experiment = make_experiment(
        geometry,
        signals={"F": Signal(name="F", values=values, **hold)},
        actuators=(
            Actuator(node=2, signal="F", type="force"),
            Actuator(node=5, signal="F", type="force", axes=(True, False, False)),
        ),
        duration=0.05,
        dt=1e-3,
        save_interval=0.01,
    )
    run = run_rods(experiment)
    momentum = np.einsum("n,tnx->tx", geometry.masses, run.velocities())
    impulse = np.array([0, 1, 2, 2, 2, 2])[:, None] * values[0] * 0.01
    impulse += np.array([0, 0, 0, 1, 2, 2])[:, None] * values[1] * 0.01
    np.testing.assert_allclose(momentum, impulse * [2, 1, 1], atol=1e-15)
    # The recorded input is the commanded one, with the new value from its own time on.
    np.testing.assert_array_equal(run.input("F").value, values[[0, 0, 1, 1, 2, 2]])
    np.testing.assert_array_equal(run.input("F").sequence, values)


def test_a_rod_turns_about_its_middle(make_chain, make_experiment, run_rods):
    """Elements turn with the line of their nodes from the first step on, without shear."""
    velocities = np.zeros((11, 3))
    velocities[:, 1] = 0.2 * np.linspace(-1.0, 1.0, 11)
    experiment = make_experiment(
        make_chain(10, velocities=velocities), duration=2.0, dt=5e-4, save_interval=0.1
    )
    run = run_rods(experiment)
    ends = run.positions()[:, -1, :2] - run.positions()[:, 0, :2]
    angle = np.unwrap(np.arctan2(ends[:, 1], ends[:, 0]))
    np.testing.assert_allclose(angle, 0.4 * run.time, atol=2e-4)
    assert np.abs(run.element("bends", "angle") - np.pi).max() < 1e-5


def test_prescribed_motion(make_chain, make_experiment, run_rods):
    t = np.linspace(0.0, 1.0, 101)
    shake = Signal(name="shake", values=0.01 * np.sin(7.0 * t), dt=0.01, interpolation="cubic")
    pull = Signal(name="pull", values=np.array([0.05]), dt=1.0)
    experiment = make_experiment(
        make_chain(8, along="x"),
        signals={"shake": shake, "pull": pull},
        actuators=(
            Actuator(node=0, signal="shake", type="position", axes=(False, True, False)),
            Actuator(node=8, signal="pull", type="velocity", axes=(True, False, False)),
        ),
        duration=0.5,
        dt=5e-4,
        save_interval=0.01,
    )
    run = run_rods(experiment)
    positions, velocities = run.positions(), run.velocities()
    np.testing.assert_allclose(positions[:, 0, 1], 0.01 * np.sin(7.0 * run.time), atol=1e-9)
    np.testing.assert_allclose(velocities[:, 0, 1], 0.07 * np.cos(7.0 * run.time), atol=1e-6)
    np.testing.assert_allclose(positions[:, 8, 0], 1.0 + 0.05 * run.time, rtol=1e-12)
    np.testing.assert_allclose(velocities[:, 8, 0], 0.05, rtol=1e-12)
    assert np.ptp(positions[:, 8, 1]) > 0.0  # axes that are not driven are free
    assert run.input("shake").quantity == "position"
    assert run.input("pull").quantity == "velocity"


def test_order_of_convergence(make_chain, make_experiment, run_rods):
    ends = []
    geometry = make_chain(4, fixed=(0, 1), velocities=np.outer(np.arange(5.0) ** 2, [0, 0.03, 0]))
    for steps in (20, 40, 80):
        experiment = make_experiment(
            geometry, duration=0.2, dt=0.02 / steps, save_interval=0.02, damping=0.0
        )
        ends.append(run_rods(experiment).positions()[-1])
    errors = [np.abs(ends[i + 1] - ends[i]).max() for i in range(2)]
    assert 1.8 < math.log2(errors[0] / errors[1]) < 2.2
