"""Motions with a formula: oscillators, damped oscillators, pendulums, hanging chains."""

import numpy as np
import pytest

from openprc.schema import Experiment
from openprc.schema.experiment import Actuator, Signal
from openprc.schema.geometry import Bars, Bends, Geometry

pytest.importorskip("pybullet")

GRAVITY = 9.81
#: Pairs of a fixed node and a mass stand so far apart [m].
APART = 3.0


def oscillators(frequencies, *, amplitude, damping=0.0, **times):
    """One-dimensional oscillators of 1 kg side by side, at rest beside their rest lengths."""
    n = len(frequencies)
    anchors = np.array([[0.0, APART * row, 0.0] for row in range(n)])
    positions = np.concatenate([anchors, anchors + np.array([1.0 + amplitude, 0, 0])])
    bars = Bars(
        indices=[[row, row + n] for row in range(n)],
        stiffness=(2.0 * np.pi * np.asarray(frequencies)) ** 2,
        rest_length=np.ones(n),
        damping=np.full(n, damping),
    )
    body = Geometry(
        positions=positions, masses=np.ones(2 * n), fixed=np.arange(2 * n) < n, bars=bars
    )
    return Experiment(geometry=body, integrator="verlet", **times)


def period_of(samples, spacing):
    """Return the period of evenly spaced samples of a sinusoid: (T,) or (T, C).

    ``x[n + 1] + x[n - 1] = 2 cos(w h) x[n]`` whatever amplitude and phase are; by least squares.
    """
    middle, outer = samples[1:-1], samples[2:] + samples[:-2]
    cosine = (middle * outer).sum(axis=0) / (2.0 * (middle**2).sum(axis=0))
    return 2.0 * np.pi * spacing / np.arccos(cosine)


# --- the oscillator -------------------------------------------------------


@pytest.mark.parametrize("start", ["half-kick", "plain"])
@pytest.mark.parametrize("h", [1 / 240, 1e-3])
def test_the_period_is_that_of_the_scheme(pb_run, start, h):
    """T / T0 = (w h / 2) / asin(w h / 2), for frequencies up to the stability limit."""
    frequencies = np.array([1.0, 10.0, 20.0, 40.0, 70.0])
    scene = oscillators(frequencies, amplitude=0.1, duration=1200 * h, dt=h, save_interval=h)
    run = pb_run(scene, start=start)
    stretch = run.positions()[:, 5:, 0] - 1.0
    shift = period_of(stretch, h) * frequencies - 1.0
    half = np.pi * frequencies * h
    theory = half / np.arcsin(half) - 1.0
    np.testing.assert_allclose(shift, theory, rtol=1e-6, atol=1e-10)
    # As measured with a script of the same steps, without this package.
    known = {1 / 240: -2.856e-5, 1e-3: -1.645e-6}[h]
    assert shift[0] == pytest.approx(known, rel=1e-3)


