"""From files, or from one experiment and several producers, to a `Report`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from openprc.compare.chaos.judgement import judge_difference
from openprc.compare.report import Report
from openprc.compare.runs.known_motion import reference_name, write_exact
from openprc.compare.runs.load_steps import counts_increments, time_increments
from openprc.compare.runs.names import files_by_name, reference_first
from openprc.compare.runs.probing import energy_over_time, probe_run
from openprc.compare.runs.producers import ProducerRun, run_producers
from openprc.compare.runs.requests import with_scene_options
from openprc.errors import ConfigError, OpenPRCError
from openprc.hooks.running import silent
from openprc.schema.trajectory import Trajectory

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from openprc.compare.alignment.settings import AlignmentSettings
    from openprc.compare.chaos.twins import TwinStudy
    from openprc.compare.comparison import Comparison
    from openprc.compare.runs.requests import Request
    from openprc.compare.task_scores import TaskScores
    from openprc.hooks.protocols import Progress
    from openprc.hooks.registry import Registry
    from openprc.scenes.scene import Scene
    from openprc.schema.experiment import Experiment

    Reals = NDArray[np.float64]

#: Twins are only run where a difference, over the scale, is worth explaining.
WORTH_TWINS = 1e-3


@dataclass(frozen=True, kw_only=True)
class Choices:
    """What a comparison looks at.

    Parameters
    ----------
    alignment : AlignmentSettings, optional
    reference : str, optional
        Name of the run to compare with; by default the closed form of the scene, or the first.
        "converged" integrates the scene to rounding, which may take long.
    tasks : bool
        Score every run on the standard tasks.
    twins : bool or None
        Run perturbed twins; None lets the differences decide.
    """

    alignment: AlignmentSettings | None = None
    reference: str | None = None
    tasks: bool = True
    twins: bool | None = None


def compare_runs(
    paths: Sequence[str | Path], *, choices: Choices | None = None, progress: Progress = silent
) -> Report:
    """Compare trajectory files with the first of them, or with the one that is named.

    Raises
    ------
    ConfigError
        When there are fewer than two, one is named twice, or there is no such reference.
    OpenPRCError
        When a file cannot be read or has nothing in common with the reference.
    """
    choices = choices or Choices()
    files = files_by_name([Path(path) for path in paths])
    files = reference_first(files, choices.reference)
    _, *others = files
    comparison = _compared(files, choices, progress=_part(progress, 0.0, 0.7))
    scale = _scale_of(comparison, files)
    scores = _scores(files, None, choices, progress=_part(progress, 0.7, 1.0))
    return Report(
        title=" and ".join(files),
        what=f"the reference is {next(iter(files))}",
        scale=scale,
        reference=next(iter(files)),
        files=files,
        comparison=comparison,
        divergences={
            name: judge_difference(pair.times, pair.rms_over_time, scale=scale)
            for name, pair in zip(others, comparison.pairs, strict=True)
            # Of nodes that stay where they are nothing can be said to agree.
            if scale is not None and pair.errors.displacement > 0.0
        },
        scores=scores,
        energies=_energies(files),
    )


def compare_producers(
    experiment: Experiment,
    requests: Sequence[Request],
    folder: str | Path,
    *,
    scene: Scene | None = None,
    title: str = "experiment",
    choices: Choices | None = None,
    overwrite: bool = False,
    progress: Progress = silent,
    registry: Registry | None = None,
) -> Report:
    """Run an experiment on several producers and compare all that ran.

    Parameters
    ----------
    experiment : Experiment
    requests : sequence of Request
        See `openprc.compare.runs.requests.read_requests`.
    folder : path-like
        Gets the runs.
    scene : Scene, optional
        Where the experiment comes from; brings the known motion, numbers to probe, and the
        options that its record has for a producer (`SceneSpec.run_options`), below those of the
        request itself.
    title : str
        What to call the experiment if there is no scene.
    choices : Choices, optional
    overwrite : bool
        Replace earlier runs in `folder`.

    Raises
    ------
    ConfigError
        When none of the producers runs it, or there is no such reference.
    ResultExists
        When there is an earlier run and `overwrite` is false.
    """
    from openprc.scenes.physics import physics_of  # noqa: PLC0415 - what the page says last

    choices = choices or Choices()
    folder = Path(folder)
    _check_reference(choices.reference, requests, scene)
    asked: tuple[str, ...] = ()
    if scene is not None:
        requests, added = with_scene_options(requests, scene.name)
        asked = tuple(_asked_by_scene(name, more) for name, more in added.items())
    runs = run_producers(
        experiment, requests, folder, overwrite=overwrite,
        progress=_part(progress, 0.0, 0.6), registry=registry,
    )  # fmt: skip
    if all(run.path is None for run in runs):
        raise ConfigError(
            "none of the producers runs it: "
            + "; ".join(f"{run.name}: {run.reason}" for run in runs),
            expected="a producer that can",
            fix="`openprc inspect` says who can run an experiment",
            key="--producers",
        )
    runs, files, notes = _comparable(runs, experiment, folder, overwrite=overwrite)
    if scene is not None and _starts_from_known(scene, choices.reference):
        exact = write_exact(scene, folder / f"{reference_name(scene)}.h5", overwrite=overwrite)
        files = {reference_name(scene): exact, **files}
    files = reference_first(files, choices.reference)
    comparison = None
    if len(files) > 1:
        comparison = _compared(files, choices, progress=_part(progress, 0.6, 0.7))
    scale = scene.scale if scene is not None else _scale_of(comparison, files)
    measured = {run.name: run.path for run in runs if run.path is not None}
    twins, remarks = _twins(
        experiment, requests, runs, comparison, scene=scene, scale=scale, choices=choices,
        progress=_part(progress, 0.7, 0.85), registry=registry,
    )  # fmt: skip
    pairs = comparison.pairs if comparison is not None else ()
    static = {name for name, path in measured.items() if counts_increments(path)}
    return Report(
        title=title if scene is None else scene.name,
        what=_what(scene, next(iter(files))),
        scale=scale,
        reference=next(iter(files)),
        files=files,
        runs=runs,
        physics=physics_of(experiment),
        comparison=comparison,
        divergences={
            name: judge_difference(
                pair.times,
                pair.rms_over_time,
                scale=scale,
                twins=twins,
                equilibria=(name in static) != (next(iter(files)) in static),
            )
            for name, pair in zip(list(files)[1:], pairs, strict=True)
            if scale is not None and pair.errors.displacement > 0.0
        },
        probes={} if scene is None else {n: probe_run(p, scene) for n, p in measured.items()},
        scores=_scores(measured, scene, choices, progress=_part(progress, 0.85, 1.0)),
        energies=_energies(files),
        twins=twins,
        notes=(*asked, *notes, *remarks),
    )


def _asked_by_scene(name: str, options: Mapping[str, object]) -> str:
    said = " ".join(f"{key}={value}" for key, value in options.items())
    return f"{name} ran with {said}, which brings it closest to the scene; name others to change it"


def _starts_from_known(scene: Scene, wanted: str | None) -> bool:
    """Whether the known motion takes part: a formula does, an integration only when asked."""
    if scene.reference.exact is None:
        return False
    return scene.reference.kind == "closed form" or wanted == reference_name(scene)


def _check_reference(wanted: str | None, requests: Sequence[Request], scene: Scene | None) -> None:
    """Refuse an unknown reference before anything runs."""
    names = [request.name for request in requests]
    if scene is not None and scene.reference.exact is not None:
        names = [reference_name(scene), *names]
    if wanted is not None and wanted not in names:
        raise ConfigError(
            f"there is no run called {wanted!r}",
            expected="one of " + ", ".join(names),
            fix="name one of them",
            key="--reference",
        )


def _comparable(
    runs: Sequence[ProducerRun], experiment: Experiment, folder: Path, *, overwrite: bool
) -> tuple[tuple[ProducerRun, ...], dict[str, Path], tuple[str, ...]]:
    """Return the runs, the files to compare, and what was done to paths of equilibria."""
    counted = {r.name for r in runs if r.path is not None and counts_increments(r.path)}
    files: dict[str, Path] = {}
    notes: list[str] = []
    told = list(runs)
    every = all(run.name in counted for run in runs if run.path is not None)
    for number, run in enumerate(runs):
        if run.path is None:
            continue
        if run.name not in counted or every:
            files[run.name] = run.path
            continue
        target = run.path.with_name(f"{run.path.stem}-in-time.h5")
        try:
            notes.append(
                f"{run.name}: {time_increments(run.path, experiment, target, overwrite=overwrite)}"
            )
        except ConfigError as error:
            told[number] = replace(run, notes=(*run.notes, error.found))
            notes.append(f"{run.name} is not compared: {error.found}")
            continue
        files[run.name] = target
    return tuple(told), files, tuple(notes)


# --- what is found ----------------------------------------------------------------------------


def _compared(files: Mapping[str, Path], choices: Choices, *, progress: Progress) -> Comparison:
    from openprc.compare.comparison import compare_files  # noqa: PLC0415 - loads the compiler

    first, *others = files.values()
    return compare_files(
        first, others, settings=choices.alignment, names=tuple(files), progress=progress
    )


def _scale_of(comparison: Comparison | None, files: Mapping[str, Path]) -> float | None:
    """Return the rms displacement of the reference, as the comparison measured it."""
    for pair in comparison.pairs if comparison is not None else ():
        if pair.errors.displacement > 0.0:
            return float(pair.errors.displacement)
    size = _displacement(next(iter(files.values())))
    return size if size > 0.0 else None


def _displacement(path: Path) -> float:
    """Return the rms displacement from the first frame, over nodes and frames [m]."""
    with Trajectory(path) as run:
        if not run.n_nodes:
            return 0.0
        unit = "m" if run.position_unit != "px" else None
        chosen = np.unique(np.linspace(0, run.n_frames - 1, 500).astype(int))
        frames = [run.positions(slice(k, k + 1), unit=unit) for k in chosen]
    moved = np.concatenate(frames) - frames[0]
    sizes = (moved**2).sum(axis=2)
    return float(np.sqrt(np.nanmean(sizes))) if np.isfinite(sizes).any() else 0.0


def _twins(
    experiment: Experiment,
    requests: Sequence[Request],
    runs: Sequence[ProducerRun],
    comparison: Comparison | None,
    *,
    scene: Scene | None,
    scale: float | None,
    choices: Choices,
    progress: Progress,
    registry: Registry | None,
) -> tuple[TwinStudy | None, tuple[str, ...]]:
    """Run perturbed twins where a difference is large enough to ask why."""
    from openprc.compare.chaos.twins import twin_study  # noqa: PLC0415 - only then

    if choices.twins is False or scale is None:
        return None, ()
    largest = max(
        (float(np.nanmax(pair.rms_over_time, initial=0.0)) for pair in comparison.pairs)
        if comparison is not None
        else (),
        default=0.0,
    )
    asked = choices.twins or (scene is not None and scene.chaotic)
    if not asked and largest < WORTH_TWINS * scale:
        return None, ()
    by_name = {request.name: request for request in requests}
    able = [
        by_name[run.name]
        for run in sorted(runs, key=lambda run: run.producer != "demlat")
        if run.path is not None and not counts_increments(run.path)
    ]
    if not able:
        return None, ("no perturbed twins: nothing ran in time",)
    try:
        study = twin_study(
            experiment, scale=scale, request=able[0], progress=progress, registry=registry
        )
    except OpenPRCError as error:
        return None, (f"no perturbed twins: {error.found}",)
    return study, ()


def _energies(files: Mapping[str, Path]) -> dict[str, tuple[Reals, Reals]]:
    found = {name: energy_over_time(path) for name, path in files.items()}
    return {name: curve for name, curve in found.items() if curve is not None}


def _scores(
    files: Mapping[str, Path], scene: Scene | None, choices: Choices, *, progress: Progress
) -> dict[str, TaskScores]:
    if not choices.tasks:
        return {}
    from openprc.compare.task_scores import task_scores  # noqa: PLC0415 - loads scikit-learn

    found = {}
    for number, (name, path) in enumerate(files.items()):
        progress(number / len(files), f"tasks of {name}")
        found[name] = task_scores(path, scene=scene)
    return found


def _what(scene: Scene | None, reference: str) -> str:
    if scene is None:
        return f"the reference is {reference}"
    known = f"{scene.reference.text} ({scene.reference.source})"
    return f"the reference is {reference}; known of the scene: {known}"


def _part(progress: Progress, begin: float, end: float) -> Progress:
    def within(fraction: float, message: str) -> None:
        progress(begin + (end - begin) * fraction, message)

    return within


__all__ = ["WORTH_TWINS", "Choices", "compare_producers", "compare_runs"]
