"""Every law against its closed form, in the engine, element by element and in lanes."""

from dataclasses import replace

import numpy as np
import pytest

from openprc.schema.experiment import Experiment
from openprc.schema.geometry import Bars, Geometry, Hinges

K, M, L = 30.0, 0.5, 2.0


def test_every_bar_law_has_the_tension_of_its_formula(simulate):
    # A bar between a node that is held and one that moves steadily: tension over time is the
    # law itself. The masses are so large that nothing slows them.
    speed, damping = 0.8, 0.3
    geometry = Geometry(
        positions=[[2.0 * x, y, 0] for y in range(5) for x in (0, 0.75)],
        velocities=[[x * speed, 0, 0] for _ in range(5) for x in (0, 1)],
        masses=[1e12] * 10,
        fixed=[True, False] * 5,
        bars=Bars(
            indices=[[2 * y, 2 * y + 1] for y in range(5)],
            stiffness=[K] * 5,
            rest_length=[1.6] * 5,
            prestress=[0.25] * 5,
            damping=[damping] * 5,
            law=LAWS,
            stiffness_cubic=[0, 40, 0, 0, 0],
            damping_cubic=[0, 0.7, 0, 0, 0],
        ),
    )
    run = simulate(Experiment(geometry=geometry, duration=1.0, dt=0.01, save_interval=0.01))
    length = 1.5 + speed * run.t
    np.testing.assert_allclose(run.length, np.repeat(length[:, None], 5, axis=1), rtol=1e-11)
    s, e = length - 2.0, length / 2.0 - 1.0
    taut, slack = s > 0, s < 0
    expected = [
        K * s + damping * speed,
        K * s + 40 * s**3 + damping * speed + 0.7 * speed**3,
        taut * (K * s + damping * speed),
        slack * (K * s + damping * speed),
        K * 2.0 * ((1 + e) ** 4 - 1) / 4 + damping * speed,
    ]
    # At the instant where a bar is relaxed a cable may be on either side.
    sure = np.abs(s) > 1e-9
    np.testing.assert_allclose(run.tension[sure], np.array(expected).T[sure], atol=1e-9)
    elastic = [
        K * s**2 / 2,
        K * s**2 / 2 + 10 * s**4,
        taut * K * s**2 / 2,
        slack * K * s**2 / 2,
        K * 4.0 * (((1 + e) ** 5 - 1) / 5 - e) / 4,
    ]
    np.testing.assert_allclose(run.energy[:, 1], np.sum(elastic, axis=0), rtol=1e-9, atol=1e-9)


LAWS = ["linear", "cubic", "cable", "strut", "ogden"]


def one_bar(law, stretch, **more):
    """A mass on a bar; fixed nodes with bars of every law stand aside.

    So all these bodies are stepped by one compiled loop.
    """
    columns = {name: [values[0], 0, 0, 0, 0, 0] for name, values in more.items()}
    return Geometry(
        positions=[[0, 0, 0], [L + stretch, 0, 0], *([x, 9, 0] for x in range(6))],
        masses=[M] * 8,
        fixed=[True, False] + 6 * [True],
        bars=Bars(
            indices=[[0, 1], *([n, n + 1] for n in range(2, 7))],
            stiffness=[K, 0, 0, 0, 0, 0],
            rest_length=[L, 1, 1, 1, 1, 1],
            law=[law, *LAWS],
            **columns,
        ),
    )


def test_a_cubic_spring_has_the_period_of_a_duffing_oscillator(simulate):
    # m x'' + k x + k3 x^3 = 0: T = 4 K(m) / omega with the complete elliptic integral.
    from scipy.special import ellipk

    cubic, amplitude = 200.0, 0.5
    omega = np.sqrt((K + cubic * amplitude**2) / M)
    modulus = cubic * amplitude**2 / (2 * (K + cubic * amplitude**2))
    period = 4 * ellipk(modulus) / omega
    body = one_bar("cubic", amplitude, stiffness_cubic=[cubic])
    run = simulate(
        Experiment(geometry=body, duration=4 * period, dt=period / 2000, save_interval=period / 4)
    )
    x = run.x[:, 1, 0] - L
    quarter = np.tile([amplitude, 0, -amplitude, 0], 4)
    np.testing.assert_allclose(x[:16], quarter, atol=1e-8)


