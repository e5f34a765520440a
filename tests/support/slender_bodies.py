"""Chains of bars with bending springs, and their motion by SciPy from NumPy forces."""

import numpy as np
from scipy.integrate import solve_ivp

from openprc.demlat.statics.bending import BendLaws, bend_gradients, bend_turns
from openprc.schema.experiment import Experiment
from openprc.schema.geometry import Bars, Bends, Geometry

LENGTH, RADIUS, DENSITY, MODULUS = 1.0, 0.02, 1000.0, 1e6
AREA = np.pi * RADIUS**2
RIGIDITY = MODULUS * np.pi * RADIUS**4 / 4.0


def triples(n_nodes):
    """Return [end, vertex, end] of all inner nodes."""
    return np.arange(n_nodes - 2)[:, None] + [0, 1, 2]


def cantilever(n, *, axis=(1.0, 0.0, 0.0), bar_damping=0.0, bend_damping=0.0):
    """Return a round rod of n segments along `axis`, clamped at its first two nodes."""
    l = LENGTH / n  # noqa: E741
    masses = np.full(n + 1, DENSITY * AREA * l)
    masses[[0, -1]] *= 0.5
    first = np.arange(n)
    return Geometry(
        positions=np.arange(n + 1)[:, None] * l * np.array(axis),
        masses=masses,
        fixed=np.arange(n + 1) < 2,
        bars=Bars(
            indices=np.stack([first, first + 1], axis=1),
            stiffness=np.full(n, MODULUS * AREA / l),
            rest_length=np.full(n, l),
            damping=np.full(n, bar_damping),
        ),
        bends=Bends(
            indices=triples(n + 1),
            stiffness=np.full(n - 1, RIGIDITY / l),
            damping=np.full(n - 1, bend_damping),
        ),
    )


def tip_deflection(n, force):
    """Return that of the cantilever for small loads [m], in closed form."""
    return force * LENGTH**3 / (3.0 * RIGIDITY) * (1.0 - 1.5 / n + 0.5 / n**2)


def crooked_chain(n, *, seed=0, damping=0.0, fixed=(), rest="bent", speed=1.0):
    """Return a chain in space that nothing makes symmetric."""
    rng = np.random.default_rng(seed)
    steps = rng.standard_normal((n - 1, 3)) + np.array([2.0, 0.0, 0.0])
    positions = np.concatenate([np.zeros((1, 3)), np.cumsum(steps, axis=0)])
    first = np.arange(n - 1)
    held = np.isin(np.arange(n), fixed)
    lengths = np.linalg.norm(steps, axis=1)
    return Geometry(
        positions=positions,
        masses=rng.uniform(0.5, 2.0, n),
        fixed=held,
        velocities=np.where(held[:, None], 0.0, speed * rng.standard_normal((n, 3))),
        bars=Bars(
            indices=np.stack([first, first + 1], axis=1),
            stiffness=rng.uniform(100.0, 200.0, n - 1),
            rest_length=lengths,
            damping=np.full(n - 1, damping),
        ),
        bends=Bends(
            indices=triples(n),
            stiffness=rng.uniform(2.0, 4.0, n - 2),
            rest_angle=rng.uniform(1.5, 2.5, n - 2) if rest == "bent" else np.full(n - 2, np.pi),
            damping=damping * rng.uniform(0.5, 1.0, n - 2),
        ),
    )


def experiment(geometry, **settings):
    times = {"duration": 1.0, "dt": 1e-3, "save_interval": 0.1}
    return Experiment(geometry=geometry, **(times | settings))


def numpy_forces(scene, x, v):
    """Return forces on all nodes: (N, 3) [N]; bars, bends, weight and drag."""
    bars, bends, masses = scene.geometry.bars, scene.geometry.bends, scene.geometry.masses
    force = masses[:, None] * np.array(scene.gravity) - scene.drag[:, None] * v
    along = x[bars.indices[:, 1]] - x[bars.indices[:, 0]]
    length = np.linalg.norm(along, axis=1)
    along /= length[:, None]
    rate = np.sum(along * (v[bars.indices[:, 1]] - v[bars.indices[:, 0]]), axis=1)
    tension = bars.stiffness * (length - bars.relaxed_length) + bars.damping * rate
    np.add.at(force, bars.indices[:, 0], tension[:, None] * along)
    np.add.at(force, bars.indices[:, 1], -tension[:, None] * along)
    gradients = bend_gradients(x, bends.indices)
    moment = BendLaws(bends).force(bend_turns(x, bends.indices))
    moment += bends.damping * np.einsum("bna,bna->b", gradients, v[bends.indices])
    np.add.at(force, bends.indices, -moment[:, None, None] * gradients)
    return force


def scipy_motion(scene):
    """Return positions and velocities at the frames by SciPy's DOP853: (T, N, 3) each."""
    geometry = scene.geometry
    n, free = geometry.n_nodes, ~geometry.fixed[:, None]

    def slope(_, y):
        x, v = y.reshape(2, n, 3)
        a = numpy_forces(scene, x, v) / geometry.masses[:, None]
        return np.concatenate([(free * v).ravel(), (free * a).ravel()])

    start = np.concatenate([geometry.positions.ravel(), geometry.velocities.ravel()])
    times = scene.frame_times
    found = solve_ivp(slope, times[[0, -1]], start, "DOP853", times, rtol=1e-12, atol=1e-12)
    x, v = found.y.T.reshape(len(times), 2, n, 3).transpose(1, 0, 2, 3)
    return x, v
