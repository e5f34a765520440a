"""``openprc compare``."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from openprc.cli.console import force_option, json_option, print_json, progress_bar
from openprc.cli.options import FINITE, parse_pairs, refuse_file
from openprc.schema.units import conversion_factor

if TYPE_CHECKING:
    from openprc.compare.report import Report
    from openprc.compare.studies import Choices

_EPILOG = """
After a producer come its settings, each after a colon: an integrator, float32, or KEY=VALUE with
dt, tolerance, constraint_tolerance, precision, or an option of the producer; for instance
demlat,demlat:verlet:dt=1e-4,pybullet:start=plain.
"""


def _alignment_options(function: Callable[..., None]) -> Callable[..., None]:
    options = (
        click.option(
            "--match", type=click.Choice(["auto", "label", "index", "assignment"]),
            help="How nodes of two files find each other.",
        ),
        click.option("--clock", metavar="CLOCK", help="auto, time, step, index, input, ..."),
        click.option(
            "--interpolant", type=click.Choice(["auto", "nearest", "linear", "cubic", "hermite"]),
            help="Between the frames of the finer file.",
        ),
        click.option(
            "--rigid-motion", type=click.Choice(["none", "first", "all"]),
            help="Move the other body as a rigid one onto the reference first.",
        ),
        click.option("--displacements", is_flag=True, help="Compare displacements, not places."),
        click.option("--time-shift", type=FINITE, metavar="SECONDS", help="Added to the other."),
        click.option("--start", type=FINITE, help="Of the part of the clock that is compared."),
        click.option("--stop", type=FINITE, help="Its end."),
        click.option("--segment", type=click.IntRange(min=8), help="Samples in one of a spectrum."),
    )  # fmt: skip
    for option in reversed(options):
        function = option(function)
    return function


@click.command("compare", epilog=_EPILOG)
@click.argument("files", nargs=-1, type=click.Path(path_type=Path))
@click.option("--scene", "scene_name", metavar="NAME", help="Run a body of the library.")
@click.option("-s", "scene_options", multiple=True, metavar="KEY=VALUE", help="Of the scene.")
@click.option("--experiment", type=click.Path(path_type=Path), help="Run your own folder.")
@click.option("--producers", metavar="A,B,C", help="Who runs it; the first is the reference.")
@click.option("--options", multiple=True, metavar="PRODUCER:KEY=VALUE", help="More settings.")
@click.option("--reference", metavar="NAME", help="The run that the others are compared with.")
@_alignment_options
@click.option(
    "--unit", type=click.Choice(["m", "cm", "mm", "um"]), default="m", show_default=True,
    help="Of the lengths in the table.",
)  # fmt: skip
@click.option("--tasks/--no-tasks", default=True, help="Compare what the runs compute.")
@click.option(
    "--twins/--no-twins", default=None,
    help="Run perturbed twins, which tell chaos; by default where runs differ.",
)  # fmt: skip
@click.option("--out", type=click.Path(path_type=Path), help="Folder for runs, JSON and page.")
@force_option
@json_option
def command(
    files: tuple[Path, ...],
    scene_name: str | None,
    experiment: Path | None,
    producers: str | None,
    unit: str,
    out: Path | None,
    force: bool,
    as_json: bool,
    **options: Any,
) -> None:
    """Say how much runs of one body differ: FILES, or a scene on several producers.

    The first file, or the known motion of the scene, is the reference.
    """
    _check_call(files, scene_name, experiment, producers, options)
    factor = conversion_factor("m", unit)
    kept = out if out is None else out.resolve()
    if kept is not None:
        refuse_file(kept)
    if kept is not None and not force:
        _refuse_results(kept, runs=not files)
    if files:
        report = _of_files(files, options, as_json=as_json)
    elif kept is not None:
        report = _of_scene(
            scene_name, experiment, producers, options, folder=kept, force=force, as_json=as_json
        )
    else:
        with tempfile.TemporaryDirectory(prefix="openprc-") as scratch:
            report = _of_scene(
                scene_name, experiment, producers, options,
                folder=Path(scratch), force=force, as_json=as_json,
            )  # fmt: skip
    written = [] if kept is None else _written(report, kept, force=force)
    if as_json:
        print_json({**report.as_dict(), "written": [str(path) for path in written]})
        return
    from openprc.cli.compare_tables import show_report  # noqa: PLC0415 - not for JSON

    show_report(report, unit=unit, factor=factor, written=written)


def _check_call(
    files: tuple[Path, ...],
    scene_name: str | None,
    experiment: Path | None,
    producers: str | None,
    options: dict[str, Any],
) -> None:
    """Refuse calls that mean two things at once, or nothing."""
    sources = [bool(files), scene_name is not None, experiment is not None]
    if sum(sources) != 1:
        raise click.UsageError(
            "name two files or more, or --scene NAME, or --experiment FOLDER: one of the three"
        )
    if files:
        for name, given in (
            ("--producers", producers),
            ("--options", options["options"]),
            ("-s", options["scene_options"]),
            ("--twins", options["twins"]),
        ):
            if given:
                raise click.UsageError(f"{name} needs --scene or --experiment: files are runs")
    elif producers is None:
        raise click.UsageError("say who runs it: --producers demlat,pybullet")
    if options["scene_options"] and scene_name is None:
        raise click.UsageError("-s is for --scene: an experiment folder says it all")


def _refuse_results(folder: Path, *, runs: bool) -> None:
    """Refuse a folder that holds results, before anything runs."""
    from openprc.schema.atomic import refuse_existing  # noqa: PLC0415 - with the work

    for name in ("comparison.json", "comparison.html", *(("input", "runs") if runs else ())):
        refuse_existing(folder / name)


def _choices(options: dict[str, Any]) -> Choices:
    from openprc.compare.alignment.settings import AlignmentSettings  # noqa: PLC0415 - work
    from openprc.compare.studies import Choices  # noqa: PLC0415 - likewise

    given = {
        name: options[name]
        for name in (
            "match", "clock", "interpolant", "rigid_motion", "time_shift", "start", "stop",
            "segment",
        )
        if options[name] is not None
    }  # fmt: skip
    if options["displacements"]:
        given["quantity"] = "displacements"
    return Choices(
        alignment=AlignmentSettings(**given),
        reference=options["reference"],
        tasks=options["tasks"],
        twins=options["twins"],
    )


def _of_files(files: tuple[Path, ...], options: dict[str, Any], *, as_json: bool) -> Report:
    from openprc.compare.studies import compare_runs  # noqa: PLC0415 - loads h5py and more

    choices = _choices(options)
    with progress_bar("comparing", hidden=as_json) as progress:
        return compare_runs(files, choices=choices, progress=progress)


def _of_scene(
    scene_name: str | None,
    experiment_folder: Path | None,
    producers: str | None,
    options: dict[str, Any],
    *,
    folder: Path,
    force: bool,
    as_json: bool,
) -> Report:
    from openprc.compare.runs.requests import read_requests  # noqa: PLC0415 - loads the plugins
    from openprc.compare.studies import compare_producers  # noqa: PLC0415 - likewise
    from openprc.scenes.catalog import build_scene, write_scene  # noqa: PLC0415 - likewise
    from openprc.schema.experiment import load_experiment  # noqa: PLC0415 - likewise

    requests = read_requests(producers or "", options=options["options"])
    choices = _choices(options)
    scene = None
    if scene_name is not None:
        scene = build_scene(scene_name, parse_pairs(options["scene_options"]))
        write_scene(scene, folder)
        experiment, title = load_experiment(folder), scene_name
    else:
        given = Path(str(experiment_folder))
        experiment, title = load_experiment(given), given.resolve().name
    with progress_bar(title, hidden=as_json) as progress:
        return compare_producers(
            experiment, requests, folder / "runs", scene=scene, title=title, choices=choices,
            overwrite=force, progress=progress,
        )  # fmt: skip


def _written(report: Report, folder: Path, *, force: bool) -> list[Path]:
    from openprc.compare.page.html import save_page  # noqa: PLC0415 - loads matplotlib

    folder.mkdir(parents=True, exist_ok=True)
    return [
        report.save(folder / "comparison.json", overwrite=force),
        save_page(report, folder / "comparison.html", overwrite=force),
    ]
