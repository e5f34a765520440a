"""`inspect_experiment`: what a scene requires, who can run it, and what is odd about it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, TypeVar

from openprc.demlat.integrators import INTEGRATORS, find_integrator
from openprc.errors import OpenPRCError
from openprc.scenes.requirements import ProducerVerdict, physics_of, producer_verdicts
from openprc.schema.experiment_checks import check_experiment
from openprc.schema.findings import Finding

if TYPE_CHECKING:
    from openprc.demlat.planning.engine_terms import EngineTerm
    from openprc.demlat.planning.mechanisms import FreeMotions
    from openprc.demlat.planning.plan import Plan
    from openprc.demlat.planning.step_table import SchemeStep
    from openprc.hooks.registry import Registry
    from openprc.scenes.physics import Physics
    from openprc.schema.experiment import Experiment

T = TypeVar("T")


@dataclass(frozen=True, kw_only=True)
class Inspection:
    """What can be said of a scene without running it.

    Attributes
    ----------
    name : str
        Folder, or scene of the library.
    physics : tuple of Physics
    producers : tuple of ProducerVerdict
    terms : tuple of EngineTerm
        Of the native engine's compiled loop; empty where the engine refuses the scene.
    steps : tuple of SchemeStep
        A line for every integrator that fits; empty where none does.
    plan : Plan or None
        Of a run with the settings as they are; None where the integrator is not known.
    motions : FreeMotions or None
        None for bodies that are too large to be searched.
    findings : tuple of Finding
        What is degenerate, loose, redundant or without effect, whoever runs it.
    notes : tuple of str
        What was decided while reading, and what could not be said here.
    """

    name: str
    physics: tuple[Physics, ...]
    producers: tuple[ProducerVerdict, ...]
    terms: tuple[EngineTerm, ...]
    steps: tuple[SchemeStep, ...]
    plan: Plan | None
    motions: FreeMotions | None
    findings: tuple[Finding, ...]
    notes: tuple[str, ...]

    @property
    def runs(self) -> bool:
        """Whether some installed producer can run the scene."""
        return any(verdict.state == "runs" for verdict in self.producers)

    def as_dict(self) -> dict[str, Any]:
        """Return plain data, for JSON."""
        return {
            "name": self.name,
            "runs": self.runs,
            "physics": [item.as_dict() for item in self.physics],
            "producers": [item.as_dict() for item in self.producers],
            "terms": [item.as_dict() for item in self.terms],
            "steps": [item.as_dict() for item in self.steps],
            "plan": None if self.plan is None else self.plan.as_dict(),
            "motions": None if self.motions is None else self.motions.as_dict(),
            "findings": [item.as_dict() for item in self.findings],
            "notes": list(self.notes),
        }


def inspect_experiment(
    experiment: Experiment, *, name: str = "experiment", registry: Registry | None = None
) -> Inspection:
    """Look at an experiment without running it.

    Parameters
    ----------
    experiment : Experiment
    name : str
        Shown as the heading.
    registry : Registry, optional
        Whose producers are asked; the installed ones by default.

    Raises
    ------
    ConfigError
        When the experiment is wrong. One that no producer can run is not.

    Examples
    --------
    >>> from openprc.compare.inspection import inspect_experiment
    >>> from openprc.schema.experiment import Experiment
    >>> from openprc.schema.geometry import Bars, Geometry
    >>> bars = Bars(indices=[[0, 1]], stiffness=[100.0], rest_length=[1.0])
    >>> body = Geometry(positions=[[0, 0, 0], [1, 0, 0]], masses=[1, 1], fixed=[1, 0], bars=bars)
    >>> scene = Experiment(geometry=body, duration=1.0, dt=0.05, save_interval=0.1)
    >>> seen = inspect_experiment(scene)
    >>> seen.steps[0].integrator, round(seen.steps[0].limit, 4), seen.motions.shown[0].text
    ('rk4', 0.2828, 'node 1 moves along y')
    """
    # What looks at a body in depth loads scipy.
    from openprc.demlat.planning.engine_terms import engine_terms  # noqa: PLC0415
    from openprc.demlat.planning.mechanisms import free_motions  # noqa: PLC0415
    from openprc.demlat.planning.plan import make_plan  # noqa: PLC0415
    from openprc.demlat.planning.scene_checks import (  # noqa: PLC0415
        motion_findings,
        scene_findings,
    )
    from openprc.demlat.planning.step_table import scheme_steps  # noqa: PLC0415

    check_experiment(experiment)
    notes = list(experiment.notes)
    # Every part says what it can; a contradiction met by one must not hide the others.
    known = experiment.integrator in INTEGRATORS
    # For an accuracy the plan chooses integrator and step.
    planned = known or experiment.accuracy is not None
    if not planned:
        notes.append(f"the engine has no integrator {experiment.integrator!r}, so there is no plan")
    producers = producer_verdicts(experiment, registry=registry)
    engine = [
        finding for item in producers if item.producer == "demlat" for finding in item.findings
    ]
    blocked = any(f.level == "error" and f.code != "DEM-UNSTABLE-STEP" for f in engine)
    motions = free_motions(experiment)
    return Inspection(
        name=name,
        physics=physics_of(experiment),
        producers=producers,
        terms=() if blocked or not known else _said(engine_terms, experiment, notes, "terms") or (),
        steps=_said(scheme_steps, experiment, notes, "steps") or (),
        plan=_said(make_plan, experiment, notes, "plan") if planned else None,
        motions=motions,
        findings=(*scene_findings(experiment), *motion_findings(motions)),
        notes=tuple(dict.fromkeys(notes)),
    )


def _said(
    look: Callable[[Experiment], T], scene: Experiment, notes: list[str], what: str
) -> T | None:
    try:
        return look(scene)
    except OpenPRCError as error:
        notes.append(f"no {what}: {error.found}" + (f" ({error.fix})" if error.fix else ""))
        return None


def with_integrator(experiment: Experiment, integrator: str | None) -> Experiment:
    """Return the experiment with another integrator.

    Raises
    ------
    ConfigError
        When there is none of that name.
    """
    if integrator is None:
        return experiment
    return replace(experiment, integrator=find_integrator(integrator).name)


__all__ = ["Inspection", "inspect_experiment", "with_integrator"]
