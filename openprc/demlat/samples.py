"""A small driven lattice that computes: the sample of this producer.

Sixteen nodes in a plane, each tied to its neighbours by springs along sides and diagonals. The
left column is fixed; a force at one corner takes a new random value every `HOLD`. The force is
large enough to bend the lattice far (nonlinearity), and its slowest modes outlast a symbol
(memory), so that a linear readout of the positions imitates NARMA2 with about a third of the
error of a linear shift register.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from openprc.demlat.setup import SimulationSetup
from openprc.hooks.protocols import Sample

SIDE = 4
SPACING = 0.1  # m
MASS = 0.01  # kg
STIFFNESS = 6.0  # N/m, spread by 30 % either way
BAR_DAMPING = 0.02  # N*s/m
NODE_DAMPING = 0.15  # kg/s
N_SYMBOLS = 600
HOLD = 0.15  # s
FRAMES_PER_SYMBOL = 5
DT = 0.003  # s


def symbols() -> NDArray[np.float64]:
    """Return the force [N] in every symbol, (K,): independent, uniform in [0, 0.5]."""
    return np.random.default_rng(2024).uniform(0.0, 0.5, N_SYMBOLS)


def lattice_bars() -> list[tuple[int, int]]:
    """Return the pairs of nodes that are tied; node ``SIDE * column + row``."""
    number = np.arange(SIDE * SIDE).reshape(SIDE, SIDE)
    runs = (
        (number[:-1], number[1:]),
        (number[:, :-1], number[:, 1:]),
        (number[:-1, :-1], number[1:, 1:]),
        (number[1:, :-1], number[:-1, 1:]),
    )
    return [(int(i), int(j)) for one, two in runs for i, j in zip(one.flat, two.flat, strict=True)]


def write_sample(folder: Path) -> Sample:
    """Write the experiment into `folder` and say how to run it.

    The result takes `N_SYMBOLS` times `HOLD` of simulated time; every symbol ends on a frame.
    """
    setup = SimulationSetup(folder, overwrite=True)
    for column in range(SIDE):
        for row in range(SIDE):
            setup.add_node(
                [SPACING * column, SPACING * row],
                mass=MASS,
                fixed=column == 0,
                label=f"c{column}r{row}",
            )
    spread = np.random.default_rng(1)
    for i, j in lattice_bars():
        setup.add_bar(i, j, stiffness=STIFFNESS * spread.uniform(0.7, 1.3), damping=BAR_DAMPING)
    setup.add_signal("force", symbols(), dt=HOLD, interpolation="hold", unit="N")
    setup.add_actuator(setup.n_nodes - 1, "force", type="force", axes=[False, True, False])
    setup.set_physics(gravity=0.0, damping=NODE_DAMPING)
    setup.set_simulation_params(
        duration=N_SYMBOLS * HOLD, dt=DT, save_interval=HOLD / FRAMES_PER_SYMBOL
    )
    setup.save()
    return Sample(path=Path(folder))
