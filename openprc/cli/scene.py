"""``openprc scene``."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from openprc.cli.blame import reading
from openprc.cli.console import console, force_option, json_option, print_json, table
from openprc.cli.options import pairs_option, parse_pairs, refuse_file
from openprc.errors import ResultExists
from openprc.scenes.catalog import build_scene, find_scene, scene_options, write_scene

if TYPE_CHECKING:
    from rich.console import Console

    from openprc.scenes.scene import Scene
    from openprc.scenes.verification import ProbeResult


@click.command("scene")
@click.argument("name")
@click.option("--out", type=click.Path(path_type=Path), help="Folder for the experiment.")
@pairs_option("scene")
@click.option(
    "--check",
    "run",
    type=click.Path(path_type=Path),
    help="A run of the scene, to be held against what is known.",
)
@force_option
@json_option
@click.pass_context
def command(
    ctx: click.Context,
    name: str,
    out: Path | None,
    options: tuple[str, ...],
    run: Path | None,
    force: bool,
    as_json: bool,
) -> None:
    """Write the body NAME of the library as an experiment folder, and say what is known of it.

    With --check a run of it is held against that; exit code 1 when it deviates by more than the
    tolerances. Give the same options as for --out then.
    """
    if out is not None and run is not None:
        raise click.UsageError("--out writes the scene and --check checks a run: one at a time")
    values = scene_options(name, parse_pairs(options))
    scene = build_scene(name, values)
    if run is not None:
        ctx.exit(_check(scene, run, as_json=as_json))
    files: tuple[Path, ...] = ()
    if out is not None:
        refuse_file(out)
        _refuse_existing(out, force=force)
        files = write_scene(scene, out)
    described = _described(scene, values)
    commands = _commands(described, out, options)
    if as_json:
        print_json(described | {"files": [str(f) for f in files], "commands": commands})
    else:
        _show(described, commands, written=out)


def _refuse_existing(folder: Path, *, force: bool) -> None:
    """Refuse a folder that holds an experiment, wherever `openprc run` would find it."""
    if force:
        return
    for place in (folder / "input", folder):
        for file in ("geometry.h5", "config.json"):
            if (place / file).exists():
                raise ResultExists(
                    "there is an experiment in this folder already",
                    expected="a new folder",
                    fix="give another --out, or --force to replace its input files",
                    file=place / file,
                )


# --- what is known ------------------------------------------------------------------------------


def _described(scene: Scene, values: dict[str, Any]) -> dict[str, Any]:
    # Asking producers loads their code.
    from openprc.scenes.requirements import physics_of, producer_verdicts  # noqa: PLC0415

    spec, experiment, known = find_scene(scene.name), scene.experiment, scene.reference
    return {
        "name": scene.name,
        "summary": spec.summary,
        "needs": list(spec.needs),
        "options": values,
        "experiment": {
            "n_nodes": experiment.geometry.n_nodes,
            "physics": [item.as_dict() for item in physics_of(experiment)],
            "duration": experiment.duration,
            "dt": experiment.dt,
            "save_interval": experiment.save_interval,
            "n_frames": experiment.n_frames,
            "integrator": experiment.integrator,
        },
        "reference": {
            "kind": known.kind,
            "text": known.text,
            "source": known.source,
            "exact": known.exact is not None,
            "probes": [
                {
                    "name": probe.name,
                    "value": probe.value,
                    "unit": probe.unit,
                    "tolerance": probe.tolerance,
                    "source": probe.source,
                }
                for probe in known.probes
            ],
        },
        "scale": scene.scale,
        "chaotic": scene.chaotic,
        "quasi_static": scene.quasi_static,
        "input_name": scene.input_name,
        "features": scene.features,
        "producers": [verdict.as_dict() for verdict in producer_verdicts(experiment)],
        "run_options": {who: dict(given) for who, given in spec.run_options.items()},
    }


def _commands(
    described: dict[str, Any], out: Path | None, options: tuple[str, ...]
) -> dict[str, Any]:
    """Return what to type next: to write, to run with each producer, and to check."""
    name, folder = described["name"], shlex.quote(str(out)) if out else "DIR"
    chosen = "".join(f" -o {shlex.quote(pair)}" for pair in options)
    runs = {}
    for verdict in described["producers"]:
        who = verdict["producer"]
        if verdict["state"] == "runs":
            more = described["run_options"].get(who, {})
            extra = "".join(f" -o {key}={value}" for key, value in more.items())
            runs[who] = f"openprc run {folder} --producer {who}{extra}"
    return {
        "write": f"openprc scene {name} --out {folder}{chosen}",
        "run": runs,
        "check": f"openprc scene {name} --check {folder}/output/simulation.h5{chosen}",
    }


def _show(described: dict[str, Any], commands: dict[str, Any], *, written: Path | None) -> None:
    out, known = console(), described["reference"]
    experiment = described["experiment"]
    manner = "chaotic" if described["chaotic"] else ""
    manner = "a path of equilibria, followed slowly" if described["quasi_static"] else manner
    rows = [
        ("what", described["summary"]),
        ("options", "  ".join(f"{key}={value}" for key, value in described["options"].items())),
        ("physics", ", ".join(f"{p['count']} {p['name']}" for p in experiment["physics"])),
        (
            "time",
            f"{experiment['duration']:g} s in steps of {experiment['dt']:.4g} s"
            f" ({experiment['integrator']}), {experiment['n_frames']} frames",
        ),
        *([("motion", manner)] if manner else []),
        ("known by", f"{known['kind']}: {known['text']}"),
        ("source", known["source"]),
        ("deviations are over", f"{described['scale']:.4g} m"),
        *([("input of tasks", described["input_name"])] if described["input_name"] else []),
        *([("features", described["features"])] if described["features"] else []),
    ]
    out.print(table([described["name"], "" if written is None else str(written)], rows))
    out.print(
        table(
            ["a run has to give", "value", "unit", "within"],
            [[p["name"], p["value"], p["unit"], p["tolerance"]] for p in known["probes"]],
        )
    )
    out.print(
        table(
            ["producer", "", "why, or what to mind"],
            [[v["producer"], v["state"], v["text"]] for v in described["producers"]],
        )
    )
    todo = [] if written is not None else [commands["write"]]
    for line in (*todo, *commands["run"].values(), commands["check"]):
        out.print(line, markup=False, soft_wrap=True)


# --- a run --------------------------------------------------------------------------------------


def _check(scene: Scene, run: Path, *, as_json: bool) -> int:
    from openprc.scenes.verification import verify_scene  # noqa: PLC0415 - reads HDF5
    from openprc.schema.trajectory import Trajectory  # noqa: PLC0415 - as above

    with reading(run), Trajectory(run) as trajectory:
        results = verify_scene(scene, trajectory)
    passed = all(result.ok for result in results)
    if as_json:
        print_json(
            {
                "scene": scene.name,
                "file": str(run),
                "ok": passed,
                "probes": [result.as_dict() for result in results],
            }
        )
    else:
        _show_results(console(), scene.name, results)
    return 0 if passed else 1


def _show_results(out: Console, name: str, results: list[ProbeResult]) -> None:
    rows = [
        [
            result.probe.name,
            f"{result.probe.value:.10g}",
            f"{result.measured:.10g}",
            result.probe.unit,
            result.deviation,
            result.probe.tolerance,
            "yes" if result.ok else "NO",
        ]
        for result in results
    ]
    columns = [name, "expected", "measured", "unit", "deviation", "within", "holds"]
    out.print(table(columns, rows))
    failed = sum(not result.ok for result in results)
    if failed:
        out.print(
            f"{failed} of {len(results)} do not hold: is the run of this scene, with these options,"
            " and by a producer that models all of it?",
            markup=False,
        )
