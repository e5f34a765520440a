"""Errors of task scores: what a setting changes in what the body computes."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from openprc.errors import OpenPRCError, TaskError
from openprc.hooks.running import silent
from openprc.tradeoff.file_runs import run_to_file
from openprc.tradeoff.point import Point
from openprc.tradeoff.settings import configured

if TYPE_CHECKING:
    from openprc.hooks.protocols import Progress
    from openprc.scenes.scene import Scene
    from openprc.tradeoff.workbench import Workbench

#: Group of the one point that holds the figures of the reference.
REFERENCE = "reference"
#: Figures that a target may be set for.
FIGURES = ("narma2_nrmse", "narma10_nrmse", "memory_capacity", "ipc")


def scores_of(path: Path, scene: Scene) -> dict[str, float]:
    """Return the figures of the tasks of a run.

    Raises
    ------
    TaskError
        When the run admits no task.
    """
    # scikit-learn takes seconds to import, and only driven scenes need it.
    found: Any = import_module("openprc.compare.task_scores").task_scores(path, scene=scene)
    if not found.figures:
        reasons = "; ".join(dict.fromkeys(found.skipped.values())) or "nothing drives it"
        raise TaskError(
            f"no task can be scored: {reasons}",
            expected="a scene that is driven by random symbols, for long enough",
            fix="use --metric trajectory, or a driven scene such as hauser-network",
        )
    return dict(found.figures)


def run_and_score(scene: Scene, setting: Mapping[str, Any]) -> dict[str, float]:
    """Run a setting of the whole scene and return its figures.

    Raises
    ------
    OpenPRCError
        When it cannot be run, or scored.
    """
    experiment = configured(scene.experiment, setting)
    # Features are read from a file; rounding in it is another axis.
    experiment = replace(experiment, stored=replace(experiment.stored, precision="float64"))
    with tempfile.TemporaryDirectory(prefix="openprc-tradeoff-") as folder:
        path = Path(folder) / "simulation.h5"
        run_to_file(experiment, path, producer=setting.get("producer", "demlat"))
        return scores_of(path, scene)


def score_points(
    bench: Workbench, scene: Scene, points: Sequence[Point], *, progress: Progress = silent
) -> tuple[dict[str, float], tuple[str, ...]]:
    """Add figures, and what they deviate by, to the points of a workbench.

    Returns
    -------
    reference : dict
        Figures of the reference.
    notes : tuple of str
        Settings that could not be scored, and why.

    Raises
    ------
    TaskError
        When the scene admits no task.
    """
    progress(0.0, "scores of the reference")
    setting = dict(bench.reference.setting)
    kept = bench.store.get(REFERENCE, setting)
    if kept is None:
        truth = run_and_score(scene, setting)
        bench.store.put(Point(group=REFERENCE, label=REFERENCE, setting=setting, scores=truth))
    else:
        truth = dict(kept.point.scores)
    notes: list[str] = []
    for number, point in enumerate(points):
        if point.scores:
            continue
        bench.check_budget()
        progress(number / len(points), f"scores of {point.label}")
        try:
            figures = run_and_score(scene, point.setting)
        except OpenPRCError as problem:
            notes.append(f"{point.label} {dict(point.setting)}: {problem.found}")
            continue
        errors = {name: abs(figures[name] - truth[name]) for name in figures if name in truth}
        bench.put_scores(point, figures, errors)
    return truth, tuple(notes)