@pytest.mark.parametrize(("law", "sign"), [("cable", 1), ("strut", -1)])
def test_a_slack_cable_lets_fly(simulate, law, sign):
    # Half a period on the spring, then free flight at the speed of release.
    stretch = 0.2 * sign
    omega = np.sqrt(K / M)
    quarter = np.pi / 2 / omega
    run = simulate(
        Experiment(
            geometry=one_bar(law, stretch),
            duration=4 * quarter,
            dt=quarter / 500,
            save_interval=quarter,
        )
    )
    flight = -stretch * omega * quarter * np.arange(4)
    np.testing.assert_allclose(run.x[1:, 1, 0] - L, flight, atol=1e-6)
    assert np.all(run.tension[2:, 0] == 0)


def test_ogden_and_linear_bars_agree_at_small_strain_only(simulate):
    motion = {}
    for stretch in (1e-4, 0.2):
        for law in ("linear", "ogden"):
            run = simulate(
                Experiment(
                    geometry=one_bar(law, stretch), duration=1.0, dt=1e-3, save_interval=1e-2
                )
            )
            motion[stretch, law] = run.x[:, 1, 0] - L
    small = motion[1e-4, "ogden"] - motion[1e-4, "linear"]
    large = motion[0.2, "ogden"] - motion[0.2, "linear"]
    assert np.abs(small).max() < 1e-3 * 1e-4
    assert np.abs(large).max() > 0.05 * 0.2


def wing(angle, **more):
    x = [[0, 0, 0], [1, 0, 0], [0.4, np.cos(angle), np.sin(angle)], [0.4, 1, 0]]
    return Geometry(
        positions=x,
        masses=[1e12, 1e12, 1e12, 1e12],
        fixed=[True, True, False, True],
        hinges=Hinges(indices=[[0, 1, 2, 3]], **more),
    )


@pytest.mark.parametrize("degrees", [3, 20, 44.9, 45.1, 100, 180, 260, 314, 316, 340, 357])
def test_enhanced_linear_hinges_have_the_moment_of_their_formula(simulate, degrees):
    low, high, rest, k = np.pi / 4, 7 * np.pi / 4, 2.0, 0.3
    geometry = wing(
        np.radians(degrees),
        stiffness=[k],
        rest_angle=[rest],
        law=["enhanced-linear"],
        limit_low=[low],
        limit_high=[high],
    )
    run = simulate(Experiment(geometry=geometry, duration=0.0, dt=1e-3, save_interval=1e-3))
    theta = run.angle[0, 0]
    assert min(abs(theta - np.radians(a)) for a in (degrees, 360 - degrees)) < 1e-12
    if theta < low:
        scale = 2 * low / np.pi
        moment = k * (low - rest) + k * scale * np.tan((theta - low) / scale)
        energy = k * (low - rest) ** 2 / 2 + k * (low - rest) * (theta - low)
        energy -= k * scale**2 * np.log(np.cos((theta - low) / scale))
    elif theta > high:
        scale = 2 * (2 * np.pi - high) / np.pi
        moment = k * (high - rest) + k * scale * np.tan((theta - high) / scale)
        energy = k * (high - rest) ** 2 / 2 + k * (high - rest) * (theta - high)
        energy -= k * scale**2 * np.log(np.cos((theta - high) / scale))
    else:
        moment, energy = k * (theta - rest), k * (theta - rest) ** 2 / 2
    assert run.moment[0, 0] == pytest.approx(moment, rel=1e-12)
    assert run.energy[0, 2] == pytest.approx(energy, rel=1e-12)


def test_panels_do_not_pass_through_each_other(body, simulate):
    # Thrown with the energy that folds a linear hinge through shut, a wing comes back.
    def run(law, limits):
        geometry = replace(
            wing(np.pi, stiffness=[0.1], rest_angle=[np.pi]),
            masses=[1, 1, 0.01, 1],
            velocities=[[0, 0, 0], [0, 0, 0], [0, 0, 10.5], [0, 0, 0]],
            bars=Bars(
                indices=[[0, 2], [1, 2]],
                stiffness=[2000, 2000],
                rest_length=[np.hypot(0.4, 1), np.hypot(0.6, 1)],
            ),
        )
        hinges = replace(geometry.hinges, law=[law], limit_low=[limits[0]], limit_high=[limits[1]])
        geometry = replace(geometry, hinges=hinges)
        return simulate(Experiment(geometry=geometry, duration=0.6, dt=2e-5, save_interval=2e-3))

    walled = run("enhanced-linear", (np.pi / 4, 7 * np.pi / 4))
    assert np.abs(np.diff(walled.angle[:, 0])).max() < 1.0
    assert np.abs(walled.balance).max() < 1e-6 * walled.kinetic.max()
    free = run("linear", (0.0, 2 * np.pi))
    assert np.abs(np.diff(free.angle[:, 0])).max() > 3.0  # from shut to shut on the other side


