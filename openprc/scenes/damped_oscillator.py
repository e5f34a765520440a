"""A mass on a spring with a dashpot along it, or in a viscous medium."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from openprc.scenes.closed_forms import released
from openprc.scenes.option_checks import check_range
from openprc.scenes.oscillator import (
    LABELS,
    LENGTH,
    MASS,
    along_the_spring,
    check_spring,
    spring_experiment,
)
from openprc.scenes.probes import at_time, deviation_probe, path_of
from openprc.scenes.scene import Probe, Reference, Scene

if TYPE_CHECKING:
    from openprc.scenes.probes import Reals
    from openprc.schema.trajectory import Trajectory


def build(*, frequency: float, amplitude: float, periods: int, ratio: float, where: str) -> Scene:
    """Return the damped oscillator; options as in the record."""
    check_spring("damped-oscillator", frequency=frequency, amplitude=amplitude, periods=periods)
    # Far beyond critical damping the steps, which are parts of a period, would be too long.
    check_range("damped-oscillator", {"ratio": ratio}, least=0.0, most=50.0)
    omega = 2.0 * math.pi * frequency
    coefficient = 2.0 * ratio * MASS * omega

    def stretch(times: Reals) -> Reals:
        return amplitude * released(times, omega=omega, decay=ratio * omega)

    def exact(times: Reals) -> Reals:
        return along_the_spring(stretch(times))

    period = 1.0 / frequency

    def measured(run: Trajectory) -> float:
        return float(at_time(run, path_of(run, "mass")[:, 0], time=period) - LENGTH)

    source = "m x'' + c x' + k (x - L) = 0 from rest, c = 2 zeta sqrt(k m)"
    return Scene(
        name="damped-oscillator",
        experiment=spring_experiment(
            frequency=frequency,
            amplitude=amplitude,
            periods=periods,
            dashpot=coefficient if where == "bar" else 0.0,
            drag=coefficient if where == "medium" else 0.0,
        ),
        reference=Reference(
            kind="closed form",
            text="a decaying sinusoid below the damping ratio 1, two exponentials above",
            source=source,
            exact=exact,
            probes=(
                Probe(
                    name="stretch after one undamped period",
                    value=float(stretch(np.array([period]))[0]),
                    unit="m",
                    tolerance=1e-3,
                    measure=measured,
                    source=source,
                ),
                deviation_probe(exact, LABELS, scale=amplitude, tolerance=1e-4, source=source),
            ),
        ),
        scale=amplitude,
    )
