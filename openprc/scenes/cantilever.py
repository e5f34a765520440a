"""A clamped chain of bars and bends that settles under a force at its tip."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from openprc.scenes.closed_forms import cantilever_deflection
from openprc.scenes.option_checks import check_range
from openprc.scenes.probes import path_of
from openprc.scenes.scene import Probe, Reference, Scene
from openprc.schema.experiment import Actuator, Experiment, Signal
from openprc.schema.geometry import Bars, Bends, Geometry

if TYPE_CHECKING:
    from openprc.schema.trajectory import Trajectory

LENGTH, RADIUS, DENSITY, MODULUS = 1.0, 0.02, 1000.0, 1e6  # m, m, kg/m3, Pa
AREA = math.pi * RADIUS**2
RIGIDITY = MODULUS * math.pi * RADIUS**4 / 4.0  # N m2
INTERVAL = 0.5  # s
#: Rate of the drag [1/s]: twice the lowest frequency, so that the beam comes to rest soonest.
DECAY = 2.5


def build(*, n: int, force: float, duration: float) -> Scene:
    """Return the cantilever; options as in the record."""
    # The first segment is clamped.
    check_range("cantilever", {"n": n}, least=2)
    check_range("cantilever", {"force": force}, above=0.0)
    check_range("cantilever", {"duration": duration}, least=20.0)
    link = LENGTH / n
    masses = np.full(n + 1, DENSITY * AREA * link)
    masses[[0, -1]] *= 0.5
    first = np.arange(n, dtype="i4")
    labels = tuple(f"node{i}" for i in range(n))
    # Bars and bends: waves along the bars, and bending at the shortest wavelength.
    fastest = max(
        2.0 / link * math.sqrt(MODULUS / DENSITY),
        4.0 / link**2 * math.sqrt(RIGIDITY / (DENSITY * AREA)),
    )
    steps = math.ceil(INTERVAL * fastest / 0.35)
    deflection = cantilever_deflection(force=force, length=LENGTH, rigidity=RIGIDITY, segments=n)
    slope = 1.5 * deflection / LENGTH

    def tip(run: Trajectory) -> float:
        return float(-path_of(run, "tip")[-1, 2])

    def restless(run: Trajectory) -> float:
        height = path_of(run, "tip")[run.time >= run.time[-1] - 2.0 - 1e-9, 2]
        return float(np.ptp(height)) / abs(deflection)

    source = "F L^3 / (3 E I) (1 - 3 / (2 n) + 1 / (2 n^2))"
    return Scene(
        name="cantilever",
        experiment=Experiment(
            geometry=Geometry(
                positions=np.stack(
                    [link * np.arange(n + 1.0), np.zeros(n + 1), np.zeros(n + 1)], axis=1
                ),
                masses=masses,
                fixed=np.arange(n + 1) < 2,
                labels=(*labels, "tip"),
                bars=Bars(
                    indices=np.stack([first, first + 1], axis=1),
                    stiffness=np.full(n, MODULUS * AREA / link),
                    rest_length=np.full(n, link),
                ),
                bends=Bends(
                    indices=np.stack([first[:-1], first[:-1] + 1, first[:-1] + 2], axis=1),
                    stiffness=np.full(n - 1, RIGIDITY / link),
                ),
            ),
            signals={
                "tip force": Signal(
                    name="tip force", values=np.array([-force]), dt=duration, unit="N",
                    interpolation="hold",
                )
            },
            actuators=(
                Actuator(node=n, signal="tip force", type="force", axes=(False, False, True)),
            ),
            duration=math.ceil(duration / INTERVAL - 1e-9) * INTERVAL,
            dt=INTERVAL / steps,
            save_interval=INTERVAL,
            damping=DECAY * float(masses.mean()),
            integrator="verlet",
        ),
        reference=Reference(
            kind="closed form",
            text="the deflection under a small load of a chain of segments that turn at nodes; the"
            f" slope of {abs(slope):.1e} makes it less by about the square of that",
            source=source,
            probes=(
                Probe(
                    name="deflection of the tip",
                    value=deflection,
                    unit="m",
                    tolerance=2e-4 + slope**2,
                    measure=tip,
                    source=source,
                ),
                Probe(
                    name="motion of the tip in the last 2 s, over its deflection",
                    value=0.0,
                    unit="1",
                    tolerance=1e-5,
                    measure=restless,
                    source="at rest",
                ),
            ),
        ),
        scale=abs(deflection),
        quasi_static=False,
    )  # fmt: skip
