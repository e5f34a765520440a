"""A point mass on a stiff or rigid bar, swinging far."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from openprc.scenes.closed_forms import GRAVITY, pendulum_angle, pendulum_period
from openprc.scenes.option_checks import check_range
from openprc.scenes.probes import deviation_probe, path_of, period_of_crossings
from openprc.scenes.scene import Probe, Reference, Scene
from openprc.schema.experiment import Experiment
from openprc.schema.geometry import Bars, Geometry

if TYPE_CHECKING:
    from openprc.scenes.probes import Reals
    from openprc.schema.trajectory import Trajectory

MASS = 0.1  # kg
LABELS = ("pivot", "bob")
DT, INTERVAL = 5e-4, 0.02  # s


def build(*, angle: float, length: float, stiffness: float, duration: float, rigid: bool) -> Scene:
    """Return the pendulum; options as in the record."""
    check_range("pendulum", {"angle": angle}, above=0.0, below=math.pi)
    sizes = {"length": length, "stiffness": stiffness, "duration": duration}
    check_range("pendulum", sizes, above=0.0)
    rate = math.sqrt(GRAVITY / length)
    period = pendulum_period(start=angle, rate=rate)
    # How much the bar gives, in lengths: the bob pulls with m g (3 - 2 cos(angle)) at the bottom.
    stretch = 0.0 if rigid else MASS * GRAVITY * (3.0 - 2.0 * math.cos(angle)) / stiffness / length

    def exact(times: Reals) -> Reals:
        swing = pendulum_angle(times, start=angle, rate=rate)
        x = np.zeros((len(times), 2, 3))
        x[:, 1, 0], x[:, 1, 2] = length * np.sin(swing), -length * np.cos(swing)
        return x

    def measured(run: Trajectory) -> float:
        return period_of_crossings(run.time, path_of(run, "bob")[:, 0])

    source = "period 4 K(sin(a / 2)) sqrt(L / g), https://dlmf.nist.gov/22.19"
    experiment = Experiment(
        geometry=Geometry(
            positions=exact(np.zeros(1))[0],
            masses=np.full(2, MASS),
            fixed=np.array([True, False]),
            labels=LABELS,
            bars=Bars(
                indices=np.array([[0, 1]]),
                stiffness=np.array([stiffness]),
                rest_length=np.array([length]),
                rigid=np.array([rigid]),
            ),
        ),
        duration=math.ceil(duration / INTERVAL) * INTERVAL,
        dt=DT,
        save_interval=INTERVAL,
        gravity=(0.0, 0.0, -GRAVITY),
        integrator="rk4-dae" if rigid else "rk4",
    )
    turns = experiment.duration / period
    return Scene(
        name="pendulum",
        experiment=experiment,
        reference=Reference(
            kind="closed form",
            text="the elliptic function of a rigid pendulum"
            + ("" if rigid else f"; the bar gives by up to {stretch:.1e} of its length"),
            source=source,
            exact=exact,
            probes=(
                *(
                    (
                        Probe(
                            name="period",
                            value=period,
                            unit="s",
                            tolerance=1e-6 + stretch,
                            measure=measured,
                            source=source,
                        ),
                    )
                    if turns >= 2.0
                    else ()
                ),
                deviation_probe(
                    exact,
                    LABELS,
                    scale=length,
                    tolerance=1e-5 + 4.0 * stretch * (1.0 + turns),
                    source=source,
                ),
            ),
        ),
        scale=length,
    )
