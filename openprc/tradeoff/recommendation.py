"""The cheapest setting that reaches a target, proven by a run of the config that is written."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from openprc.errors import OpenPRCError
from openprc.hooks.running import silent
from openprc.schema.experiment import load_experiment, save_experiment
from openprc.tradeoff.file_runs import read_outcome, run_to_file
from openprc.tradeoff.outcome import relative_error
from openprc.tradeoff.pareto import cpu_seconds as cpu
from openprc.tradeoff.pareto import error_by, pareto_front, usable
from openprc.tradeoff.scoring import scores_of
from openprc.tradeoff.settings import configured

if TYPE_CHECKING:
    from openprc.hooks.protocols import Progress
    from openprc.tradeoff.point import Point
    from openprc.tradeoff.study import Study

#: So many settings are tried before it is said that none holds what its point promised.
MOST_TRIED = 6
FOLDER = "recommended"


@dataclass(frozen=True, kw_only=True)
class Recommendation:
    """What to use for a target.

    Attributes
    ----------
    target : float [1]
    metric : str
    point : Point or None
        The cheapest point that reaches the target; where none does, the most exact one.
    reached : bool
        Whether a run of the config met the target.
    verified_error : float or None [1]
        Of that run.
    verified_seconds : float or None [s]
        CPU time of it, with writing its file.
    folder : Path or None
        The experiment folder that was written.
    limit : str
        What keeps the error from becoming smaller, where the target is not reached.
    rejected : tuple of str
        Settings whose runs did not hold what was measured, and why.
    """

    target: float
    metric: str
    point: Point | None
    reached: bool
    verified_error: float | None = None
    verified_seconds: float | None = None
    folder: Path | None = None
    limit: str = ""
    rejected: tuple[str, ...] = ()

    def as_dict(self) -> dict[str, Any]:
        """Return plain data, for JSON."""
        return {
            "target": self.target,
            "metric": self.metric,
            "reached": self.reached,
            "point": None if self.point is None else self.point.as_dict(),
            "verified_error": self.verified_error,
            "verified_seconds": self.verified_seconds,
            "folder": None if self.folder is None else str(self.folder),
            "limit": self.limit,
            "rejected": list(self.rejected),
        }


def recommend(
    study: Study,
    target: float,
    *,
    metric: str = "trajectory",
    folder: Path | None = None,
    progress: Progress = silent,
) -> Recommendation:
    """Choose the cheapest setting for a target, write it as a config, run that, and compare.

    The run is one of the whole scene, from the files that were written; its error is taken up to
    the horizon of the reference. A setting whose run does not meet the target makes room for the
    next one.

    Parameters
    ----------
    study : Study
    target : float [1]
    metric : str
        "trajectory", or the name of a figure of a task.
    folder : Path, optional
        ``FOLDER/recommended/input`` is written there.
    """
    error = error_by(metric)
    able = usable(study.advisable, cpu, error)
    best = min(able, key=lambda p: error(p) or 0.0, default=None)
    floor = study.reference.floor
    if metric == "trajectory" and target < floor:
        how = (
            "is good to" if study.reference.converged else "did not converge, and is wrong by up to"
        )
        limit = f"the reference {how} {floor / 10:.1e}, and errors below {floor:.1e} mean nothing"
        return Recommendation(target=target, metric=metric, point=best, reached=False, limit=limit)
    rejected: list[str] = []
    good = sorted((p for p in able if (error(p) or 0.0) <= target), key=lambda p: cpu(p) or 0.0)
    for number, point in enumerate(good[:MOST_TRIED]):
        progress(number / MOST_TRIED, f"verifying {point.label}")
        try:
            wrong, seconds = _verify(study, point, metric)
        except OpenPRCError as problem:
            rejected.append(f"{point.label} {dict(point.setting)}: {problem.found}")
            continue
        if not wrong <= target:
            rejected.append(f"{point.label} {dict(point.setting)}: its run is wrong by {wrong:.3g}")
            continue
        written = None
        if folder is not None:
            written = folder / FOLDER
            save_experiment(configured(study.scene.experiment, point.setting), written)
        return Recommendation(
            target=target,
            metric=metric,
            point=point,
            reached=True,
            verified_error=wrong,
            verified_seconds=seconds,
            folder=written,
            rejected=tuple(rejected),
        )
    limit = _limit(study, best, able, metric) if not good else "no run held what was measured"
    return Recommendation(
        target=target,
        metric=metric,
        point=best,
        reached=False,
        limit=limit,
        rejected=tuple(rejected),
    )


def _verify(study: Study, point: Point, metric: str) -> tuple[float, float]:
    """Write the config, read it, run it, and return its error and the CPU time [s]."""
    reference = study.reference
    with tempfile.TemporaryDirectory(prefix="openprc-tradeoff-") as scratch:
        save_experiment(configured(study.scene.experiment, point.setting), scratch)
        experiment = load_experiment(scratch)
        path = Path(scratch) / "output" / "simulation.h5"
        seconds = run_to_file(experiment, path)
        if metric != "trajectory":
            scores = scores_of(path, study.scene)
            return abs(scores[metric] - study.reference_scores[metric]), seconds
        outcome = read_outcome(
            path, experiment, stride=reference.stride, seconds=seconds, producer="demlat"
        )
        frames = outcome.positions[: len(reference.positions)]
        return relative_error(frames, reference.positions), seconds


def _limit(study: Study, best: Point | None, able: Sequence[Point], metric: str) -> str:
    if best is None:
        return "no setting that was tried gave a result"
    if study.left_out:
        return study.left_out[0]
    if metric != "trajectory":
        return f"figures of tasks come no closer than {error_by(metric)(best):.2g}"
    wrong = best.trajectory_error or 0.0
    if wrong < study.reference.floor:
        return f"the floor of the reference, {study.reference.floor:.1e}"
    rungs = [p for p in able if p.label == best.label]
    front = pareto_front(rungs)
    slow = (best.cpu_seconds or 0.0) * 2.0 > study.choices.longest
    if front and front[-1] is best and slow:
        return (
            f"a finer {best.label} would take more than the {study.choices.longest:g} s that"
            " --longest allows one run"
        )
    if study.choices.integrators is not None:
        return "the integrators that were tried: --integrators names no more"
    return (
        f"finer settings of {best.label} do not lower the error: rounding, or kinks in the motion"
    )


__all__ = ["Recommendation", "recommend"]
