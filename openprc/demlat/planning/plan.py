"""`make_plan`: what a run would do, what it would cost, and what is odd, without running it."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any

from openprc.demlat.integrators import find_integrator
from openprc.demlat.models.barhinge.support import remarks, supports
from openprc.demlat.planning.accuracy import choose_for_accuracy, settled
from openprc.demlat.planning.accuracy_choice import AccuracyChoice
from openprc.demlat.planning.mechanisms import mechanisms
from openprc.demlat.planning.run_cost import RunCost, run_cost
from openprc.demlat.planning.scene_checks import scene_findings
from openprc.demlat.planning.stability import ACCURATE, StepLimit, Verdict, step_limit
from openprc.demlat.planning.tangent_operators import free_axes
from openprc.schema.experiment_checks import check_experiment
from openprc.schema.findings import Finding

if TYPE_CHECKING:
    from openprc.schema.experiment import Experiment


@dataclass(frozen=True, kw_only=True)
class Plan:
    """What is known before a run.

    Attributes
    ----------
    integrator : str
    dt : float [s]
    verdict : {"fine", "dissipative", "marginal", "unstable"}
        See `openprc.demlat.planning.stability.StepLimit.verdict`.
    limit : float or None [s]
        The largest stable step; None when no step is too large.
    recommended : float or None [s]
    accurate : float or None [s]
        The step up to which rk4 leaves the fastest mode its energy; None for other schemes.
    omega : float [rad/s]
        The highest angular frequency at the start, on the safe side.
    zeta : float
        Its damping ratio.
    set_by : str or None
        What sets the limit, or the highest frequency where there is no limit.
    loss : float or None
        Share of the energy of the fastest mode that rk4 takes in a period at `dt`.
    n_frames, n_steps : int
        Of schemes that choose their step, `n_steps` is None.
    n_nodes, n_fixed, n_driven, n_free : int
        The last one counts coordinates.
    n_bars, n_rigid_bars, n_hinges, n_rigid_hinges, n_bends : int
    n_mechanisms, n_rigid_motions : int or None
        Motions that strain no element; None where the body is too large to be searched.
    cost : RunCost
    findings : tuple of Finding
        What is refused ("error"), and what is odd ("warning", "hint").
    remarks : tuple of str
        What a run would note in its file.
    accuracy : AccuracyChoice or None
        What was chosen for the accuracy of the experiment, if it has one.
    """

    integrator: str
    dt: float
    verdict: Verdict
    limit: float | None
    recommended: float | None
    accurate: float | None
    omega: float
    zeta: float
    set_by: str | None
    loss: float | None
    n_frames: int
    n_steps: int | None
    n_nodes: int
    n_fixed: int
    n_driven: int
    n_free: int
    n_bars: int
    n_rigid_bars: int
    n_hinges: int
    n_rigid_hinges: int
    n_bends: int
    n_mechanisms: int | None
    n_rigid_motions: int | None
    cost: RunCost
    findings: tuple[Finding, ...]
    remarks: tuple[str, ...]
    accuracy: AccuracyChoice | None = None

    @property
    def runs(self) -> bool:
        """Whether nothing is refused."""
        return all(finding.level != "error" for finding in self.findings)

    def as_dict(self) -> dict[str, Any]:
        """Return plain data, for JSON."""
        data = asdict(self)
        data["findings"] = [finding.as_dict() for finding in self.findings]
        data["remarks"] = list(self.remarks)
        data["accuracy"] = None if self.accuracy is None else self.accuracy.as_dict()
        return data | {"runs": self.runs}

    def rows(self) -> list[tuple[str, str]]:
        """Return what a table shows: name and text."""
        stop = "none" if self.limit is None else f"{self.limit:.4g} s"
        steps = "chosen by the scheme" if self.n_steps is None else f"{self.n_steps:,}"
        rows = [] if self.accuracy is None else self.accuracy.rows()
        rows += [
            ("integrator", self.integrator),
            ("time step", f"{self.dt:g} s: {self.verdict}"),
            ("stability limit", stop + ("" if self.set_by is None else f", {self.set_by}")),
            ("recommended", "-" if self.recommended is None else f"{self.recommended:.4g} s"),
            ("fastest mode", f"{self.omega:.4g} rad/s, damping ratio {self.zeta:.2g}"),
        ]
        if self.loss is not None:
            rows.append(("energy that rk4 takes from it", f"{self.loss:.2g} in a period"))
        rows += [
            ("steps, frames", f"{steps}, {self.n_frames:,}"),
            (
                "nodes",
                f"{self.n_nodes:,}: {self.n_fixed:,} fixed, {self.n_driven:,} driven;"
                f" {self.n_free:,} free coordinates",
            ),
            ("bars, hinges", f"{self.n_bars:,} ({self.n_rigid_bars:,} rigid),"
             f" {self.n_hinges:,} ({self.n_rigid_hinges:,} rigid)"),
            *([("bends", f"{self.n_bends:,}")] if self.n_bends else []),
            ("mechanisms", self._mechanisms()),
            ("force evaluations", f"{self.cost.evaluations:,}"),
            ("time", f"{_duration(self.cost.seconds)} or so, once compiled"),
            ("memory, file", f"{_bytes(self.cost.memory)}, {_bytes(self.cost.file_size)}"),
        ]  # fmt: skip
        return rows

    def _mechanisms(self) -> str:
        if self.n_mechanisms is None:
            return "not checked: too many coordinates"
        return f"{self.n_mechanisms}, and {self.n_rigid_motions} motions as a whole"


def make_plan(experiment: Experiment, *, only: tuple[str, ...] = ()) -> Plan:
    """Look at an experiment without running it, but for the pilot that an accuracy takes.

    Parameters
    ----------
    experiment : Experiment
    only : tuple of str, optional
        Names of integrators that an accuracy may choose from.

    Raises
    ------
    ConfigError
        When the experiment is wrong, or its integrator is not known. What the engine cannot
        model is among the findings.

    Examples
    --------
    >>> from openprc.demlat.planning.plan import make_plan
    >>> from openprc.schema.experiment import Experiment
    >>> from openprc.schema.geometry import Bars, Geometry
    >>> bars = Bars(indices=[[0, 1]], stiffness=[100.0], rest_length=[1.0])
    >>> body = Geometry(positions=[[0, 0, 0], [1, 0, 0]], masses=[1, 1], fixed=[1, 0], bars=bars)
    >>> plan = make_plan(Experiment(geometry=body, duration=1.0, dt=0.05, save_interval=0.1))
    >>> plan.verdict, round(plan.limit, 4), plan.set_by
    ('fine', 0.2828, 'bar 0 between nodes 0 and 1')
    """
    check_experiment(experiment)
    choice = None
    if experiment.accuracy is not None:
        choice = choose_for_accuracy(experiment, only=only)
        experiment = settled(experiment, only=only)
    scheme = find_integrator(experiment.integrator)
    limit = step_limit(experiment)
    geometry = experiment.geometry
    found = mechanisms(experiment)
    is_rk4 = scheme.stability == "rk4" and math.isfinite(limit.limit)
    held = experiment.driven_axes("position") | experiment.driven_axes("velocity")
    return Plan(
        integrator=scheme.name,
        dt=experiment.dt,
        verdict=limit.verdict(experiment.dt),
        limit=_finite(limit.limit),
        recommended=_finite(limit.recommended),
        accurate=ACCURATE * limit.limit if is_rk4 else None,
        omega=limit.omega,
        zeta=limit.zeta,
        set_by=None if limit.culprit is None else limit.culprit.text,
        loss=limit.loss(experiment.dt) if is_rk4 and experiment.dt <= limit.limit else None,
        n_frames=experiment.n_frames,
        n_steps=None
        if scheme.step == "adaptive"
        else (experiment.n_frames - 1) * experiment.steps_per_frame,
        n_nodes=geometry.n_nodes,
        n_fixed=int(geometry.fixed.sum()),
        n_driven=int(held.any(axis=1).sum()),
        n_free=int(free_axes(experiment).sum()),
        n_bars=len(geometry.bars),
        n_rigid_bars=int(geometry.bars.rigid.sum()),
        n_hinges=len(geometry.hinges),
        n_rigid_hinges=int(geometry.hinges.rigid.sum()),
        n_bends=len(geometry.bends),
        n_mechanisms=None if found is None else found[0],
        n_rigid_motions=None if found is None else found[1],
        cost=_cost(experiment, limit, choice),
        findings=(*supports(experiment), *scene_findings(experiment)),
        remarks=tuple(remarks(experiment)),
        accuracy=choice,
    )


def _cost(experiment: Experiment, limit: StepLimit, choice: AccuracyChoice | None) -> RunCost:
    cost = run_cost(experiment, limit)
    if choice is None or cost.evaluations == 0:
        return cost
    # A pilot has counted what a formula only guesses.
    seconds = cost.seconds * choice.evaluations / cost.evaluations
    return replace(cost, evaluations=choice.evaluations, seconds=seconds)


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _duration(seconds: float) -> str:
    if seconds < 1.0:
        return f"{1e3 * seconds:.2g} ms"
    return f"{seconds:.2g} s" if seconds < 100.0 else f"{seconds / 60.0:.2g} min"


def _bytes(count: int) -> str:
    size = float(count)
    for unit in ("B", "kB", "MB"):
        if size < 1000:
            return f"{size:.3g} {unit}"
        size /= 1000
    return f"{size:.3g} GB"
