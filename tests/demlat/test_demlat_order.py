"""Order of convergence, measured, of every integrator."""

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from openprc.demlat import BarHingeModel
from openprc.demlat.integrators import INTEGRATORS
from openprc.demlat.signal_table import sample_signal
from openprc.schema.experiment import Actuator, Signal

X, Y, Z = np.eye(3)


def slope(errors):
    """Mean order over successive halvings of the step."""
    return np.mean(np.log2(np.array(errors[:-1]) / np.array(errors[1:])))


def test_fourth_order_on_an_oscillator_with_closed_form(body, simulate):
    k, m, a = 100.0, 1.0, 0.1
    scene = body(
        [0 * X, (1 + a) * X],
        [m, m],
        bars=[(0, 1, k, 1.0, 0)],
        fixed=[True, False],
        save_interval=0.5,
        duration=2.0,
        dt=0.05,
    )
    errors = []
    for dt in 0.05 / 2 ** np.arange(5):
        run = simulate(replace(scene, dt=dt))
        errors.append(np.abs(run.x[:, 1, 0] - 1 - a * np.cos(10 * run.t)).max())
    assert errors[-1] < 1e-6 * a
    assert slope(errors) == pytest.approx(4.05, abs=0.25)


def richardson(simulate, scene, steps):
    runs = [simulate(replace(scene, dt=dt)).x for dt in steps]
    return [np.abs(a - b).max() for a, b in pairwise(runs)]


def test_fourth_order_on_a_nonlinear_damped_lattice(lattice, simulate):
    scene = lattice(3, damping=0.02)
    scene = replace(scene, save_interval=0.1, duration=0.3, damping=0.01, gravity=(0, 0, -9.81))
    errors = richardson(simulate, scene, 0.1 / (64 * 2 ** np.arange(5)))
    assert errors[-1] < errors[0] / 2000
    assert slope(errors) == pytest.approx(4.05, abs=0.25)


@pytest.mark.parametrize("interpolation", ["hold", "linear", "cubic"])
@pytest.mark.parametrize("kind", ["force", "position"])
def test_driven_lattices_keep_the_order(lattice, simulate, drive, kind, interpolation):
    # Jumps and kinks of the signals fall on edges of steps and must not cost the order.
    scene = lattice(3, damping=0.02, velocities=np.zeros((9, 3)))
    rng = np.random.default_rng(1)
    values = rng.uniform(-1, 1, (13, 3))
    if kind == "position":
        values = scene.geometry.positions[8] + 0.01 * values
    signal, actuator = drive(values, dt=0.025, node=8, type=kind, interpolation=interpolation)
    scene = replace(
        scene, signals={"u": signal}, actuators=(actuator,), save_interval=0.1, duration=0.3
    )
    errors = richardson(simulate, scene, 0.1 / (256 * 2 ** np.arange(4)))
    assert slope(errors) == pytest.approx(4.05, abs=0.25)


def test_fourth_order_with_hinges(body, simulate):
    h = 0.8
    positions = [0 * X, X, [0.5, -h, 0.2], [0.5, h, 0.3]]
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
    )
    errors = richardson(simulate, scene, 0.25 / (16 * 2 ** np.arange(5)))
    assert slope(errors) == pytest.approx(4.05, abs=0.25)


def test_the_energy_balance_closes_with_the_same_order(lattice, simulate, drive):
    scene = lattice(3, damping=0.02)
    target = scene.geometry.positions[8] + 0.02 * np.random.default_rng(3).uniform(-1, 1, (13, 3))
    moved, mover = drive(target, dt=0.025, node=8, type="position", interpolation="cubic")
    pushed, pusher = drive([1.0, -2.0, 3.0], dt=0.1, node=7, interpolation="hold", name="push")
    scene = replace(
        scene,
        signals={"u": moved, "push": pushed},
        actuators=(mover, pusher),
        save_interval=0.1,
        duration=0.3,
        damping=0.01,
        gravity=(0.0, 0.0, -9.81),
    )
    errors = []
    for dt in 0.1 / (128 * 2 ** np.arange(4)):
        run = simulate(replace(scene, dt=dt))
        errors.append(np.abs(run.balance).max() / np.ptp(run.work_in))
    assert errors[-1] < 1e-8
    assert slope(errors) > 3.7


# --- every integrator ----------------------------------------------------------------------------

#: Step of the first rung [s]; the old stepping is of first order and grows besides, and errors
#: of pefrl soon are those of rounding.
FIRST_STEPS = dict.fromkeys(INTEGRATORS, 0.0125) | {"legacy": 0.0125 / 16, "pefrl": 0.025}
#: Steps that schemes which choose their own are held to; frames are 0.2 s apart then.
FORCED_STEPS = {"rk45": (0.05, 0.025, 0.0125, 0.00625), "dop853": (0.2, 0.1, 0.05)}
WITHIN = 0.2


