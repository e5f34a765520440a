"""Shake a Miura sheet at its base with random symbols and see which folds follow.

python examples/03_origami_mesh.py
"""

from __future__ import annotations

import math
import tempfile
from pathlib import Path

import numpy as np

from openprc import demlat
from openprc.demlat import BarHingeModel, SimulationSetup
from openprc.demlat.meshing import miura_sheet
from openprc.demlat.observables import hinge_angles
from openprc.demlat.signals import held_symbols
from openprc.schema import Trajectory

HOLD, N_SYMBOLS = 0.1, 20  # s


def main(folder: Path) -> None:
    """Build the sheet, drive its left edge, simulate, and print how the folds moved."""
    mesh = miura_sheet(2, 3, a=0.03, b=0.03, sector_angle=math.pi / 3, tilt=math.pi / 4)
    setup = SimulationSetup(folder / "miura", overwrite=True)
    nodes = mesh.to_setup(
        setup,
        mass=mesh.lumped_masses(0.5),
        stiffness=2000.0,
        damping=0.02,
        # Per metre of crease: the panels are a hundred times stiffer than the folds.
        hinge_stiffness=mesh.hinge_values({"fold": 2e-3, "facet": 0.2}) * mesh.crease_lengths,
        hinge_damping=1e-6,
    )
    drive = held_symbols(
        N_SYMBOLS, HOLD, np.random.default_rng(1), low=-1e-3, high=1e-3, rise=HOLD / 2, dt=1e-3
    )
    for node in nodes[mesh.node_sets["left"]]:
        start = mesh.positions[node - nodes[0]]
        name = drive.along([1.0, 0.0, 0.0], start=start).add_to(setup, f"base {node}", unit="m")
        setup.add_actuator(node, name, type="position")
    setup.set_physics(damping=1e-3)
    setup.set_simulation_params(duration=N_SYMBOLS * HOLD, dt=1e-4, save_interval=0.01)
    setup.save()

    run = demlat.Engine(BarHingeModel).run(setup.directory)
    with Trajectory(run.path) as file:
        x = file.positions()
    moved = np.linalg.norm(x - x[0], axis=2).max(axis=0)
    right, left = moved[mesh.node_sets["right"]], moved[mesh.node_sets["left"]]
    bend = np.ptp(hinge_angles(x, setup.geometry().hinges), axis=0)
    print(f"{mesh.n_nodes} nodes, {len(mesh.bars)} bars, {len(mesh.hinges)} hinges")
    print(f"symbols {len(drive.sequence)}, frames {len(x)}")
    print(f"largest motion: base {1e3 * left.max():.2f} mm, free end {1e3 * right.max():.2f} mm")
    for kind in ("fold", "facet"):
        degrees = np.degrees(bend[mesh.hinge_kinds == kind]).mean()
        print(f"{kind}s turn {degrees:.2f} degrees on average")
    assert np.isfinite(x).all()
    assert left.max() <= 1.01e-3
    assert bend[mesh.hinge_kinds == "fold"].mean() > bend[mesh.hinge_kinds == "facet"].mean()


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as name:
        main(Path(name))
