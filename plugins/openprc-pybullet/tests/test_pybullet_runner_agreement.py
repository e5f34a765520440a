"""The same experiment by other means: demlat, a twin in NumPy, and an accurate reference."""

import h5py
import numpy as np
import pytest
from openprc_pybullet.client import direct_client
from openprc_pybullet.half_kick import HalfKickLoop
from scipy.integrate import solve_ivp
from scipy.spatial import Delaunay

from openprc.demlat.forces import ForceField
from openprc.demlat.producer import DemlatProducer
from openprc.schema import Experiment
from openprc.schema.experiment import Actuator, Signal
from openprc.schema.geometry import Bars, Geometry, Hinges

pytest.importorskip("pybullet")


def everything(rng):
    """A body with every law of force, driven in every way, with signals of every kind."""
    n = 12
    positions = rng.uniform(0.0, 1.0, (n, 3))
    pairs = np.array([(i, j) for i in range(n) for j in range(i) if rng.random() < 0.4])
    law = np.array(["linear", "cubic", "cable", "strut", "ogden"])[np.arange(len(pairs)) % 5]
    lengths = np.linalg.norm(positions[pairs[:, 1]] - positions[pairs[:, 0]], axis=1)
    fixed = np.arange(n) == 0
    body = Geometry(
        positions=positions,
        masses=rng.uniform(0.5, 2.0, n),
        fixed=fixed,
        velocities=np.where(fixed[:, None], 0.0, 0.3 * rng.normal(size=(n, 3))),
        bars=Bars(
            indices=pairs,
            stiffness=np.full(len(pairs), 100.0),
            rest_length=0.98 * lengths,
            damping=np.full(len(pairs), 0.5),
            law=law,
            stiffness_cubic=np.where(law == "cubic", 500.0, 0.0),
            damping_cubic=np.where(law == "cubic", 0.1, 0.0),
        ),
        hinges=Hinges(
            indices=[[0, 1, 2, 3], [4, 5, 6, 7]],
            stiffness=[1.0, 2.0],
            rest_angle=[3.0, 2.0],
            damping=[0.01, 0.02],
        ),
    )
    waves = {
        "push": (rng.normal(size=(20, 3)), 0.1, "hold"),
        "place": (positions[1] + 0.02 * rng.normal(size=(20, 3)), 0.1, "hold"),
        "speed": (0.3 * rng.normal(size=20), 0.05, "linear"),
        "sway": (positions[3, 0] + 0.05 * np.sin(np.arange(30.0)), 0.1, "cubic"),
    }
    return Experiment(
        geometry=body,
        signals={
            name: Signal(name=name, values=values, dt=dt, interpolation=kind)
            for name, (values, dt, kind) in waves.items()
        },
        actuators=(
            Actuator(node=5, signal="push", type="force"),
            Actuator(node=1, signal="place"),
            Actuator(node=2, signal="speed", type="velocity", axes=(False, True, False)),
            Actuator(node=3, signal="sway", axes=(True, False, False)),
        ),
        duration=3.0,
        dt=0.0025,
        save_interval=0.05,
        integrator="verlet",
        gravity=(0.0, 0.0, -9.81),
        damping=0.2,
    )


def test_every_number_is_that_of_velocity_verlet(pb_run):
    """Positions, velocities, elements, energies and the ledger of work, over 1200 steps."""
    scene = everything(np.random.default_rng(0))
    ours, theirs = pb_run(scene, runner=DemlatProducer()), pb_run(scene)
    compared = []
    with h5py.File(ours.path) as one, h5py.File(theirs.path) as two:

        def compare(name, item):
            if isinstance(item, h5py.Dataset) and item.dtype.kind == "f":
                scale = np.abs(item[()]).max(initial=0.0)
                np.testing.assert_allclose(
                    two[name][()], item[()], rtol=0, atol=1e-12 * max(scale, 1.0), err_msg=name
                )
                compared.append(name)

        one.visititems(compare)
    wanted = {"positions", "velocities", "force", "torque", "work_in", "dissipated", "total_energy"}
    assert wanted < {name.rsplit("/", 1)[-1] for name in compared}
    assert np.abs(theirs.positions() - theirs.positions()[0]).max() > 0.3


