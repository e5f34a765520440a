"""A square lattice of springs that a random force shakes at a corner: a reservoir for tasks."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from openprc.scenes.converged import converged_motion
from openprc.scenes.option_checks import check_range
from openprc.scenes.probes import deviation_probe
from openprc.scenes.scene import Reference, Scene
from openprc.schema.experiment import Actuator, Experiment, Signal
from openprc.schema.geometry import Bars, Geometry

if TYPE_CHECKING:
    from numpy.typing import NDArray

SPACING, MASS = 0.1, 0.01  # m, kg
BAR_DAMPING, DRAG = 0.02, 0.15  # N*s/m, kg/s
#: Stiffnesses are spread by so much either way, so that no two modes are alike.
SPREAD = 0.3
HOLD, FRAMES_PER_SYMBOL = 0.15, 5  # s
#: How many symbols the reference is compared over.
CHECKED = 10


def tied_nodes(side: int) -> NDArray[np.int32]:
    """Return pairs of nodes along sides and both diagonals; node ``side * column + row``."""
    number = np.arange(side * side, dtype="i4").reshape(side, side)
    runs = (
        (number[:-1], number[1:]),
        (number[:, :-1], number[:, 1:]),
        (number[:-1, :-1], number[1:, 1:]),
        (number[1:, :-1], number[:-1, 1:]),
    )
    return np.concatenate([np.stack([i.ravel(), j.ravel()], axis=1) for i, j in runs])


def build(*, side: int, n_symbols: int, stiffness: float, strength: float, seed: int) -> Scene:
    """Return the lattice; options as in the record."""
    check_range("spring-lattice", {"side": side}, least=2)
    check_range("spring-lattice", {"n_symbols": n_symbols}, least=1)
    check_range("spring-lattice", {"seed": seed}, least=0)
    check_range("spring-lattice", {"stiffness": stiffness, "strength": strength}, above=0.0)
    rng = np.random.default_rng(seed)
    bars = tied_nodes(side)
    column, row = np.divmod(np.arange(side * side), side)
    positions = SPACING * np.stack([column, row, np.zeros_like(row)], axis=1).astype("f8")
    lengths = np.linalg.norm(positions[bars[:, 1]] - positions[bars[:, 0]], axis=1)
    springs = stiffness * rng.uniform(1.0 - SPREAD, 1.0 + SPREAD, len(bars))
    symbols = strength * rng.uniform(0.0, 0.5, n_symbols)
    labels = tuple(f"c{c}r{r}" for c, r in zip(column.tolist(), row.tolist(), strict=True))
    interval = HOLD / FRAMES_PER_SYMBOL
    # Eight springs a node: the fastest mode is below sqrt(2 * 8 k / m).
    omega = math.sqrt(16.0 * (1.0 + SPREAD) * stiffness / MASS)
    experiment = Experiment(
        geometry=Geometry(
            positions=positions,
            masses=np.full(side * side, MASS),
            fixed=column == 0,
            labels=labels,
            bars=Bars(
                indices=bars,
                stiffness=springs,
                rest_length=lengths,
                damping=np.full(len(bars), BAR_DAMPING),
            ),
        ),
        signals={
            "force": Signal(name="force", values=symbols, dt=HOLD, interpolation="hold", unit="N")
        },
        actuators=(
            Actuator(node=side * side - 1, signal="force", type="force", axes=(False, True, False)),
        ),
        duration=n_symbols * HOLD,
        dt=interval / math.ceil(interval * omega / 0.4),
        save_interval=interval,
        damping=DRAG,
    )
    exact = converged_motion(experiment)
    # What the force stretches in a column of springs: the size of the motion.
    scale = 0.25 * strength * side / stiffness
    return Scene(
        name="spring-lattice",
        experiment=experiment,
        reference=Reference(
            kind="converged",
            text=f"compared over the first {min(CHECKED, n_symbols)} symbols; the body forgets"
            " its past within about as many",
            source="SciPy's DOP853 to 1e-11 from jump to jump of the force",
            exact=exact,
            probes=(
                deviation_probe(
                    exact,
                    labels,
                    scale=scale,
                    tolerance=1e-3,
                    source="DOP853",
                    until=min(CHECKED, n_symbols) * HOLD,
                ),
            ),
        ),
        scale=scale,
        input_name="force",
    )
