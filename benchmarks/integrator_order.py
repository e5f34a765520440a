"""Order of the native integrator, and the balance of its energy ledger.

    python benchmarks/integrator_order.py [--json]

A mass on a spring is compared with its cosine while the step is halved; the lattice of the demo
is run once, and the energy that its ledger cannot account for is given as a fraction of the work
that the drive did.
"""

from __future__ import annotations

import argparse
import itertools
import json
import math
import tempfile
from pathlib import Path

import numpy as np

from openprc.demlat import SimulationSetup
from openprc.demlat.samples import write_sample
from openprc.hooks import run_experiment
from openprc.schema import Trajectory

STEPS = [0.04 / 2**i for i in range(6)]
STIFFNESS, MASS, STRETCH, DURATION = 100.0, 1.0, 0.1, 2.0


def oscillator_error(folder: Path, dt: float) -> float:
    """Return the largest error [m] of a free oscillation of amplitude `STRETCH`."""
    setup = SimulationSetup(folder, overwrite=True)
    setup.set_simulation_params(duration=DURATION, dt=dt, save_interval=STEPS[0])
    setup.set_physics(gravity=0.0, damping=0.0)
    wall = setup.add_node([0.0, 0.0, 0.0], fixed=True)
    mass = setup.add_node([1.0 + STRETCH, 0.0, 0.0], mass=MASS)
    setup.add_bar(wall, mass, stiffness=STIFFNESS, rest_length=1.0)
    setup.save()
    with Trajectory(run_experiment(folder, overwrite=True).path) as run:
        exact = 1.0 + STRETCH * np.cos(math.sqrt(STIFFNESS / MASS) * run.time)
        return float(np.abs(run.positions()[:, 1, 0] - exact).max())


def energy_gap(folder: Path) -> float:
    """Return the unaccounted energy of the demo's lattice as a fraction of the work done."""
    experiment = write_sample(folder).path
    with Trajectory(run_experiment(experiment, folder / "simulation.h5").path) as run:
        total, work, lost = (run.system(n) for n in ("total_energy", "work_in", "dissipated"))
    return float(np.abs(total - total[0] - work + lost).max() / np.abs(work).max())


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        errors = [oscillator_error(Path(name) / "spring", dt) for dt in STEPS]
        gap = energy_gap(Path(name) / "lattice")
    orders = [math.log2(a / b) for a, b in itertools.pairwise(errors)]
    if options.json:
        print(json.dumps({"dt": STEPS, "error": errors, "order": orders, "energy_gap": gap}))
        return
    shown = ["", *(f"order {order:.2f}" for order in orders)]
    for dt, error, order in zip(STEPS, errors, shown, strict=True):
        print(f"dt {dt:.5f} s   error {error:.3e} m   {order}".rstrip())
    print(f"energy not accounted for: {gap:.1e} of the work done by the drive")


if __name__ == "__main__":
    main()