def test_nodes_are_in_bullet_where_the_file_says():
    """Also a node that is driven along some axes, which Bullet by itself would leave behind."""
    scene = everything(np.random.default_rng(0))
    with direct_client("a test") as (bullet, number):
        loop = HalfKickLoop(
            bullet, number, experiment=scene, field=ForceField(scene), half_kick=True
        )
        loop.advance(57)
        x, v = np.zeros_like(loop.positions), np.zeros_like(loop.positions)
        loop.world.read_positions(x)
        loop.world.read_velocities(v)
        rows = loop.world.rows
        assert {2, 3} < set(rows.tolist())
        assert not {0, 1} & set(rows.tolist())  # fixed, and driven along all axes
        np.testing.assert_array_equal(x[rows], loop.positions[rows])
        driven = [(2, 1), (3, 0)]
        assert [v[at] for at in driven] == [loop.velocities[at] for at in driven]
        assert all(v[at] != 0.0 for at in driven)


# --- Hauser's network -------------------------------------------------------


def hauser(n_steps, *, seed=1, dt=1e-3, save_every=100):
    """A driven network of masses as in Hauser et al. 2011, doi:10.1007/s00422-012-0471-0.

    30 masses of 1 kg in a square of 10 m, springs ``k3 s^3 + k1 s + d3 r^3 + d1 r`` along the
    edges of the Delaunay triangulation, and a force along x on a fifth of the nodes.
    """
    rng = np.random.default_rng(seed)
    n = 30
    plane = rng.uniform(0.0, 10.0, (n, 2))
    corners = Delaunay(plane).simplices
    edges = np.concatenate([corners[:, [0, 1]], corners[:, [1, 2]], corners[:, [2, 0]]])
    pairs = np.unique(np.sort(edges), axis=0)
    positions = np.column_stack([plane, np.zeros(n)])

    def spread(low, high):
        return np.exp(rng.uniform(np.log(low), np.log(high), len(pairs)))

    fixed = np.zeros(n, bool)
    fixed[[plane[:, 0].argmin(), plane[:, 0].argmax()]] = True
    t = dt * np.arange(n_steps + 1)
    wave = 0.2 * np.prod([np.sin(2.0 * np.pi * f * t) for f in (2.11, 3.73, 4.33)], axis=0)
    pushed = rng.choice(np.flatnonzero(~fixed), n // 5, replace=False)
    body = Geometry(
        positions=positions,
        masses=np.ones(n),
        fixed=fixed,
        bars=Bars(
            indices=pairs,
            stiffness=spread(1.0, 200.0),
            rest_length=np.linalg.norm(positions[pairs[:, 1]] - positions[pairs[:, 0]], axis=1),
            damping=spread(1.0, 200.0),
            stiffness_cubic=spread(1.0, 100.0),
            damping_cubic=spread(1.0, 100.0),
            law=np.full(len(pairs), "cubic"),
        ),
    )
    return Experiment(
        geometry=body,
        signals={
            f"u{node}": Signal(
                name=f"u{node}", values=rng.uniform(-1.0, 1.0) * wave, dt=dt, interpolation="hold"
            )
            for node in pushed
        },
        actuators=tuple(
            Actuator(node=int(node), signal=f"u{node}", type="force", axes=(True, False, False))
            for node in pushed
        ),
        duration=n_steps * dt,
        dt=dt,
        save_interval=save_every * dt,
        integrator="verlet",
    )


def semi_implicit_euler(scene, n_steps):
    """Step the network with NumPy alone: ``v += h a(x, v)``, ``x += h v``; (T, N, 3) [m]."""
    body, h = scene.geometry, scene.dt
    bars, (i, j) = body.bars, body.bars.indices.T
    x, v = body.positions.copy(), np.zeros_like(body.positions)
    free = (~body.fixed)[:, None] / body.masses[:, None]
    every = scene.steps_per_frame
    frames = [x.copy()]
    for step in range(n_steps):
        along, rate = x[j] - x[i], v[j] - v[i]
        length = np.sqrt((along**2).sum(axis=1))
        s, r = length - bars.rest_length, (along * rate).sum(axis=1) / length
        tension = (
            bars.stiffness * s + bars.stiffness_cubic * s**3
            + bars.damping * r + bars.damping_cubic * r**3
        )  # fmt: skip
        pull = (tension / length)[:, None] * along
        force = np.zeros_like(x)
        np.add.at(force, i, pull)
        np.add.at(force, j, -pull)
        for actuator in scene.actuators:
            force[actuator.node, 0] += scene.signals[actuator.signal].values[step, 0]
        v += h * force * free
        x += h * v
        if (step + 1) % every == 0:
            frames.append(x.copy())
    return np.array(frames)


def network_agrees(pb_run, n_steps):
    scene = hauser(n_steps)
    twin = semi_implicit_euler(scene, n_steps)
    moved = np.abs(twin - twin[0]).max()
    assert moved > 1e-4
    plain = pb_run(scene, start="plain")
    assert plain.dims == 2  # nothing leads out of the plane
    np.testing.assert_allclose(plain.positions(), twin[..., :2], rtol=0, atol=1e-12)
    kicked, engine = pb_run(scene), pb_run(scene, runner=DemlatProducer())
    np.testing.assert_allclose(kicked.positions(), engine.positions(), rtol=0, atol=1e-12)


def test_a_driven_network_agrees_to_rounding(pb_run):
    network_agrees(pb_run, 3000)


@pytest.mark.slow
def test_a_driven_network_agrees_to_rounding_for_long(pb_run):
    network_agrees(pb_run, 100_000)


# --- against accurate references -------------------------------------------------------


def falling_chain(n, *, stiffness, **times):
    """A horizontal chain of N masses of 0.1 kg let go; 1 m long, unstretched."""
    link = 1.0 / n
    body = Geometry(
        positions=np.column_stack([link * np.arange(n + 1.0), np.zeros((n + 1, 2))]),
        masses=np.full(n + 1, 0.1),
        fixed=np.arange(n + 1) == 0,
        bars=Bars(
            indices=[[k, k + 1] for k in range(n)],
            stiffness=np.full(n, stiffness),
            rest_length=np.full(n, link),
        ),
    )
    return Experiment(geometry=body, gravity=(0, 0, -9.81), integrator="verlet", **times)


def accurate_chain(scene, times):
    """Integrate the same chain with DOP853 of SciPy to 1e-12: (T, N, 3) [m]."""
    body, n = scene.geometry, scene.geometry.n_nodes
    bars, link = body.bars, body.bars.rest_length[0]

    def rhs(_, y):
        x, v = y.reshape(2, n, 3)
        along = np.diff(x, axis=0)
        length = np.sqrt((along**2).sum(axis=1))
        pull = (bars.stiffness * (length - link) / length)[:, None] * along
        force = np.zeros_like(x)
        force[:-1] += pull
        force[1:] -= pull
        a = force / 0.1 + np.array(scene.gravity)
        a[0] = 0.0
        return np.concatenate([v.ravel(), a.ravel()])

    start = np.concatenate([body.positions.ravel(), np.zeros(3 * n)])
    solution = solve_ivp(rhs, (0.0, times[-1]), start, "DOP853", times, rtol=1e-12, atol=1e-13)
    return solution.y[: 3 * n].T.reshape(-1, n, 3)


def test_a_large_swing_of_a_chain(pb_run):
    """Errors at t = 0.25, 0.5 and 1 s, and how they fall with the step."""
    times = np.array([0.0, 0.25, 0.5, 0.75, 1.0])
    errors = {}
    for dt in (1e-3, 5e-4):
        scene = falling_chain(5, stiffness=1e3, duration=1.0, dt=dt, save_interval=0.25)
        reference = accurate_chain(scene, times)
        for start in ("half-kick", "plain"):
            x = pb_run(scene, start=start).positions()
            errors[start, dt] = np.abs(x - reference).max(axis=(1, 2))[[1, 2, 4]]
    np.testing.assert_allclose(errors["half-kick", 1e-3], [2.3e-6, 1.4e-5, 4.4e-5], rtol=0.05)
    np.testing.assert_allclose(errors["plain", 1e-3], [1.2e-3, 3.2e-3, 2.1e-4], rtol=0.05)
    ratio = errors["half-kick", 1e-3] / errors["half-kick", 5e-4]
    np.testing.assert_allclose(ratio, 4.0, rtol=0.05)


def test_order_on_a_folding_sheet(pb_run):
    """Two facets that fold under gravity, with damping: second order against dop853."""
    corners = np.array([[0.0, 0, 0], [1, 0, 0], [0.5, 0.8, 0.1], [0.5, -0.8, 0.2]])
    pairs = [[0, 1], [0, 2], [1, 2], [0, 3], [1, 3]]
    body = Geometry(
        positions=corners,
        masses=[1.0, 1.0, 0.5, 0.7],
        fixed=[1, 1, 0, 0],
        bars=Bars(
            indices=pairs,
            stiffness=np.full(5, 300.0),
            rest_length=[np.linalg.norm(corners[j] - corners[i]) for i, j in pairs],
            damping=np.full(5, 0.5),
        ),
        hinges=Hinges(
            indices=[[0, 1, 2, 3]], stiffness=[1.0], rest_angle=[np.pi - 0.3], damping=[0.05]
        ),
    )
    settings = {"geometry": body, "gravity": (0, 0, -9.81), "duration": 0.5, "save_interval": 0.1}
    exact = pb_run(
        Experiment(**settings, dt=1e-3, integrator="dop853", tolerance=1e-12),
        runner=DemlatProducer(),
    )
    errors = []
    for dt in (4e-3, 2e-3, 1e-3):
        run = pb_run(Experiment(**settings, dt=dt, integrator="verlet"))
        errors.append(np.abs(run.positions() - exact.positions()).max())
        assert np.abs(run.velocities() - exact.velocities()).max() < 2e3 * dt**2
    rates = np.log2(np.array(errors[:-1]) / errors[1:])
    np.testing.assert_allclose(rates, 2.0, atol=0.1)


def test_momentum_is_kept_to_rounding(pb_run):
    rng = np.random.default_rng(3)
    positions = rng.uniform(0.0, 1.0, (8, 3))
    pairs = np.array([(i, j) for i in range(8) for j in range(i)])
    masses = rng.uniform(0.5, 2.0, 8)
    body = Geometry(
        positions=positions,
        masses=masses,
        velocities=rng.normal(size=(8, 3)),
        bars=Bars(
            indices=pairs,
            stiffness=np.full(len(pairs), 50.0),
            rest_length=np.linalg.norm(positions[pairs[:, 1]] - positions[pairs[:, 0]], axis=1),
            damping=np.full(len(pairs), 0.2),
        ),
    )
    run = pb_run(
        Experiment(geometry=body, duration=5.0, dt=5e-3, save_interval=0.05, integrator="verlet")
    )
    x, v = run.positions(), run.velocities()
    linear = np.einsum("n,tna->ta", masses, v)
    np.testing.assert_allclose(linear, np.broadcast_to(linear[0], linear.shape), atol=1e-12)
    # Central forces at positions of one instant: leapfrog keeps this one as well.
    angular = np.einsum("n,tna->ta", masses, np.cross(x, v))
    np.testing.assert_allclose(angular, np.broadcast_to(angular[0], angular.shape), atol=1e-11)
    kinetic = 0.5 * np.einsum("n,tna,tna->t", masses, v, v)
    assert kinetic[-1] < 0.95 * kinetic[0]
