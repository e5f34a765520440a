"""``openprc tradeoff``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from openprc.cli.console import console, json_option, print_json, progress_bar, table
from openprc.cli.options import FiniteFloat, refuse_file

if TYPE_CHECKING:
    from openprc.scenes.scene import Scene
    from openprc.tradeoff.point import Point
    from openprc.tradeoff.recommendation import Recommendation
    from openprc.tradeoff.study import Study

_METRICS = ("trajectory", "narma2_nrmse", "narma10_nrmse", "memory_capacity", "ipc")


class _Positive(FiniteFloat):
    """A finite number above 0."""

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> float:
        number = super().convert(value, param, ctx)
        if number <= 0.0:
            self.fail(f"{value!r} is not above 0.", param, ctx)
        return number


_POSITIVE = _Positive()


@click.command("tradeoff")
@click.argument("scene")
@click.option(
    "-s", "--set", "settings", multiple=True, metavar="KEY=VALUE", help="Option of the scene."
)
@click.option("--integrators", help="Comma-separated; by default all that make sense.")
@click.option(
    "--groups",
    default="integrator,constraints,precision,storage",
    show_default=True,
    help="What is varied: also backend, model, readout, estimator; or all.",
)
@click.option("--target", type=_POSITIVE, help="Error that is wanted: says the cheapest setting.")
@click.option(
    "--metric",
    type=click.Choice(_METRICS),
    default="trajectory",
    show_default=True,
    help="What --target is an error of.",
)
@click.option(
    "--longest", type=_POSITIVE, default=5.0, show_default=True, help="CPU time of one run [s]."
)
@click.option("--budget", type=_POSITIVE, help="Time for all measurements [s].")
@click.option(
    "--rounds",
    type=click.IntRange(min=1),
    default=3,
    show_default=True,
    help="Timings that a CPU time is the median of.",
)
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    help="Folder for points, picture and config; the same command goes on in it.",
)
@json_option
def command(
    scene: str,
    settings: tuple[str, ...],
    integrators: str | None,
    groups: str,
    target: float | None,
    metric: str,
    longest: float,
    budget: float | None,
    rounds: int,
    out: Path | None,
    as_json: bool,
) -> None:
    """Measure what accuracy costs on SCENE, a name of `openprc scenes` or an experiment folder.

    Every setting is compared with a reference whose convergence is proven first. With --target
    the cheapest setting that reaches it is run once more, from a config that is written.
    """
    # Simulators are loaded when there is something to simulate.
    from openprc.tradeoff.recommendation import recommend  # noqa: PLC0415
    from openprc.tradeoff.settings import GROUPS  # noqa: PLC0415
    from openprc.tradeoff.study import Choices, run_study  # noqa: PLC0415
    from openprc.tradeoff.study_files import save_study  # noqa: PLC0415
    from openprc.tradeoff.subject import find_subject  # noqa: PLC0415

    if out is not None:
        refuse_file(out)
    choices = Choices(
        groups=GROUPS if groups == "all" else _names(groups),
        integrators=None if integrators is None else _names(integrators),
        target=target,
        metric=metric,
        longest=longest,
        budget=budget,
        rounds=rounds,
        folder=out,
    )
    subject = find_subject(scene, _pairs(settings))
    with progress_bar(subject.name, hidden=as_json) as progress:
        study = run_study(subject, choices, progress=progress)
        advice = None
        if target is not None:
            advice = recommend(study, target, metric=metric, folder=out, progress=progress)
    written = [] if out is None else save_study(study, advice, out)
    if as_json:
        told = study.as_dict() | {
            "recommendation": None if advice is None else advice.as_dict(),
            "written": [str(path) for path in written],
        }
        print_json(told)
    else:
        _show(study, advice, written)
    if advice is not None and not advice.reached:
        raise click.exceptions.Exit(1)


def _names(text: str) -> tuple[str, ...]:
    return tuple(dict.fromkeys(name.strip() for name in text.split(",") if name.strip()))


def _pairs(pairs: tuple[str, ...]) -> dict[str, str]:
    found: dict[str, str] = {}
    for pair in pairs:
        key, equals, value = pair.partition("=")
        if not equals or not key.strip():
            raise click.UsageError(f"--set takes KEY=VALUE, got {pair!r}")
        found[key.strip()] = value
    return found


# --- printing -----------------------------------------------------------------------------------


def _show(study: Study, advice: Recommendation | None, written: list[Path]) -> None:
    out = console()
    scene: Scene = study.scene
    out.print(f"{scene.name}: {study.reference.horizon:g} s of motion", markup=False)
    out.print(f"reference: {study.reference.sentence()}", markup=False)
    for note in study.reference.notes:
        out.print(f"note: {note}", markup=False)
    front = {id(point) for point in study.front}
    measured = [p for p in study.points if p.trajectory_error is not None or p.status != "ok"]
    measured.sort(key=lambda p: _order(p.group))
    rows = [_row(point, id(point) in front) for point in measured]
    columns = ["", "group", "setting", "error", "CPU ms", "evaluations", "bytes", "note"]
    out.print(table(columns, rows, title="settings; * on the Pareto front of error and CPU time"))
    scored = sorted((p for p in study.points if p.score_errors), key=lambda p: _order(p.group))
    figures = list(dict.fromkeys(name for point in scored for name in point.score_errors))
    if scored:
        out.print(
            table(
                ["group", "setting", "CPU ms", "bytes", *figures],
                [
                    [p.group, describe(p), _milliseconds(p), p.file_size,
                     *(p.score_errors.get(name) for name in figures)]
                    for p in scored
                ],
                title="errors of task scores",
            )
        )  # fmt: skip
    for line in study.left_out:
        out.print(f"left out: {line}", markup=False)
    if advice is not None:
        _show_advice(out, study, advice)
    for path in written:
        out.print(f"written: {path}", markup=False)


def _row(point: Point, on_front: bool) -> list[Any]:
    note = point.note if point.status == "ok" else f"{point.status}: {point.note}"
    return [
        "*" if on_front else "",
        point.group,
        describe(point),
        point.trajectory_error,
        _milliseconds(point),
        point.evaluations,
        point.file_size,
        note,
    ]


def _milliseconds(point: Point) -> float | None:
    return None if point.cpu_seconds is None else 1e3 * point.cpu_seconds


def _order(group: str) -> int:
    from openprc.tradeoff.settings import GROUPS  # noqa: PLC0415 - not for --help

    return GROUPS.index(group)


#: What of a setting its label does not say, in the words of the table.
_WORDS = {
    "steps_per_frame": "{} steps a frame",
    "tolerance": "tolerance {}",
    "constraint_tolerance": "to {}",
    "regularization": "penalty {}",
    "rows": "{} rows",
}


def describe(point: Point) -> str:
    """Return a setting in words."""
    said = [
        words.format(_number(point.setting[key]))
        for key, words in _WORDS.items()
        if point.setting.get(key) is not None
    ]
    return ", ".join([point.label, *said])


def _number(value: Any) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)


def _show_advice(out: Any, study: Study, advice: Recommendation) -> None:
    aim = f"an error of {advice.target:g} ({advice.metric})"
    for line in advice.rejected:
        out.print(f"rejected: {line}", markup=False)
    if not advice.reached:
        best = "nothing gave a result" if advice.point is None else (
            f"the most exact setting is {describe(advice.point)}, with an error of"
            f" {_error(advice):.3g}"
        )  # fmt: skip
        out.print(f"no setting reaches {aim}: {best}", markup=False)
        out.print(f"what limits it: {advice.limit}", markup=False)
        return
    point = advice.point
    assert point is not None  # noqa: S101 - told by `reached`
    cost = f"{1e3 * (point.cpu_seconds or 0.0):.3g} ms"
    count = "" if point.evaluations is None else f", {point.evaluations} evaluations"
    out.print(f"the cheapest setting for {aim}: {describe(point)} ({cost}{count})", markup=False)
    if "steps_per_frame" in point.setting:
        dt = study.scene.experiment.save_interval / point.setting["steps_per_frame"]
        out.print(f"time step: {dt:.6g} s", markup=False)
    out.print(
        f"verified: a run of its config over {study.reference.duration:g} s has an error of"
        f" {advice.verified_error:.3g} up to t = {study.reference.horizon:g} s",
        markup=False,
    )
    if advice.folder is not None:
        out.print(f"run it: openprc run {advice.folder}", markup=False)


def _error(advice: Recommendation) -> float:
    from openprc.tradeoff.pareto import error_by  # noqa: PLC0415 - light, but not for --help

    assert advice.point is not None  # noqa: S101 - the caller looked
    return error_by(advice.metric)(advice.point) or 0.0
