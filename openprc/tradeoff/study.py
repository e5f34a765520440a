"""The study: every setting of a scene, measured against its converged reference."""

from __future__ import annotations

import hashlib
import itertools
import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from openprc.demlat.integrators import INTEGRATORS
from openprc.errors import TaskError
from openprc.hooks.registry import default_registry
from openprc.hooks.running import silent
from openprc.tradeoff import ladders
from openprc.tradeoff.pareto import cost_of, cpu_seconds, pareto_front
from openprc.tradeoff.point import Point
from openprc.tradeoff.reference import ROUNDING, ConvergedReference, has_constraints
from openprc.tradeoff.reference_file import kept_reference
from openprc.tradeoff.scene_digest import scene_digest
from openprc.tradeoff.scoring import score_points
from openprc.tradeoff.settings import ENGINE_GROUPS, GROUPS, OFFERED, check_names
from openprc.tradeoff.store import PointStore
from openprc.tradeoff.workbench import BudgetSpent, Workbench

if TYPE_CHECKING:
    from openprc.hooks.protocols import Progress
    from openprc.scenes.scene import Scene
    from openprc.schema.experiment import Experiment

#: Errors below this are of no use to anyone, and cost the most to measure.
GOOD_ENOUGH = 3e-9
#: With a target, ladders end this far below it.
BELOW_TARGET = 0.1
#: The reference is known to this share of a target.
OF_TARGET = 1e-3
#: Refined are ladders that reach the target for up to so many times the least cost.
NEAR = 2.0
POINTS, REFERENCE = "points.jsonl", "reference.npz"


@dataclass(frozen=True, kw_only=True)
class Choices:
    """What is studied, and for how long.

    Parameters
    ----------
    groups : tuple of str
        Some of `openprc.tradeoff.settings.GROUPS`.
    integrators : tuple of str, optional
        By default all, but those for constraints where there are none.
    target : float, optional [1]
        Error that is wanted: ladders end below it, and are refined around it.
    metric : str
        What it is an error of: "trajectory", or a figure of `openprc.compare.task_scores`.
    longest : float [s]
        CPU time that one run may take.
    budget : float, optional [s]
        Wall-clock time for all measurements.
    rounds : int
        Timings that a CPU time is the median of.
    folder : Path, optional
        Where points and reference are kept, so that an interrupted study is continued.

    Raises
    ------
    ConfigError
        When a group or an integrator is not there.
    """

    groups: tuple[str, ...] = ("integrator", "constraints", "precision", "storage")
    integrators: tuple[str, ...] | None = None
    target: float | None = None
    metric: str = "trajectory"
    longest: float = 5.0
    budget: float | None = None
    rounds: int = 3
    folder: Path | None = None

    def __post_init__(self) -> None:
        check_names(self.groups, GROUPS, what="group")
        check_names(self.integrators or (), OFFERED, what="integrator")

    @property
    def enough(self) -> float:
        """Error at which ladders end."""
        if self.target is None or self.metric != "trajectory":
            return GOOD_ENOUGH
        return max(BELOW_TARGET * self.target, GOOD_ENOUGH)

    @property
    def needed(self) -> float:
        """How well the reference has to be known."""
        if self.target is None or self.metric != "trajectory":
            return ROUNDING
        return max(OF_TARGET * self.target, ROUNDING)

    def schemes(self, experiment: Experiment) -> tuple[str, ...]:
        """Return the integrators that are tried on a scene."""
        if self.integrators is not None:
            return self.integrators
        bound = has_constraints(experiment)
        return tuple(n for n in OFFERED if bound or INTEGRATORS[n].rigid == "no")


