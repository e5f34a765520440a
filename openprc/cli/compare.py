"""``openprc compare``."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from openprc.cli.console import force_option, json_option, print_json, progress_bar
from openprc.cli.options import FINITE, parse_pairs

if TYPE_CHECKING:
    from openprc.compare.report import Report
    from openprc.compare.studies import Choices

_EPILOG = """
After a producer come its settings, each after a colon: an integrator, float32, or KEY=VALUE with
dt, tolerance, constraint_tolerance, precision, or an option of the producer; for instance
demlat,demlat:verlet:dt=1e-4,pybullet:start=plain.
"""


def _alignment_options(function: Callable[..., None]) -> Callable[..., None]:
    for option in (
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
    ):  # fmt: skip
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
@click.option("--unit", default="m", show_default=True, help="Of the lengths that are printed.")
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
    from openprc.schema.units import convert_length  # noqa: PLC0415

    _check_call(files, scene_name, experiment, producers, options)
    factor = convert_length(unit)
    kept = out if out is None else out.resolve()
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
