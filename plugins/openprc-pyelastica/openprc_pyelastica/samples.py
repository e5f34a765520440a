"""Small runs for the demo and the tests: a recording that is shipped, and a body to run."""

from __future__ import annotations

import math
import shutil
from pathlib import Path

import numpy as np

from openprc.hooks import Sample
from openprc.schema.experiment import Actuator, Experiment, Signal
from openprc.schema.geometry import Bars, Bends, Geometry

RECORDED = Path(__file__).parent / "data" / "driven_cantilever.npz"

#: Duration of one symbol of the shipped run [s].
HOLD = 0.2


def write_sample(folder: Path) -> Sample:
    """Copy the shipped run into `folder`.

    It is a clamped, hanging rod of 10 elements, pushed sideways at its middle by 600 random
    symbols; ``record_sample.py`` beside the package made it with PyElastica 1.0.0. Symbol k acts
    during [k hold, (k + 1) hold), and frame k is one simulation step (0.5 ms) before the end of
    that. There is no frame at t = 0.

    Returns
    -------
    Sample
        ``inputs["u"]["sequence"]`` has shape (600, 1). The file also holds the symbol beside
        each sample; the importer is told to leave that one alone, and that nothing moves along
        y.
    """
    path = Path(folder) / RECORDED.name
    shutil.copyfile(RECORDED, path)
    with np.load(RECORDED, allow_pickle=False) as arrays:
        symbols = arrays["u"][:, np.newaxis]
    drive = {
        "sequence": symbols,
        "hold": HOLD,
        "start": 0.0,
        "unit": "1",
        "quantity": "force",
    }
    return Sample(path, options={"input": "none", "plane": "xz"}, inputs={"u": drive})


def driven_chain(*, n_elements: int = 6, n_symbols: int = 60, hold: float = 0.1) -> Experiment:
    """Return an experiment that the runner models: a soft chain that hangs and is pushed.

    It is the body of the shipped run with fewer elements: 0.3 m long, 10 mm thick, clamped at its
    upper end, damped with 4/s, and pushed sideways at its middle by a new random force every
    `hold` seconds.
    """
    length, radius, density, modulus = 0.3, 0.01, 1000.0, 1e5
    area, element = math.pi * radius**2, length / n_elements
    node = np.arange(n_elements + 1)
    positions = np.zeros((n_elements + 1, 3))
    positions[:, 2] = -element * node
    masses = np.full(n_elements + 1, density * area * element)
    masses[[0, -1]] /= 2.0
    inner = node[:-2]
    geometry = Geometry(
        positions=positions,
        masses=masses,
        fixed=node < 2,
        bars=Bars(
            indices=np.stack([node[:-1], node[1:]], axis=1),
            stiffness=np.full(n_elements, modulus * area / element),
            rest_length=np.full(n_elements, element),
        ),
        bends=Bends(
            indices=np.stack([inner, inner + 1, inner + 2], axis=1),
            stiffness=np.full(n_elements - 1, modulus * area * radius**2 / 4.0 / element),
        ),
    )
    symbols = np.random.default_rng(1).uniform(-0.15, 0.15, n_symbols)
    push = Signal(name="push", values=symbols, dt=hold, interpolation="hold", unit="N")
    axes = (True, False, False)
    return Experiment(
        geometry=geometry,
        signals={"push": push},
        actuators=(Actuator(node=n_elements // 2, signal="push", type="force", axes=axes),),
        duration=hold * n_symbols,
        dt=5e-4,
        save_interval=hold / 4.0,
        integrator="verlet",
        gravity=(0.0, 0.0, -9.80665),
        damping=4.0 * float(masses.mean()),
    )
