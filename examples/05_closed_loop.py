"""Let a spring lattice oscillate on its own: its readout, fed back as forces, is van der Pol's.

The lattice is pushed with the two coordinates of van der Pol oscillators until a linear readout of
its displacements and strains can say what comes next; then it is pushed with what the readout says
(Hauser et al. 2012, doi:10.1007/s00422-012-0516-4). Nothing but springs and masses computes the
nonlinear part. Oscillators that begin anywhere, and noise, teach the loop to come back to the
cycle when it is off: half the size, or a tenth, ends on the same one.

python examples/05_closed_loop.py
"""

from __future__ import annotations

import tempfile
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from openprc.demlat import SimulationSetup
from openprc.demlat.sensors import Sensors
from openprc.demlat.stepping import SteppedExperiment
from openprc.reservoir import Ridge
from openprc.reservoir.training.closed_loop import Feedback, fit_generator, run_closed_loop
from openprc.schema import load_experiment

SIDE, SPACING = 5, 0.1  # nodes, m
HOLD = 0.06  # s
PERIOD = 40  # symbols
PUSH = Feedback(gain=0.06)  # N per unit of the oscillator, whose coordinates reach 2 and 2.7


def van_der_pol(starts: NDArray[np.float64], n_symbols: int) -> NDArray[np.float64]:
    """Return ``x'' = (1 - x^2) x' - x`` from starts (S, 2) as rows (x, x'): (S, K, 2).

    The period on the cycle is 6.663287 in the time of the equation, and `PERIOD` rows.
    """
    substeps = 10
    h = 6.663287 / PERIOD / substeps

    def rate(y: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.stack([y[:, 1], (1.0 - y[:, 0] ** 2) * y[:, 1] - y[:, 0]], axis=1)

    rows, y = [], starts
    for _ in range(n_symbols):
        rows.append(y)
        for _ in range(substeps):
            a = rate(y)
            b = rate(y + h / 2 * a)
            c = rate(y + h / 2 * b)
            y = y + h / 6 * (a + 2 * b + 2 * c + rate(y + h * c))
    return np.stack(rows, axis=1)


def lattice(folder: Path) -> SteppedExperiment:
    """Return an irregular lattice, fixed on the left and pushed at its two right corners."""
    rng = np.random.default_rng(1)
    setup = SimulationSetup(folder, overwrite=True)
    places = np.stack(np.meshgrid(np.arange(SIDE), np.arange(SIDE), indexing="ij"), axis=-1)
    places = SPACING * (places + rng.uniform(-0.2, 0.2, places.shape))
    number = np.arange(SIDE * SIDE).reshape(SIDE, SIDE)
    for place, node in zip(places.reshape(-1, 2), number.flat, strict=True):
        setup.add_node(place, mass=0.01, fixed=bool(node < SIDE))
    runs = (
        (number[:-1], number[1:]),
        (number[:, :-1], number[:, 1:]),
        (number[:-1, :-1], number[1:, 1:]),
        (number[1:, :-1], number[:-1, 1:]),
    )
    for one, other in runs:
        for i, j in zip(one.flat, other.flat, strict=True):
            setup.add_bar(int(i), int(j), stiffness=6.0 * rng.uniform(0.7, 1.3), damping=0.02)
    for name, node in (("upper", number[-1, -1]), ("lower", number[-1, 0])):
        setup.add_signal(name, np.zeros(1), dt=HOLD, interpolation="hold", unit="N")
        setup.add_actuator(int(node), name, type="force", axes=[name == "lower", True, False])
    setup.set_physics(gravity=0.0, damping=0.1)
    setup.set_simulation_params(duration=HOLD, dt=0.003, save_interval=HOLD)
    setup.save()
    free = Sensors("displacements", ids=number[1:].ravel().tolist(), axes="xy")
    return SteppedExperiment(
        load_experiment(folder), hold=HOLD, sensors=[free, Sensors("bar_extensions")]
    )


def cycle(x: NDArray[np.float64]) -> tuple[int, float, float]:
    """Return the number of periods, their mean length in symbols, and the mean amplitude."""
    up = np.flatnonzero((x[:-1] < 0.0) & (x[1:] >= 0.0))
    crossings = up - x[up] / (x[up + 1] - x[up])
    peaks = [x[i:j].max() for i, j in pairwise(up)]
    return len(peaks), float(np.diff(crossings).mean()), float(np.mean(peaks))


def main(folder: Path) -> None:
    """Train the lattice, let it run, and compare period and amplitude."""
    starts = np.random.default_rng(0).uniform([-2.5, -3.5], [2.5, 3.5], (60, 2))
    body = lattice(folder / "lattice")
    print(f"{SIDE * SIDE} nodes, {body.n_states} sensors, symbols of {1e3 * HOLD:g} ms")
    readout = fit_generator(
        body,
        list(van_der_pol(starts, 100)),
        Ridge(1e-4),
        washout=15,
        feedback=PUSH,
        noise=0.03,
        seed=1,
    )
    (oscillator,) = van_der_pol(np.array([[2.0, 0.0]]), 1600)
    _, period, amplitude = cycle(oscillator[:, 0])
    print(f"{'begun at':12}{'periods':>9}{'period error':>14}{'amplitude error':>17}")
    for size in (1.0, 0.5, 0.1):
        warm_up = size * oscillator[:200]
        # The guard counts in sizes of the warm-up, and the cycle may be ten times that.
        run = run_closed_loop(
            body, readout, n_steps=1600, warm_up=warm_up, feedback=PUSH, limit=50.0
        )
        n_periods, own_period, own_amplitude = cycle(run.outputs[400:, 0])
        errors = own_period / period - 1.0, own_amplitude / amplitude - 1.0
        print(f"{size:8.0%}{n_periods:13d}{errors[0]:14.2%}{errors[1]:17.2%}")
        assert n_periods >= 25
        assert abs(errors[0]) < 0.02
        assert abs(errors[1]) < 0.02


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as name:
        main(Path(name))
