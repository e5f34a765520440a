"""Which integrators come into question for an accuracy, and what a step of each costs."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import TYPE_CHECKING

from openprc.demlat.contact.findings import can_touch
from openprc.demlat.integrators import INTEGRATORS, Integrator
from openprc.demlat.models.barhinge.rigid_assembly import stops
from openprc.demlat.models.barhinge.support import supports
from openprc.demlat.planning.run_cost import PEFRL_DAMPED, PER_BAR, PER_EVALUATION, PER_HINGE
from openprc.demlat.planning.stability import step_limit
from openprc.schema.experiment import AUTO

if TYPE_CHECKING:
    from openprc.schema.experiment import Experiment
    from openprc.schema.findings import Finding

#: CPU time of an evaluation, the arithmetic of its scheme included, over that of rk4.
#: `benchmarks/auto_accuracy.py --costs` measures them on a lattice of 342 bars and a folded sheet
#: of 408 bars and 360 hinges; these are the means.
EVALUATION_WORK = {"verlet": 1.6, "pefrl": 1.1, "rk4": 1.0, "rk45": 1.25, "dop853": 1.35}
#: Steps of rk4 that a step of midpoint, of rattle and of a stage of rk4-dae takes the time of.
IMPLICIT_EVALUATIONS = 75.0
CONSTRAINED_EVALUATIONS = 20.0
#: Implicit steps are considered from this many radians of the fastest mode on, and for no less
#: an error: a step then has to be far above what explicit schemes bear.
STIFF_RADIANS, IMPLICIT_ERROR = 1e4, 1e-4
#: Bars have to be this many times faster than hinges for an inner loop of their own.
SEPARATION = 8.0
#: As `openprc.demlat.integrators.respa.INNER_SHARE`, which is compiled code.
INNER_SHARE = 0.8
#: Errors from which on a pair of order 5 can beat one of order 8.
COARSE = 1e-5
#: Samples of signals are put on steps where this many steps in a frame do it.
MOST_ALIGNED = 64


@dataclass(frozen=True, kw_only=True)
class Eligible:
    """A scheme that may run the experiment.

    Attributes
    ----------
    scheme : Integrator
    coarsest : float [s]
        Largest step that is tried; of an adaptive scheme the first one.
    step_cost : float
        Of a fixed step, in evaluations of all forces by rk4; of an adaptive scheme, of one of
        its evaluations.
    damped : bool
        Whether anything but the scheme takes energy.
    inner_rate, inner_cost : float [1/s], [1]
        Of the inner steps that respa divides a step into: how many in a second, and what one
        costs.
    """

    scheme: Integrator
    coarsest: float
    step_cost: float
    damped: bool
    inner_rate: float = 0.0
    inner_cost: float = 0.0

    def cost(self, n_steps: int, h: float) -> float:
        """Return what fixed steps cost, in evaluations of all forces by rk4.

        Parameters
        ----------
        n_steps : int
        h : float [s]
        """
        inner = max(1, math.ceil(h * self.inner_rate)) if self.inner_cost else 0
        return n_steps * (self.step_cost + inner * self.inner_cost)

    @property
    def adaptive(self) -> bool:
        """Whether the scheme chooses its steps."""
        return self.scheme.step == "adaptive"


def with_scheme(experiment: Experiment, name: str) -> Experiment:
    """Return the experiment with that integrator and nothing that would refuse its step."""
    tolerance = None if experiment.accuracy is not None else experiment.tolerance
    return replace(
        experiment, integrator=name, accuracy=None, dt_stated=True, step_check="warn",
        tolerance=tolerance, notes=(),
    )  # fmt: skip


def representative(experiment: Experiment) -> tuple[Experiment, list[Finding]]:
    """Return the experiment with the first scheme that can run it, and what it refuses.

    For whoever wants to know whether an experiment runs at all, without choosing a step.
    """
    if experiment.integrator != AUTO:
        trial = replace(experiment, accuracy=None, dt_stated=True, step_check="warn")
        return trial, supports(trial)
    first: tuple[Experiment, list[Finding]] | None = None
    for name in ("rk4", "rk4-dae", "rattle", "rk4-projection"):
        trial = with_scheme(experiment, name)
        findings = supports(trial)
        if not any(finding.level == "error" for finding in findings):
            return trial, findings
        if first is None or len(findings) < len(first[1]):
            first = trial, findings
    assert first is not None  # noqa: S101 - the loop above runs
    return first


def eligible_schemes(experiment: Experiment, *, only: tuple[str, ...] = ()) -> list[Eligible]:
    """Return the schemes that may run the experiment, the likely ones first.

    Parameters
    ----------
    experiment : Experiment
        Whose `accuracy` is set; a named integrator is the only one.
    only : tuple of str, optional
        Names, where a back end knows no others.
    """
    stated = experiment.integrator
    names = _likely(experiment) if stated == AUTO else [stated]
    found = []
    for name in names:
        if only and name not in only:
            continue
        trial = with_scheme(experiment, name)
        if any(finding.level == "error" for finding in supports(trial)):
            continue
        limit = step_limit(trial)
        if stated == AUTO and not _sensible(trial, limit.damped, limit.omega):
            continue
        scheme = INTEGRATORS[name]
        coarsest = limit.recommended
        inner: dict[str, float] = {}
        if name == "respa":
            inner = _inner_steps(trial)
        inner.setdefault("step_cost", _step_cost(scheme, damped=limit.damped))
        coarsest = min(coarsest, experiment.save_interval)
        found.append(Eligible(scheme=scheme, coarsest=coarsest, damped=limit.damped, **inner))
    return found


def _inner_steps(trial: Experiment) -> dict[str, float]:
    """Return the costs of an outer step of respa, in evaluations of all forces."""
    geometry = trial.geometry
    n_hinges = len(geometry.hinges) + len(geometry.bends)
    whole = PER_EVALUATION + PER_BAR * len(geometry.bars) + PER_HINGE * n_hinges
    omega = step_limit(with_scheme(trial, "verlet")).omega
    return {
        "step_cost": (PER_EVALUATION + PER_HINGE * n_hinges) / whole,
        "inner_cost": (PER_EVALUATION + PER_BAR * len(geometry.bars)) / whole,
        "inner_rate": omega / (2.0 * INNER_SHARE),
    }


def _likely(experiment: Experiment) -> list[str]:
    accuracy = experiment.accuracy or 1.0
    geometry = experiment.geometry
    if stops(geometry).any():
        return ["rk4-projection"]  # which costs order: only where nothing else can do it
    if geometry.bars.rigid.any() or geometry.hinges.rigid.any():
        names = ["rk4-dae", "rattle"]
        return names if accuracy < 1e-3 else names[::-1]
    if can_touch(experiment):
        return ["rk4", "verlet", "pefrl"]
    names = ["dop853", "rk45", "pefrl", "rk4", "verlet", "respa", "midpoint"]
    if accuracy < COARSE:
        names.remove("rk45")
    if accuracy < IMPLICIT_ERROR:
        names.remove("midpoint")
    return names


def _sensible(trial: Experiment, damped: bool, omega: float) -> bool:
    """Leave out what the scheme is not made for, though it would run."""
    name, geometry = trial.integrator, trial.geometry
    if name == "pefrl":
        return not damped  # its kicks take four stages each, with damping
    if name == "midpoint":
        wanted = trial.duration * omega > STIFF_RADIANS
        return wanted and trial.save_interval * omega > 2.0 * IMPLICIT_EVALUATIONS
    if name == "respa":
        if not damped or not (len(geometry.hinges) or len(geometry.bends)):
            return False
        fast = step_limit(with_scheme(trial, "verlet")).omega
        return step_limit(trial).limit * fast > 2.0 * SEPARATION
    return True


def _step_cost(scheme: Integrator, *, damped: bool) -> float:
    work = EVALUATION_WORK.get(scheme.name, 1.0)
    if scheme.step == "adaptive":
        return work
    if scheme.name == "midpoint":
        return IMPLICIT_EVALUATIONS
    if scheme.rigid != "no":
        return CONSTRAINED_EVALUATIONS * scheme.stages
    stages = scheme.stages * (PEFRL_DAMPED if damped and scheme.name == "pefrl" else 1)
    return work * stages


def steps_unit(experiment: Experiment) -> int:
    """Return what the number of steps in a frame has to be a multiple of.

    So that samples of signals, where the drive has kinks or jumps, fall on steps.
    """
    unit = 1
    for name in dict.fromkeys(actuator.signal for actuator in experiment.actuators):
        signal = experiment.signals[name]
        if signal.interpolation == "cubic" or len(signal.values) < 2:
            continue
        ratio = Fraction(signal.dt / experiment.save_interval).limit_denominator(10_000)
        if abs(float(ratio) * experiment.save_interval / signal.dt - 1.0) > 1e-9:
            continue
        # steps * dt_signal / frame has to be whole.
        together = math.lcm(unit, ratio.denominator)
        unit = together if together <= MOST_ALIGNED else unit
    return unit