@dataclass(frozen=True, kw_only=True)
class Study:
    """Everything that was measured of a scene.

    Attributes
    ----------
    scene : Scene
    reference : ConvergedReference
    points : tuple of Point
    reference_scores : dict of str to float
        Figures of tasks of the reference; empty where nothing was scored.
    choices : Choices
    n_measured : int
        Points that were measured now, and not found in the folder.
    left_out : tuple of str
        What there was no time for, or what could not be done.
    """

    scene: Scene
    reference: ConvergedReference
    points: tuple[Point, ...]
    reference_scores: dict[str, float]
    choices: Choices
    n_measured: int
    left_out: tuple[str, ...] = ()

    @property
    def advisable(self) -> tuple[Point, ...]:
        """Points whose settings can be written into a config, and are not refused by default."""
        return advisable(self.points)

    @property
    def front(self) -> tuple[Point, ...]:
        """Advisable points that nothing beats in error and CPU time."""
        return pareto_front(self.advisable)

    def ladders(self) -> dict[str, list[Point]]:
        """Return the points of every label, in the order of measuring."""
        found: dict[str, list[Point]] = {}
        for point in self.points:
            found.setdefault(f"{point.group}: {point.label}", []).append(point)
        return found

    def as_dict(self) -> dict[str, Any]:
        """Return plain data, for JSON."""
        front = {id(point) for point in self.front}
        return {
            "scene": self.scene.name,
            "scene_digest": scene_digest(self.scene.experiment),
            "chaotic": self.scene.chaotic,
            "reference": self.reference.as_dict(),
            "reference_scores": self.reference_scores,
            "target": self.choices.target,
            "metric": self.choices.metric,
            "points": [
                point.as_dict()
                | {"on_front": id(point) in front, "at_floor": at_floor(point, self.reference)}
                for point in self.points
            ],
            "n_measured": self.n_measured,
            "left_out": list(self.left_out),
        }


def advisable(points: Iterable[Point]) -> tuple[Point, ...]:
    """Return the points whose settings a config can hold, and the engine does not refuse."""
    return tuple(
        point
        for point in points
        if point.group in ("integrator", "constraints", "precision", "model")
        and not {"step_check", "producer"} & set(point.setting)
    )


def at_floor(point: Point, reference: ConvergedReference) -> bool:
    """Say whether a point's error cannot be told from that of the reference."""
    return point.trajectory_error is not None and point.trajectory_error < reference.floor


def run_study(scene: Scene, choices: Choices, *, progress: Progress = silent) -> Study:
    """Measure what `choices` say.

    Finished points are kept in ``choices.folder`` as they come; after an interruption the same
    call goes on where it was.

    Raises
    ------
    ConfigError
        When the folder holds points of another scene, or nothing moves.
    NotConverged
        When there is no reference.
    """
    digest = scene_digest(scene.experiment)
    folder = choices.folder
    reference = kept_reference(
        scene,
        None if folder is None else folder / REFERENCE,
        digest=digest,
        longest=choices.longest,
        needed=choices.needed,
        progress=progress,
    )
    proven = f"{digest} {reference.horizon!r} {reference.method}"
    store = PointStore(
        None if folder is None else folder / POINTS,
        scene=hashlib.sha256(proven.encode()).hexdigest(),
    )
    bench = Workbench(
        replace(scene.experiment, duration=reference.horizon),
        reference,
        store=store,
        rounds=choices.rounds,
        budget=choices.budget,
        longest=choices.longest,
    )
    left_out: list[str] = []
    scores: dict[str, float] = {}
    groups = [group for group in ENGINE_GROUPS if group in choices.groups]
    try:
        for number, group in enumerate(groups):
            begin, share = 0.8 * number / len(groups), 0.8 / len(groups)
            _measure_group(bench, group, choices, progress=_part(progress, begin, share))
        bench.time_again(progress=_part(progress, 0.8, 0.1))
        scores, notes = _scores(bench, scene, choices, progress=_part(progress, 0.9, 0.1))
        left_out += notes
    except BudgetSpent:
        left_out.append(
            f"the budget of {choices.budget:g} s was spent before everything was measured;"
            " the same command goes on where it was"
            if folder is not None
            else f"the budget of {choices.budget:g} s was spent before everything was measured"
        )
    store.compact()
    return Study(
        scene=scene,
        reference=reference,
        points=tuple(point for point in store.points if point.group != "reference"),
        reference_scores=scores,
        choices=choices,
        n_measured=bench.n_measured,
        left_out=tuple(left_out),
    )


def _part(progress: Progress, begin: float, share: float) -> Progress:
    return lambda fraction, message: progress(begin + share * fraction, message)


def _scores(
    bench: Workbench, scene: Scene, choices: Choices, *, progress: Progress
) -> tuple[dict[str, float], list[str]]:
    """Score the settings that are worth it: those on the front, or all where scores decide."""
    by_score = choices.metric != "trajectory"
    if not by_score and scene.input_name is None:
        return {}, []
    points = tuple(p for p in advisable(bench.store.points) if p.status == "ok")
    try:
        scores, notes = score_points(
            bench, scene, points if by_score else pareto_front(points), progress=progress
        )
    except TaskError as problem:
        if by_score:
            raise
        return {}, [f"scores of tasks: {problem.found}"]
    return scores, [f"not scored: {note}" for note in notes]


