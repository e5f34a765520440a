"""How large the error of a run is: a stretch of it, repeated more finely."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from openprc.demlat.integrators import Settings, find_integrator
from openprc.demlat.models.barhinge.support import supports
from openprc.demlat.planning.accuracy_growth import grown
from openprc.demlat.planning.accuracy_pilot import Pilot, error_curve, make_window
from openprc.demlat.planning.accuracy_schemes import eligible_schemes
from openprc.demlat.planning.run_cost import run_cost
from openprc.demlat.planning.stability import step_limit
from openprc.errors import ConfigError
from openprc.hooks.running import refuse_unsupported

if TYPE_CHECKING:
    from openprc.schema.experiment import Experiment

#: Share of the run that is repeated, and the fewest frames.
STRETCH, LEAST_FRAMES = 0.1, 32
#: A run that takes less time than this by the cost constants [s] is repeated as a whole.
QUICK = 0.5
#: What a tolerance is divided by, where a step would be halved.
TIGHTER = 100.0


@dataclass(frozen=True, kw_only=True)
class ErrorEstimate:
    """The error of a run by an estimate of its own.

    Attributes
    ----------
    error : float [1]
        Expected at the end of the run, relative to the rms displacement.
    stretch_error : float [1]
        On the stretch that was repeated.
    stretch, duration : float [s]
    """

    error: float
    stretch_error: float
    stretch: float
    duration: float

    @property
    def note(self) -> str:
        """What stands in the file of the run."""
        if self.stretch >= self.duration * (1.0 - 1e-9):
            return (
                f"verified: the error of the run is about {self.error:.1e} of the rms displacement"
            )
        return (
            f"verified: the error is about {self.stretch_error:.1e} of the rms displacement over"
            f" the first {self.stretch:.3g} s, and {self.error:.1e} at the end if it grows on"
        )

    def as_dict(self) -> dict[str, Any]:
        """Return plain data, for JSON."""
        return {
            "error": self.error,
            "stretch_error": self.stretch_error,
            "stretch": self.stretch,
            "duration": self.duration,
        }


def estimate_error(experiment: Experiment) -> ErrorEstimate:
    """Estimate the error of a run by repeating its beginning with half the step.

    The difference of a step h and of h / 2 is ``1 - 2^-p`` of the error of h, where p is the order
    (Richardson 1911, doi:10.1098/rsta.1911.0009). A tolerance is divided by 100 instead.

    Parameters
    ----------
    experiment : Experiment
        Without an accuracy: integrator and step are those that are judged.

    Raises
    ------
    ConfigError
        When a run breaks down on that stretch, or the integrator repeats old runs.
    UnsupportedScene
        When the engine cannot model the experiment.
    """
    scheme = find_integrator(experiment.integrator)
    if scheme.step == "legacy":
        raise ConfigError(
            "an error estimate for the integrator 'legacy', which repeats old runs",
            expected="an integrator that follows the motion",
            fix="leave verify out",
            key="simulation.integrator",
        )
    refuse_unsupported(supports(experiment), producer="demlat")
    eligible = eligible_schemes(experiment)[0]
    wanted = max(STRETCH * experiment.duration, LEAST_FRAMES * experiment.save_interval)
    if run_cost(experiment, step_limit(experiment)).seconds < QUICK:
        wanted = experiment.duration
    window = make_window(experiment, wanted=min(wanted, experiment.duration))
    pilot = Pilot(experiment, window, most=math.inf)
    if scheme.step == "adaptive":
        tolerance = experiment.tolerance or Settings._field_defaults["tolerance"]
        least = 10.0 * float(np.finfo(experiment.precision).eps)
        coarse = pilot.adaptive(eligible, tolerance)
        fine = pilot.adaptive(eligible, max(tolerance / TIGHTER, least))
        share = 1.0
    else:
        steps = experiment.steps_per_frame
        steps += -steps % window.parts
        coarse, fine = pilot.fixed(eligible, steps), pilot.fixed(eligible, 2 * steps)
        share = 1.0 - 0.5**scheme.order
    if coarse.failed or fine.failed:
        raise ConfigError(
            f"the run breaks down within its first {window.duration:.3g} s",
            expected="a motion that can be repeated more finely",
            fix="run it without verify: the message then says where",
            key="simulation.dt",
        )
    curve = error_curve(coarse.positions, fine.positions) / share
    times = max(experiment.duration / window.duration, 1.0)
    return ErrorEstimate(
        error=grown(curve, times, damped=eligible.damped),
        stretch_error=float(curve.max()),
        stretch=window.duration,
        duration=experiment.duration,
    )


def verified(experiment: Experiment) -> Experiment:
    """Return the experiment with a note that says how large the error of its run is."""
    return replace(experiment, notes=(*experiment.notes, estimate_error(experiment).note))
