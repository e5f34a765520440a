"""Order of every integrator, damped and undamped, and the balance of its energy ledger.

    python benchmarks/integrator_order.py [--integrators rk4 verlet ...] [--json]

A mass on a spring is compared with its closed form while the step is halved, or the tolerance
is divided by ten where the integrator chooses its steps: then the slope of the error over the
tolerance is given, which should be one. The lattice of the demo is run once with each, and the
energy that the ledger cannot account for is given as a fraction of the work of the drive.
"""

from __future__ import annotations

import argparse
import itertools
import json
import math
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from openprc.demlat import SimulationSetup
from openprc.demlat.integrators import INTEGRATORS
from openprc.demlat.samples import write_sample
from openprc.hooks import run_experiment
from openprc.schema import Trajectory
from openprc.schema.experiment import load_experiment, save_experiment

STEPS = [0.02 / 2**i for i in range(6)]
TOLERANCES = [10.0**-i for i in range(3, 10)]
STIFFNESS, MASS, STRETCH, DURATION, FRAME = 100.0, 1.0, 0.1, 2.0, 0.1
DAMPERS = {"undamped": 0.0, "damped": 2.0}  # [N*s/m]
#: What keeps to a file format instead of an order is not measured.
MEASURED = [name for name, scheme in INTEGRATORS.items() if scheme.step != "legacy"]


def oscillator_error(folder: Path, name: str, *, damping: float, rung: float) -> float:
    """Return the largest error [m] with the step or the tolerance `rung`."""
    adaptive = INTEGRATORS[name].step == "adaptive"
    setup = SimulationSetup(folder, overwrite=True)
    setup.set_simulation_params(
        duration=DURATION,
        dt=FRAME if adaptive else rung,
        save_interval=FRAME,
        integrator=name,
        tolerance=rung if adaptive else None,
    )
    setup.set_physics(gravity=0.0, damping=0.0)
    wall = setup.add_node([0.0, 0.0, 0.0], fixed=True)
    mass = setup.add_node([1.0 + STRETCH, 0.0, 0.0], mass=MASS)
    setup.add_bar(wall, mass, stiffness=STIFFNESS, rest_length=1.0, damping=damping)
    setup.save()
    rate = damping / (2.0 * MASS)
    omega = math.sqrt(STIFFNESS / MASS - rate**2)
    with Trajectory(run_experiment(folder, overwrite=True).path) as run:
        t = run.time
        swing = np.cos(omega * t) + rate / omega * np.sin(omega * t)
        exact = 1.0 + STRETCH * np.exp(-rate * t) * swing
        return float(np.abs(run.positions()[:, 1, 0] - exact).max())


def energy_gap(folder: Path, name: str) -> float:
    """Return the unaccounted energy of the demo's lattice as a fraction of the work done."""
    path = write_sample(folder).path
    save_experiment(replace(load_experiment(path), integrator=name), path)
    with Trajectory(run_experiment(path, folder / "simulation.h5").path) as run:
        total, work, lost = (run.system(n) for n in ("total_energy", "work_in", "dissipated"))
    return float(np.abs(total - total[0] - work + lost).max() / np.abs(work).max())


def measure(name: str, folder: Path) -> dict[str, Any]:
    """Return errors, slopes and the energy gap of an integrator."""
    adaptive = INTEGRATORS[name].step == "adaptive"
    rungs = TOLERANCES if adaptive else STEPS
    result: dict[str, Any] = {"rungs": rungs, "declared": INTEGRATORS[name].order}
    for kind, damping in DAMPERS.items():
        errors = [
            oscillator_error(folder / kind, name, damping=damping, rung=rung) for rung in rungs
        ]
        ratio = math.log(rungs[0] / rungs[1])
        slopes = [math.log(a / b) / ratio for a, b in itertools.pairwise(errors)]
        result[kind] = {"error": errors, "slope": slopes}
    result["energy_gap"] = energy_gap(folder / "lattice", name)
    return result


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--integrators", nargs="+", choices=MEASURED, default=MEASURED)
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        results = {scheme: measure(scheme, Path(name) / scheme) for scheme in options.integrators}
    if options.json:
        print(json.dumps(results))
        return
    table = Table(title="slopes of the error from rung to rung; errors at the last one")
    for title in ("", "order", "undamped", "error", "damped", "error", "energy gap"):
        table.add_column(title, justify="left" if not title else "right", no_wrap=True)
    for scheme, result in results.items():
        cells = []
        for kind in DAMPERS:
            slopes = result[kind]["slope"]
            cells.append(f"{min(slopes):.2f} to {max(slopes):.2f}")
            cells.append(f"{result[kind]['error'][-1]:.1e} m")
        adaptive = INTEGRATORS[scheme].step == "adaptive"
        order = f"{result['declared']} (1)" if adaptive else f"{result['declared']}"
        table.add_row(scheme, order, *cells, f"{result['energy_gap']:.1e}")
    console = Console(width=max(Console().width, 110))
    console.print(table)
    console.print("(1) over the tolerance, which the error should be in proportion to")


if __name__ == "__main__":
    main()
