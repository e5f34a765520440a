"""The study: every setting of a scene, measured against its converged reference."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from openprc.errors import TaskError
from openprc.hooks.running import silent
from openprc.tradeoff.after_run import measure_downstream
from openprc.tradeoff.axes import measure_group
from openprc.tradeoff.choices import Choices
from openprc.tradeoff.pareto import pareto_front
from openprc.tradeoff.point import Point
from openprc.tradeoff.reference import ConvergedReference
from openprc.tradeoff.reference_file import kept_reference
from openprc.tradeoff.scene_digest import scene_digest
from openprc.tradeoff.scoring import REFERENCE as REFERENCE_GROUP
from openprc.tradeoff.scoring import score_points
from openprc.tradeoff.settings import ENGINE_GROUPS
from openprc.tradeoff.store import PointStore
from openprc.tradeoff.workbench import BudgetSpent, Workbench

if TYPE_CHECKING:
    from openprc.hooks.protocols import Progress
    from openprc.scenes.scene import Scene

POINTS, REFERENCE = "points.jsonl", "reference.npz"


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
    TaskError
        When a score is asked for, and no task can be scored.
    """
    if choices.metric != "trajectory" and scene.input_name is None:
        raise TaskError(
            f"the scene {scene.name!r} with the metric {choices.metric!r}",
            expected="a scene that random symbols drive",
            fix="use --metric trajectory, or a driven scene such as hauser-network",
            key="--metric",
        )
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
            measure_group(bench, group, choices, progress=_part(progress, begin, share))
        bench.time_again(progress=_part(progress, 0.8, 0.1))
        left_out += measure_downstream(
            bench, scene, choices.groups, progress=_part(progress, 0.9, 0.0)
        )
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
        points=tuple(point for point in store.points if point.group != REFERENCE_GROUP),
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
