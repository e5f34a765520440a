"""How long a step every integrator that fits a scene could take, and what a run would cost."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any

from openprc.demlat.integrators import INTEGRATORS, Integrator
from openprc.demlat.models.barhinge.rigid_assembly import stops
from openprc.demlat.models.barhinge.support import supports
from openprc.demlat.planning.run_cost import RunCost, run_cost
from openprc.demlat.planning.stability import StepLimit, Verdict, step_limit

if TYPE_CHECKING:
    from openprc.schema.experiment import Experiment


@dataclass(frozen=True, kw_only=True)
class SchemeStep:
    """What one integrator could do with a scene.

    Attributes
    ----------
    integrator : str
    order : int
    limit : float or None [s]
        Largest stable step; None where no step is too large.
    set_by : str or None
        Element or node that sets it.
    recommended : float or None [s]
        Largest step that is recommended and divides the time between frames; None where the
        scheme chooses its steps.
    verdict : {"fine", "dissipative", "marginal", "unstable"} or None
        Of the step that the scene has now; None where an accuracy stands in its place.
    cost : RunCost
        Of a run with the recommended step.
    use : str
        When to choose it.
    """

    integrator: str
    order: int
    limit: float | None
    set_by: str | None
    recommended: float | None
    verdict: Verdict | None
    cost: RunCost
    use: str

    def as_dict(self) -> dict[str, Any]:
        """Return plain data, for JSON."""
        return asdict(self)


def scheme_steps(experiment: Experiment) -> tuple[SchemeStep, ...]:
    """Return a line for every integrator that can run `experiment` and is made for its kind.

    Schemes for rigid elements and stops are left out where there are none.
    """
    known: dict[str, StepLimit] = {}
    lines = []
    for scheme in INTEGRATORS.values():
        if not _is_meant(scheme, experiment):
            continue
        trial = replace(experiment, integrator=scheme.name, step_check="warn")
        if any(finding.level == "error" for finding in supports(trial)):
            continue
        # What bounds a step is the same for schemes of one kind; finding it is the work.
        kind = scheme.name if scheme.name == "respa" else f"{scheme.stability} {scheme.step}"
        if kind not in known:
            known[kind] = step_limit(trial)
        lines.append(_line(trial, scheme, replace(known[kind], scheme=scheme.name)))
    return tuple(lines)


def _is_meant(scheme: Integrator, experiment: Experiment) -> bool:
    geometry = experiment.geometry
    constrained = geometry.bars.rigid.any() or geometry.hinges.rigid.any() or stops(geometry).any()
    if scheme.step == "legacy":
        return False
    return scheme.rigid != "no" if constrained else scheme.rigid == "no"


def _line(experiment: Experiment, scheme: Integrator, limit: StepLimit) -> SchemeStep:
    dt = None
    if scheme.step != "adaptive":
        frame = experiment.save_interval
        bound = limit.recommended if math.isfinite(limit.recommended) else frame
        dt = frame / max(1, math.ceil(frame / bound * (1.0 - 1e-12)))
    stepped = experiment if dt is None else replace(experiment, dt=dt)
    return SchemeStep(
        integrator=scheme.name,
        order=scheme.order,
        limit=limit.limit if math.isfinite(limit.limit) else None,
        set_by=None if limit.culprit is None else limit.culprit.text,
        recommended=dt,
        verdict=limit.verdict(experiment.dt) if experiment.dt_stated else None,
        cost=run_cost(stepped, limit),
        use=scheme.use,
    )
