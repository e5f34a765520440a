"""Shake a Miura sheet at its base and account for every joule.

python examples/04_energy_ledger.py
"""

from __future__ import annotations

import math
import tempfile
from pathlib import Path

import numpy as np

from openprc import demlat
from openprc.demlat import BarHingeModel, SimulationSetup, meshing, signals
from openprc.schema import Trajectory

STORED = ("kinetic_energy", "elastic_energy_bars", "elastic_energy_hinges", "gravity_energy")
LOST = ("dissipated_drag", "dissipated_bars", "dissipated_hinges", "dissipated_contact")


def sheet(folder: Path, *, dt: float) -> SimulationSetup:
    """Return a hanging sheet whose upper edge is driven by smoothly joined random symbols."""
    mesh = meshing.miura_sheet(2, 3, a=0.03, b=0.03, sector_angle=math.pi / 3, tilt=math.pi / 4)
    setup = SimulationSetup(folder, overwrite=True)
    nodes = mesh.to_setup(
        setup,
        mass=mesh.lumped_masses(0.5),
        stiffness=2000.0,
        damping=0.02,
        hinge_stiffness=mesh.hinge_values({"fold": 2e-3, "facet": 0.2}) * mesh.crease_lengths,
        hinge_damping=1e-6,
    )
    symbols = signals.held_symbols(
        10, 0.1, np.random.default_rng(1), low=-2e-3, high=2e-3, rise=0.1, dt=2e-3
    )
    for node in nodes[mesh.node_sets["left"]]:
        start = mesh.positions[node - nodes[0]]
        setup.add_signal(f"base {node}", symbols.along([1.0, 0.0, 0.0], start=start), unit="m")
        setup.add_actuator(node, f"base {node}", type="position")
    setup.set_physics(gravity=-9.81, damping=1e-4)
    setup.set_simulation_params(duration=1.0, dt=dt, save_interval=0.02)
    setup.save()
    return setup


def main(folder: Path) -> None:
    """Print the ledger, and how its gap shrinks with the step."""
    gaps = []
    for dt in (2e-4, 1e-4):
        setup = sheet(folder / f"{dt:g}", dt=dt)
        with Trajectory(demlat.Engine(BarHingeModel).run(setup.directory).path) as run:
            stored = {name: run.system(name) for name in STORED}
            lost = {name: run.system(name) for name in LOST}
            work = run.system("work_in")
        total, losses = sum(stored.values()), sum(lost.values())
        gap = np.abs(total - total[0] - work + losses).max()
        gaps.append(gap / np.abs(work).max())
    print("one second of shaking, in microjoules:")
    print(f"  {'work of the actuators':28}{1e6 * work[-1]:12.4f}")
    for name, series in lost.items():
        print(f"  {name.replace('_', ' by ', 1):28}{1e6 * series[-1]:12.4f}")
    for name, series in stored.items():
        print(f"  {'change of ' + name.replace('_', ' '):36}{1e6 * (series[-1] - series[0]):12.4f}")
    print(f"not accounted for, at most: {gaps[0]:.1e} of the work with dt = 0.2 ms,")
    print(f"                            {gaps[1]:.1e} with half of that")
    assert gaps[1] < 1e-4
    assert gaps[1] < gaps[0] / 8.0


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as name:
        main(Path(name))