# --- groups -------------------------------------------------------------------------------------


def _measure_group(bench: Workbench, group: str, choices: Choices, *, progress: Progress) -> None:
    tasks = list(_TASKS[group](bench, choices))
    for number, (name, task) in enumerate(tasks):
        progress(number / len(tasks), name)
        task()


Tasks = Iterator[tuple[str, Callable[[], object]]]


def _integrators(bench: Workbench, choices: Choices) -> Tasks:
    for name in choices.schemes(bench.experiment):
        yield (
            name,
            lambda name=name: ladders.integrator_ladder(bench, name, enough=choices.enough),
        )
    if choices.target is not None and choices.metric == "trajectory":
        yield "around the target", lambda: refine(bench, "integrator", choices.target or 0.0)


def _constraints(bench: Workbench, choices: Choices) -> Tasks:
    for name in choices.schemes(bench.experiment):
        base = _base(bench, name, choices)
        if base is not None and INTEGRATORS[name].rigid != "no":
            yield (
                f"{name}, tolerance of constraints",
                lambda base=base: ladders.constraint_ladder(bench, base),
            )


def _precision(bench: Workbench, choices: Choices) -> Tasks:
    for name in ("rk4", "verlet", "dop853"):
        if name in choices.schemes(bench.experiment):
            yield (
                f"{name} in float32",
                lambda name=name: ladders.integrator_ladder(
                    bench, name, enough=choices.enough, group="precision", precision="float32"
                ),
            )


def _storage(bench: Workbench, choices: Choices) -> Tasks:
    # What storing loses shows where nothing else is lost.
    yield "storage", lambda: ladders.storage_points(bench, bench.reference.setting)


def _backends(bench: Workbench, choices: Choices) -> Tasks:
    for name in ("cpu", "jax", "cuda"):
        yield f"rk4 on {name}", lambda name=name: ladders.backend_ladder(bench, name)


def _models(bench: Workbench, choices: Choices) -> Tasks:
    yield "rigid bars", lambda: ladders.rigid_ladders(bench, enough=choices.enough)
    for item in default_registry().producers:
        if "run" in item.spec.capabilities and item.name != "demlat":
            yield (
                item.name,
                lambda item=item: ladders.producer_ladder(
                    bench, item.qualified_name, label=item.name, enough=choices.enough
                ),
            )


_TASKS: dict[str, Callable[[Workbench, Choices], Tasks]] = {
    "integrator": _integrators,
    "constraints": _constraints,
    "precision": _precision,
    "storage": _storage,
    "backend": _backends,
    "model": _models,
}


def _base(bench: Workbench, name: str, choices: Choices) -> Point | None:
    """Return the point that other axes are varied at: as exact as wanted, or as can be had."""
    measured = [p for p in bench.store.points if p.group == "integrator" and p.label == name]
    return ladders.best_rung(measured, choices.enough)


def refine(bench: Workbench, group: str, target: float) -> None:
    """Measure settings that should just reach a target, on the ladders that reach it cheaply."""
    found: dict[str, list[Point]] = {}
    for point in bench.store.points:
        if point.group == group and "step_check" not in point.setting:
            found.setdefault(point.label, []).append(point)
    costs = {label: cost_of(points, target, cost=cpu_seconds) for label, points in found.items()}
    least = min((cost for cost in costs.values() if cost is not None), default=math.inf)
    for label, points in found.items():
        cost = costs[label]
        if cost is None or cost > NEAR * least:
            continue
        setting = _between(points, target)
        if setting is not None:
            bench.measure(group, label, setting)


def _between(points: Sequence[Point], target: float) -> dict[str, Any] | None:
    """Return the setting between two rungs that should just reach the target."""
    good = [p for p in points if p.trajectory_error]
    for before, after in itertools.pairwise(good):
        e0, e1 = before.trajectory_error or 0.0, after.trajectory_error or 0.0
        if not e0 > target >= e1:
            continue
        share = math.log(e0 / (0.9 * target)) / math.log(e0 / e1)
        if not 0.0 < share < 1.0:
            return None
        if "tolerance" in before.setting:
            t0, t1 = before.setting["tolerance"], after.setting["tolerance"]
            return {**before.setting, "tolerance": float(f"{t0 * (t1 / t0) ** share:.2g}")}
        n0, n1 = before.setting["steps_per_frame"], after.setting["steps_per_frame"]
        count = math.ceil(n0 * (n1 / n0) ** share)
        return {**before.setting, "steps_per_frame": count} if n0 < count < n1 else None
    return None
