"""The random network of nonlinear springs of Hauser et al. 2011.

Masses of 1 kg at random points, joined by their Delaunay triangulation; every spring pulls with
``k3 s^3 + k1 s + d3 r^3 + d1 r`` (s its stretch, r the rate of it), the leftmost and the
rightmost node are fixed, and the input pushes a fifth of the others along x, each with a weight
of its own (doi:10.1007/s00422-012-0471-0). Constants are drawn evenly in their logarithms.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Literal

import numpy as np

from openprc.scenes.converged import converged_motion
from openprc.scenes.option_checks import check_range
from openprc.scenes.probes import deviation_probe
from openprc.scenes.scene import Reference, Scene
from openprc.schema.experiment import Actuator, Experiment, Signal, Stored
from openprc.schema.geometry import Bars, Geometry

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Reals = NDArray[np.float64]

SIZE, MASS = 10.0, 1.0  # m, kg
INTERVAL = 1e-3  # s, between rows of the tasks
FREQUENCIES = (2.11, 3.73, 4.33)  # Hz
#: Of the nodes, the share that the input pushes.
SHARE = 0.2
#: Ranges of k1, d1 and of both cubic constants, and the amplitude of the input [N], by task.
RANGES = {"volterra": ((1.0, 200.0), (1.0, 200.0)), "narma": ((10.0, 100.0), (10.0, 100.0))}
CUBIC = (1.0, 100.0)
#: That of the second is of unit variance: the system computes from 0.1 of the product, and the
#: body is pushed by the standardised input.
AMPLITUDES = {"volterra": 0.2, "narma": math.sqrt(8.0)}
#: How far the reference is compared [s].
CHECKED = 0.5


def network_input(n_rows: int, *, amplitude: float) -> Reals:
    """Return ``amplitude * sin(2 pi 2.11 t) sin(2 pi 3.73 t) sin(2 pi 4.33 t)``: (n_rows,) [N]."""
    t = np.arange(n_rows) * INTERVAL
    product: Reals = amplitude * np.prod([np.sin(2.0 * math.pi * f * t) for f in FREQUENCIES], 0)
    return product


def build(*, n: int, drive: Literal["volterra", "narma"], n_steps: int, seed: int) -> Scene:
    """Return the network; options as in the record."""
    from scipy.spatial import Delaunay

    check_range("hauser-network", {"n": n}, least=5)
    check_range("hauser-network", {"n_steps": n_steps}, least=4)
    check_range("hauser-network", {"seed": seed}, least=0)
    rng = np.random.default_rng(seed)
    points = rng.uniform(0.0, SIZE, (n, 2))
    sides = np.sort(Delaunay(points).simplices[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    bars = np.unique(sides, axis=0)
    positions = np.column_stack([points, np.zeros(n)])
    fixed = np.isin(np.arange(n), [points[:, 0].argmin(), points[:, 0].argmax()])
    linear, rates = RANGES[drive]
    k1, d1, k3, d3 = (
        np.exp(rng.uniform(math.log(span[0]), math.log(span[1]), len(bars)))
        for span in (linear, rates, CUBIC, CUBIC)
    )
    pushed = np.sort(rng.choice(np.flatnonzero(~fixed), max(1, round(SHARE * n)), replace=False))
    weights = rng.uniform(-1.0, 1.0, len(pushed))
    u = network_input(n_steps + 1, amplitude=AMPLITUDES[drive])
    names = [f"u{number}" for number in range(1, len(pushed) + 1)]
    signals = {
        name: Signal(
            name=name,
            values=weight * u,
            dt=INTERVAL,
            interpolation="cubic",
            unit="N",
            # The input itself, which tasks are about; the others are copies of it.
            sequence=u[:-1] if name == names[0] else None,
            hold=INTERVAL if name == names[0] else None,
        )
        for name, weight in zip(names, weights, strict=True)
    }
    # A dashpot of 1 kg/s slows a mass of 1 kg at 1 / s, and its neighbour as well.
    damped = np.zeros(n)
    np.add.at(damped, bars, d1[:, np.newaxis])
    steps = math.ceil(INTERVAL * 2.0 * damped.max() / MASS / 0.8)
    labels = tuple(f"node{number}" for number in range(n))
    experiment = Experiment(
        geometry=Geometry(
            positions=positions,
            masses=np.full(n, MASS),
            fixed=fixed,
            labels=labels,
            bars=Bars(
                indices=bars,
                stiffness=k1,
                rest_length=np.linalg.norm(positions[bars[:, 1]] - positions[bars[:, 0]], axis=1),
                damping=d1,
                law=np.full(len(bars), "cubic"),
                stiffness_cubic=k3,
                damping_cubic=d3,
            ),
        ),
        signals=signals,
        actuators=tuple(
            Actuator(node=int(node), signal=name, type="force", axes=(True, False, False))
            for node, name in zip(pushed, names, strict=True)
        ),
        duration=n_steps * INTERVAL,
        dt=INTERVAL / steps,
        save_interval=INTERVAL,
        # Lengths follow from positions; they would make the file six times as large.
        stored=Stored(velocities=False, elements=False),
    )
    exact = converged_motion(experiment)
    scale = _stretch(positions, bars, k1, fixed, pushed, weights) * float(np.std(u))
    return Scene(
        name="hauser-network",
        experiment=experiment,
        reference=Reference(
            kind="converged",
            text=f"compared over the first {min(CHECKED, experiment.duration):g} s; published for"
            " this family of networks is that they imitate the task, not how they move",
            source="SciPy's DOP853 to 1e-11; body and tasks: doi:10.1007/s00422-012-0471-0",
            exact=exact,
            probes=(
                deviation_probe(
                    exact,
                    labels,
                    scale=scale,
                    tolerance=1e-3,
                    source="DOP853",
                    until=min(CHECKED, experiment.duration),
                ),
            ),
        ),
        scale=scale,
        input_name=names[0],
        features="bar-extensions",
    )


def _stretch(
    positions: Reals,
    bars: NDArray[np.int32],
    stiffness: Reals,
    fixed: NDArray[np.bool_],
    pushed: NDArray[np.int64],
    weights: Reals,
) -> float:
    """Return the largest displacement under a constant input of 1 N, to first order [m]."""
    along = positions[bars[:, 1], :2] - positions[bars[:, 0], :2]
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    rows = np.zeros((len(bars), len(positions), 2))
    number = np.arange(len(bars))
    rows[number, bars[:, 0]], rows[number, bars[:, 1]] = -along, along
    free = np.repeat(~fixed, 2)
    gram = rows.reshape(len(bars), -1)[:, free]
    force = np.zeros((len(positions), 2))
    force[pushed, 0] = weights
    moved = np.linalg.lstsq((gram.T * stiffness) @ gram, force.ravel()[free], rcond=1e-10)[0]
    return float(np.linalg.norm(moved.reshape(-1, 2), axis=1).max())
