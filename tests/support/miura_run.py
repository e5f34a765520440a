"""A Miura-ori sheet of the native engine, shaken at its base, where the paper keeps it."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from openprc import demlat
from openprc.demlat import BarHingeModel, SimulationSetup, meshing, signals

HOLD, DURATION, DT, SAVE = 0.05, 25.0, 5e-4, 0.01  # s
#: Frequencies [Hz] of the smooth drive of Hauser et al. 2011, doi:10.1007/s00422-012-0471-0.
FREQUENCIES = (2.11, 3.73, 4.33)


def write_miura_run(folder: Path, *, smooth: bool = False) -> Path:
    """Simulate the sheet and return the path of its simulation.h5.

    The left edge moves in z with held random symbols, or with a product of three sines.
    """
    mesh = meshing.miura_sheet(4, 4, a=0.03, b=0.03, sector_angle=math.pi / 3, tilt=math.pi / 4)
    setup = SimulationSetup(folder, overwrite=True)
    nodes = mesh.to_setup(
        setup,
        mass=mesh.lumped_masses(0.5),
        stiffness=200.0,
        damping=0.05,
        hinge_stiffness=mesh.hinge_values({"fold": 2e-3, "facet": 0.2}) * mesh.crease_lengths,
        hinge_damping=1e-6,
    )
    if smooth:
        t = np.arange(int(DURATION / DT) + 1) * DT
        heave = 2e-3 * np.prod([np.sin(2 * math.pi * f * t) for f in FREQUENCIES], axis=0)
    else:
        drive = signals.held_symbols(
            int(DURATION / HOLD),
            HOLD,
            np.random.default_rng(1),
            low=-2e-3,
            high=2e-3,
            rise=0.4 * HOLD,
            dt=DT,
        )
    for node in nodes[mesh.node_sets["left"]]:
        start = mesh.positions[node - nodes[0]]
        if smooth:
            path = np.tile(start, (len(heave), 1))
            path[:, 2] += heave
            name = f"base {node}"
            setup.add_signal(name, path, dt=DT, unit="m")
        else:
            name = drive.along([0.0, 0.0, 1.0], start=start).add_to(setup, f"base {node}", unit="m")
        setup.add_actuator(node, name, type="position")
    setup.set_physics(gravity=0.0, damping=5e-3)
    setup.set_simulation_params(duration=DURATION, dt=DT, save_interval=SAVE)
    setup.save()
    return demlat.Engine(BarHingeModel).run(demlat.Simulation(folder)).path
