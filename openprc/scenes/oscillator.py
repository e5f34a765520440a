"""A mass on a spring, along one axis."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from openprc.scenes.closed_forms import released
from openprc.scenes.option_checks import check_range
from openprc.scenes.probes import angular_frequency, deviation_probe, path_of
from openprc.scenes.scene import Probe, Reference, Scene
from openprc.schema.experiment import Experiment
from openprc.schema.geometry import Bars, Geometry

if TYPE_CHECKING:
    from openprc.scenes.probes import Reals
    from openprc.schema.trajectory import Trajectory

LENGTH, MASS = 1.0, 1.0  # m, kg
LABELS = ("anchor", "mass")
#: Steps and frames in a period.
STEPS, FRAMES = 1000, 40


def check_spring(scene: str, *, frequency: float, amplitude: float, periods: int) -> None:
    """Refuse options that no spring of `LENGTH` has."""
    check_range(scene, {"frequency": frequency}, above=0.0)
    check_range(scene, {"amplitude": amplitude}, above=0.0, below=LENGTH)
    check_range(scene, {"periods": periods}, least=1)


def spring_experiment(
    *, frequency: float, amplitude: float, periods: int, dashpot: float = 0.0, drag: float = 0.0
) -> Experiment:
    """Return a mass that is let go `amplitude` [m] beside the end of its relaxed spring.

    Parameters
    ----------
    frequency : float [Hz]
        Without damping.
    amplitude : float [m]
    periods : int
        Of that frequency.
    dashpot : float [N*s/m]
        Along the spring.
    drag : float [kg/s]
        Of the mass in its surroundings.
    """
    period = 1.0 / frequency
    return Experiment(
        geometry=Geometry(
            positions=np.array([[0.0, 0.0, 0.0], [LENGTH + amplitude, 0.0, 0.0]]),
            masses=np.array([MASS, MASS]),
            fixed=np.array([True, False]),
            labels=LABELS,
            bars=Bars(
                indices=np.array([[0, 1]]),
                stiffness=np.array([MASS * (2.0 * math.pi * frequency) ** 2]),
                rest_length=np.array([LENGTH]),
                damping=np.array([dashpot]),
            ),
        ),
        duration=periods * period,
        dt=period / STEPS,
        save_interval=period / FRAMES,
        damping=drag,
    )


def along_the_spring(stretch: Reals) -> Reals:
    """Return positions (T, 2, 3) [m] of anchor and mass for stretches (T,) [m]."""
    x = np.zeros((len(stretch), 2, 3))
    x[:, 1, 0] = LENGTH + stretch
    return x


def build(*, frequency: float, amplitude: float, periods: int) -> Scene:
    """Return the undamped oscillator; options as in the record."""
    check_spring("oscillator", frequency=frequency, amplitude=amplitude, periods=periods)
    omega = 2.0 * math.pi * frequency

    def exact(times: Reals) -> Reals:
        return along_the_spring(amplitude * released(times, omega=omega))

    def measured(run: Trajectory) -> float:
        return angular_frequency(path_of(run, "mass")[:, 0] - LENGTH, run.dt) / (2.0 * math.pi)

    source = "x = L + a cos(w t), w = sqrt(k / m)"
    return Scene(
        name="oscillator",
        experiment=spring_experiment(frequency=frequency, amplitude=amplitude, periods=periods),
        reference=Reference(
            kind="closed form",
            text="a sinusoid of the frequency sqrt(k / m) / (2 pi), at every instant",
            source=source,
            exact=exact,
            probes=(
                Probe(
                    name="frequency",
                    value=frequency,
                    unit="Hz",
                    tolerance=1e-5,
                    measure=measured,
                    source=source,
                ),
                # A scheme of second order runs fast by (w h)^2 / 24.
                deviation_probe(
                    exact, LABELS, scale=amplitude, tolerance=1e-4 * periods, source=source
                ),
            ),
        ),
        scale=amplitude,
    )