# --- the printed damping law ----------------------------------------------------------------


def dumbbell(masses, spin, zeta, **settings):
    """Two free masses on a bar that turns about its centre of mass."""
    m1, m2 = masses
    arms = np.array([-m2, m1]) / (m1 + m2)
    geometry = Geometry(
        positions=[[a, 0, 0] for a in arms],
        velocities=[[0, a * spin, 0] for a in arms],
        masses=masses,
        bars=Bars(indices=[[0, 1]], stiffness=[1e4], rest_length=[1.0], damping=[zeta]),
    )
    return Experiment(geometry=geometry, duration=0.4, dt=1e-4, save_interval=1e-2, **settings)


def spin_of(run, masses):
    relative = run.x[:, 1] - run.x[:, 0]
    speed = run.v[:, 1] - run.v[:, 0]
    return np.cross(relative, speed)[:, 2] / np.sum(relative**2, axis=1)


def test_the_printed_damping_slows_rigid_rotation(simulate):
    # For equal masses omega(t) = omega0 exp(-4 zeta sqrt(k/m) t).
    zeta, m = 1e-3, 0.1
    run = simulate(dumbbell([m, m], 2.0, zeta, bar_damping="printed"))
    expected = 2.0 * np.exp(-4 * zeta * np.sqrt(1e4 / m) * run.t)
    np.testing.assert_allclose(spin_of(run, m), expected, rtol=2e-3)
    # What it takes is booked.
    assert np.abs(run.balance).max() < 1e-6 * run.kinetic[0]
    axial = simulate(dumbbell([m, m], 2.0, zeta))
    np.testing.assert_allclose(spin_of(axial, m), 2.0, rtol=2e-3)


def test_the_printed_damping_breaks_momentum_of_unequal_masses(simulate):
    def momentum(bar_damping):
        geometry = Geometry(
            positions=[[0, 0, 0], [1, 0, 0]],
            velocities=[[0, 0, 0], [1, 0, 0]],
            masses=[0.1, 0.9],
            bars=Bars(indices=[[0, 1]], stiffness=[10.0], rest_length=[1.0], damping=[0.2]),
        )
        run = simulate(
            Experiment(
                geometry=geometry,
                duration=1.0,
                dt=1e-3,
                save_interval=1e-2,
                bar_damping=bar_damping,
            )
        )
        return np.einsum("n,tna->ta", geometry.masses, run.v)[:, 0]

    np.testing.assert_allclose(momentum("axial"), 0.9, rtol=1e-13)
    assert np.ptp(momentum("printed")) > 0.05


def test_the_printed_damping_of_a_held_bar_is_the_damping_ratio(simulate):
    zeta = 0.05
    geometry = one_bar("linear", 0.1, damping=[zeta])
    omega = np.sqrt(K / M)
    damped = omega * np.sqrt(1 - zeta**2)
    period = 2 * np.pi / damped
    run = simulate(
        Experiment(
            geometry=geometry,
            duration=5 * period,
            dt=period / 1000,
            save_interval=period,
            bar_damping="printed",
        )
    )
    decrement = np.log(run.x[:-1, 1, 0] - L) - np.log(run.x[1:, 1, 0] - L)
    np.testing.assert_allclose(decrement, 2 * np.pi * zeta / np.sqrt(1 - zeta**2), rtol=1e-8)


# --- prescribed velocities -------------------------------------------------------------------