def test_a_half_kick_starts_at_the_turning_point(pb_run):
    """x_n = x_0 cos(n theta) to rounding over 100 periods; plain is half a step late."""
    h, n_steps = 1 / 240, 24_000
    scene = oscillators([1.0], amplitude=0.1, duration=n_steps * h, dt=h, save_interval=10 * h)
    angle = 2.0 * np.arcsin(np.pi * h)
    steps = 10 * np.arange(n_steps // 10 + 1)
    kicked = pb_run(scene)
    np.testing.assert_allclose(
        kicked.positions()[:, 1, 0] - 1.0, 0.1 * np.cos(steps * angle), atol=1e-11
    )
    # The stored velocity is that at the frame: the mean of those half a step before and after.
    swing = -0.1 * np.sin(steps * angle) * np.sin(angle) / h
    np.testing.assert_allclose(kicked.velocities()[:, 1, 0], swing, atol=1e-10)
    plain = pb_run(scene, start="plain").positions()[:, 1, 0] - 1.0
    late = 0.1 * np.cos((steps + 0.5) * angle) / np.cos(0.5 * angle)
    np.testing.assert_allclose(plain, late, atol=1e-11)


def damped(t, *, omega, rate):
    """Position of a mass let go at 1 from rest, underdamped: y'' + 2 rate y' + omega^2 y = 0."""
    fast = np.sqrt(omega**2 - rate**2)
    return np.exp(-rate * t) * (np.cos(fast * t) + rate / fast * np.sin(fast * t))


@pytest.mark.parametrize(("start", "order"), [("half-kick", 2), ("plain", 1)])
def test_order_with_damping(pb_run, start, order):
    """The velocity that a dashpot is given is the one of its instant, so the order stays."""
    errors = []
    for h in (0.01, 0.005, 0.0025):
        scene = oscillators(
            [1.0], amplitude=0.1, damping=1.5, duration=2.0, dt=h, save_interval=0.1
        )
        run = pb_run(scene, start=start)
        exact = 0.1 * damped(run.time, omega=2.0 * np.pi, rate=0.75)
        errors.append(np.abs(run.positions()[:, 1, 0] - 1.0 - exact).max())
    rates = np.log2(np.array(errors[:-1]) / errors[1:])
    np.testing.assert_allclose(rates, order, atol=0.05)
    assert errors[-1] < {2: 1e-5, 1: 1e-3}[order]


# --- pendulums and chains -------------------------------------------------------


@pytest.mark.parametrize(("stiffness", "measured"), [(1e4, 4.9e-4), (5e4, 9e-5)])
def test_a_pendulum_on_a_stiff_bar(pb_run, stiffness, measured):
    """A bar stretched by m g / k is longer, and so is the period; amplitude 0.1 rad."""
    h, angle = 1 / 240, 0.1
    length = 1.0 + GRAVITY * np.cos(angle) / stiffness
    bar = Bars(indices=[[0, 1]], stiffness=[stiffness], rest_length=[1.0])
    body = Geometry(
        positions=[[0, 0, 0], [length * np.sin(angle), 0, -length * np.cos(angle)]],
        masses=[1, 1],
        fixed=[1, 0],
        bars=bar,
    )
    run = pb_run(
        Experiment(
            geometry=body, gravity=(0, 0, -GRAVITY), duration=60.0, dt=h, save_interval=h,
            integrator="verlet",
        )
    )  # fmt: skip
    x, t = run.positions()[:, 1, 0], run.time
    before = np.flatnonzero(x[:-1] * x[1:] < 0)
    crossings = t[before] - x[before] * h / (x[before + 1] - x[before])
    period = 2.0 * (crossings[-1] - crossings[0]) / (len(crossings) - 1)
    # Of a rigid pendulum of length 1 m: Nelson & Olsson 1986, doi:10.1119/1.14703.
    rigid = 2.0 * np.pi / np.sqrt(GRAVITY) * (1.0 + angle**2 / 16.0 + 11.0 * angle**4 / 3072.0)
    shift = period / rigid - 1.0
    omega = np.sqrt(GRAVITY)
    # Longer by m g / k, to lowest order in the amplitude; and fast, as the scheme is.
    expected = np.sqrt(1.0 + GRAVITY / stiffness) - 1.0 - (omega * h) ** 2 / 24.0
    assert shift == pytest.approx(expected, abs=0.02 * measured)
    assert shift == pytest.approx(measured, abs=5e-6)


def hanging_chain(n, *, stiffness, amplitude, **times):
    """N equal masses on bars, 1 m long under their weight, bent to the lowest mode."""
    length, mass = 1.0 / n, 1.0 / n
    roots = np.polynomial.laguerre.lagroots([0.0] * n + [1.0])
    # y_i = L_i(x), from the recurrence of Laguerre polynomials along the chain, free end first.
    shape = np.array(
        [np.polynomial.laguerre.lagval(roots[0], [0.0] * i + [1.0]) for i in range(n, -1, -1)]
    )
    tension = mass * GRAVITY * np.arange(n, 0, -1)
    body = Geometry(
        positions=np.stack(
            [amplitude * shape, np.zeros(n + 1), -length * np.arange(n + 1.0)], axis=1
        ),
        masses=np.full(n + 1, mass),
        fixed=np.arange(n + 1) == 0,
        bars=Bars(
            indices=[[i, i + 1] for i in range(n)],
            stiffness=np.full(n, stiffness),
            rest_length=length - tension / stiffness,
        ),
    )
    scene = Experiment(geometry=body, gravity=(0, 0, -GRAVITY), integrator="verlet", **times)
    return scene, np.sqrt(GRAVITY / length * roots[0]), shape


@pytest.mark.parametrize(
    ("n", "stiffness", "h", "known"),
    [(5, 1e4, 1e-3, 0.572242), (10, 1e4, 1e-3, 0.585152), (5, 1e5, 2e-4, 0.572242)],
)
def test_a_hanging_chain_swings_at_its_laguerre_frequency(pb_run, n, stiffness, h, known):
    scene, omega, shape = hanging_chain(
        n, stiffness=stiffness, amplitude=1e-4, duration=2.0, dt=h, save_interval=0.02
    )
    assert omega / (2.0 * np.pi) == pytest.approx(known, abs=5e-7)
    run = pb_run(scene)
    swing = run.positions()[:, :, 0] @ shape
    shift = 2.0 * np.pi / period_of(swing, 0.02) / omega - 1.0
    # The scheme is fast by (w h)^2 / 24; that the bars give makes a difference of less.
    assert shift == pytest.approx((omega * h) ** 2 / 24.0, abs=5e-8)


# --- a beam of bars and bends -------------------------------------------------------

#: A rod of 1 m and radius 2 cm, of 1 MPa and 1000 kg/m3: N, N m2 and kg/m.
EA, EI, LINE = np.pi * 0.02**2 * 1e6, np.pi / 4.0 * 0.02**4 * 1e6, np.pi * 0.02**2 * 1e3


def cantilever(n, *, shape=None, push=0.0, decay=0.0, **times):
    """N segments, of which the first is clamped: bars EA / l, bends EI / l, mass at the nodes."""
    link = 1.0 / n
    masses = np.full(n + 1, LINE * link)
    masses[[0, -1]] *= 0.5
    height = np.zeros(n + 1) if shape is None else shape
    body = Geometry(
        positions=np.stack([link * np.arange(n + 1.0), np.zeros(n + 1), height], axis=1),
        masses=masses,
        fixed=np.arange(n + 1) < 2,
        bars=Bars(
            indices=[[i, i + 1] for i in range(n)],
            stiffness=np.full(n, EA / link),
            rest_length=np.full(n, link),
        ),
        bends=Bends(
            indices=[[i - 1, i, i + 1] for i in range(1, n)], stiffness=np.full(n - 1, EI / link)
        ),
    )
    return Experiment(
        geometry=body,
        signals={"tip": Signal(name="tip", values=[-push], dt=1.0, interpolation="hold")},
        actuators=(
            Actuator(node=n, signal="tip", type="force", axes=(False, False, True)),
        ),
        damping=decay * masses.mean(),
        integrator="verlet",
        **times,
    )  # fmt: skip


@pytest.mark.parametrize(("n", "measured"), [(5, 0.00954815), (10, 0.01133812)])
def test_a_cantilever_settles_where_two_other_simulators_do(pb_run, n, measured):
    """PyElastica (shear taken off) and a multibody of revolute joints give these deflections."""
    force = 0.005
    run = pb_run(cantilever(n, push=force, decay=2.5, duration=24.0, dt=2e-3, save_interval=0.5))
    tip = -run.positions()[:, n, 2]
    assert np.ptp(tip[-4:]) < 1e-9
    assert tip[-1] == pytest.approx(measured, rel=1e-5, abs=0)
    # Linear: segments that turn at nodes; the rest is that the beam shortens as it bends.
    linear = force / (3.0 * EI) * (1.0 - 1.5 / n + 0.5 / n**2)
    assert tip[-1] == pytest.approx(linear, rel=2e-4)
    assert tip[-1] < linear


def test_the_first_bending_frequency_of_a_chain(pb_run):
    """The eigenvalue of ten segments: 0.195729 Hz (a continuous beam has 0.176958 Hz)."""
    n, link = 10, 0.1
    turn = np.zeros((n - 1, n + 1))
    for row in range(n - 1):
        turn[row, row : row + 3] = np.array([1.0, -2.0, 1.0]) / link
    stiffness = (EI / link * turn.T @ turn)[2:, 2:]
    masses = np.full(n - 1, LINE * link)
    masses[-1] *= 0.5
    squares, modes = np.linalg.eigh(stiffness / np.sqrt(np.outer(masses, masses)))
    frequency = np.sqrt(squares[0]) / (2.0 * np.pi)
    assert frequency == pytest.approx(0.195729, abs=5e-7)
    mode = modes[:, 0] / np.sqrt(masses)
    shape = 1e-5 * np.concatenate([[0.0, 0.0], mode / np.abs(mode).max()])
    run = pb_run(cantilever(n, shape=shape, duration=6.0, dt=2e-3, save_interval=0.05))
    swing = run.positions()[:, 2:, 2] @ (masses * mode)
    assert 1.0 / period_of(swing, 0.05) == pytest.approx(frequency, rel=2e-6)