def measured_order(scene, name, exact):
    """Slope of the largest error at the frames over the step, by least squares."""
    scene = replace(scene, integrator=name, step_check="warn")
    if name in FORCED_STEPS:
        share = 2.0 if scene.actuators else 1.0  # no step goes past a knot of the drive
        rungs = [held_to(scene, step / share) for step in FORCED_STEPS[name]]
    else:
        rungs = [replace(scene, dt=FIRST_STEPS[name] / 2**halvings) for halvings in range(4)]
    steps, errors = [], []
    for rung in rungs:
        model = BarHingeModel(rung)
        x = np.concatenate([block.x[:, -1].copy() for _, block in model.blocks()])
        fixed = rung.steps_per_frame * (rung.n_frames - 1)
        steps.append(rung.duration / model.effort.get("steps", fixed))
        errors.append(np.abs(x - exact[:: round(rung.save_interval / 0.1)]).max())
    assert min(errors) > 1e-13  # or rounding would be measured
    return np.polyfit(np.log(steps), np.log(errors), 1)[0]


def held_to(scene, step):
    """Return the scene with a force of nothing, past whose knots no step goes."""
    beat = Signal(name="beat", values=np.zeros(round(scene.duration / step) + 1), dt=step)
    nothing = Actuator(node=1, signal="beat", type="force")
    return replace(
        scene, signals={**scene.signals, "beat": beat}, actuators=(*scene.actuators, nothing),
        dt=0.2, save_interval=0.2, tolerance=0.1,
    )  # fmt: skip


def pendulum_or_spring(body, name, *, damped):
    """Return a scene of one moving node, and its positions at the frames (T, 3) [m].

    Schemes for constraints have a rigid pendulum, whose angle SciPy knows to twelve digits.
    """
    times = {"save_interval": 0.1, "duration": 2.0, "dt": 0.1}
    t = 0.1 * np.arange(21)
    exact = np.zeros((21, 3))
    if INTEGRATORS[name].rigid == "no":
        rate = 1.0 if damped else 0.0
        bar = (0, 1, 100.0, 1.0, 2.0 * rate)
        scene = body([0 * X, 1.1 * X], [1.0, 1.0], bars=[bar], fixed=[True, False], **times)
        omega = math.sqrt(100.0 - rate**2)
        swing = np.cos(omega * t) + rate / omega * np.sin(omega * t)
        exact[:, 0] = 1.0 + 0.1 * np.exp(-rate * t) * swing
        return scene, exact
    drag = 0.4 if damped else 0.0
    start = [math.sin(1.0), -math.cos(1.0), 0.0]
    scene = body([0 * X, start], [1.0, 1.0], bars=[(0, 1, 1.0, 1.0, 0.0)], fixed=[True, False],
                 gravity=(0.0, -9.81, 0.0), damping=drag, **times)  # fmt: skip
    bars = replace(scene.geometry.bars, rigid=[True])
    scene = replace(scene, geometry=replace(scene.geometry, bars=bars))

    def swinging(_, y):
        return [y[1], -9.81 * math.sin(y[0]) - drag * y[1]]

    angle = solve_ivp(
        swinging, (0.0, 2.0), [1.0, 0.0], method="DOP853", t_eval=t, rtol=1e-13, atol=1e-14
    ).y[0]
    exact[:, 0], exact[:, 1] = np.sin(angle), -np.cos(angle)
    return scene, exact


@pytest.mark.parametrize("damped", [False, True], ids=["undamped", "damped"])
@pytest.mark.parametrize("name", INTEGRATORS)
def test_every_integrator_has_its_declared_order(body, name, damped):
    scene, exact = pendulum_or_spring(body, name, damped=damped)
    assert measured_order(scene, name, exact) == pytest.approx(INTEGRATORS[name].order, abs=WITHIN)


SOFT = [n for n, scheme in INTEGRATORS.items() if scheme.rigid == "no" and scheme.step != "legacy"]


@pytest.mark.parametrize("name", SOFT)
def test_every_integrator_keeps_its_order_behind_a_cubic_signal(body, drive, name):
    # Those for rigid bars are measured on a shaken sheet, in test_demlat_rigid_motion.
    t = 0.1 * np.arange(21)
    values = np.zeros((21, 3))
    values[:, 0] = 0.05 * np.sin(3.0 * t) ** 2
    signal, actuator = drive(values, dt=0.1, node=0, type="position", interpolation="cubic")
    scene = body([0 * X, 1.1 * X], [1.0, 1.0], bars=[(0, 1, 100.0, 1.0, 0.0)], damping=1.0,
                 save_interval=0.1, duration=2.0, dt=0.1, signals=(signal,),
                 actuators=(actuator,))  # fmt: skip

    def pulled(now, y):
        wall = sample_signal(signal, np.array([now]))[0, 0]
        return [y[1], -100.0 * (y[0] - wall - 1.0) - y[1]]

    exact = np.zeros((21, 3))
    exact[0, 0], state = 1.1, [1.1, 0.0]
    for frame in range(20):  # from knot to knot, between which the spline is smooth
        state = solve_ivp(
            pulled, t[frame : frame + 2], state, method="DOP853", rtol=1e-13, atol=1e-15
        ).y[:, -1]
        exact[frame + 1, 0] = state[0]
    assert measured_order(scene, name, exact) == pytest.approx(INTEGRATORS[name].order, abs=WITHIN)