@pytest.mark.parametrize("interpolation", ["hold", "linear", "cubic"])
def test_a_prescribed_velocity_is_followed_exactly(body, simulate, drive, interpolation):
    rng = np.random.default_rng(2)
    values = rng.normal(size=(6, 3))
    signal, actuator = drive(
        values, dt=0.2, node=1, type="velocity", interpolation=interpolation, axes=(1, 0, 1)
    )
    scene = body(
        [[0, 0, 0], [1, 0, 0]],
        [1, 1],
        bars=[(0, 1, 5.0, 1.0, 0.1)],
        signals=[signal],
        actuators=[actuator],
        duration=1.4,
        dt=0.01,
        save_interval=0.05,
    )
    run = simulate(scene)
    from openprc.demlat.signal_table import sample_signal

    fine = np.linspace(0, 1.4, 28 * 400 + 1)
    speed = sample_signal(signal, fine)
    # Samples just before a jump have the old value.
    middle = sample_signal(signal, (fine[1:] + fine[:-1]) / 2)
    h = fine[1] - fine[0]
    if interpolation == "hold":
        travelled = np.cumsum(middle * h, axis=0)
    else:
        travelled = np.cumsum((speed[1:] + 4 * middle + speed[:-1]) * h / 6, axis=0)
    travelled = np.vstack([np.zeros(3), travelled])[::400]
    for axis in (0, 2):
        start = scene.geometry.positions[1, axis]
        np.testing.assert_allclose(run.x[:, 1, axis], start + travelled[:, axis], atol=1e-9)
    # Its y axis stays free, and the other node follows the pull.
    assert np.ptp(run.x[:, 0, 0]) > 0.01
    assert np.abs(run.balance).max() < 1e-5 * np.abs(run.work_in).max()


# --- scales -------------------------------------------------------------------------------


def test_units_of_millimetres_and_grams_give_the_same_motion(lattice, simulate, drive):
    # m -> mm and kg -> g: forces in mN (kg mm/s2 / 1e3 ...), so N/m stay, N*m/rad times 1e6.
    scene = lattice(3, damping=0.05, gravity=(0.0, 0.3, -9.81))
    pushed, pusher = drive(np.sin(np.arange(30))[:, None] * [0.1, 0.0, 0.2], dt=0.05, node=8)
    geometry = scene.geometry
    hinges = Hinges(
        indices=[[0, 4, 1, 3], [4, 8, 5, 7]],
        stiffness=[0.02, 0.03],
        rest_angle=[np.pi, 3.0],
        damping=[1e-4, 2e-4],
    )
    geometry = replace(geometry, hinges=hinges)
    scene = replace(
        scene, geometry=geometry, signals={"u": pushed}, actuators=(pusher,), damping=0.02
    )
    length, mass = 1e3, 1e3
    small = replace(
        scene,
        gravity=tuple(length * g for g in scene.gravity),
        damping=mass * scene.damping,
        signals={"u": replace(pushed, values=pushed.values * mass * length)},
        geometry=replace(
            geometry,
            positions=geometry.positions * length,
            velocities=geometry.velocities * length,
            masses=geometry.masses * mass,
            bars=replace(
                geometry.bars,
                stiffness=geometry.bars.stiffness * mass,
                damping=geometry.bars.damping * mass,
                rest_length=geometry.bars.rest_length * length,
            ),
            hinges=replace(
                hinges,
                stiffness=hinges.stiffness * mass * length**2,
                damping=hinges.damping * mass * length**2,
            ),
        ),
    )
    one, two = simulate(scene), simulate(small)
    assert np.ptp(one.x, axis=0).max() > 0.01
    np.testing.assert_allclose(two.x / length, one.x, rtol=0, atol=1e-12)
    np.testing.assert_allclose(two.angle, one.angle, atol=1e-10)
    np.testing.assert_allclose(two.moment / (mass * length**2), one.moment, atol=1e-12)


def test_the_scaler_changes_no_bit(lattice, simulate, monkeypatch):
    from openprc.demlat.scaling import SimulationScaler

    scene = lattice(3, damping=0.05, gravity=(0.0, 0.3, -9.81))
    scaled = simulate(scene)
    unit = SimulationScaler.for_experiment(scene)
    assert unit != SimulationScaler()
    assert all(np.log2(u) == round(np.log2(u)) for u in (unit.length, unit.mass, unit.time))
    monkeypatch.setattr(SimulationScaler, "for_experiment", lambda experiment: SimulationScaler())
    plain = simulate(scene)
    assert np.array_equal(scaled.x, plain.x)
    assert np.array_equal(scaled.energy, plain.energy)


def test_single_precision_follows_double_precision(lattice, simulate):
    scene = lattice(3, damping=0.05, duration=0.2)
    fine, coarse = simulate(scene), simulate(replace(scene, precision="float32"))
    motion = np.abs(fine.x - fine.x[0]).max()
    assert 0 < np.abs(coarse.x - fine.x).max() < 1e-4 * motion
