"""``openprc inspect``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from openprc.cli.console import (
    console,
    force_option,
    json_option,
    json_text,
    print_findings,
    print_json,
    spinner,
    table,
)
from openprc.errors import ConfigError

if TYPE_CHECKING:
    from rich.console import Console

    from openprc.compare.inspection import Inspection
    from openprc.demlat.planning.step_table import SchemeStep
    from openprc.scenes.requirements import ProducerVerdict
    from openprc.schema.experiment import Experiment


_STEPS = "steps: how long they may be, and what a stable run costs (accuracy: openprc tradeoff)"


@click.command("inspect")
@click.argument("experiment", type=click.Path(path_type=Path))
@click.option("--integrator", help="Instead of the one in config.json.")
@click.option("--out", type=click.Path(path_type=Path), help="Also write the JSON to this file.")
@force_option
@json_option
def command(
    experiment: Path, integrator: str | None, out: Path | None, force: bool, as_json: bool
) -> None:
    """Say what EXPERIMENT needs, who can run it, how long a step may be, and what is odd.

    EXPERIMENT is a folder, of the present layout or the older one, or the name of a scene of the
    library. Nothing is run.
    """
    from openprc.compare.inspection import inspect_experiment, with_integrator  # noqa: PLC0415
    from openprc.schema.atomic import atomic_file, refuse_existing  # noqa: PLC0415 - light help

    if out is not None and not force:
        refuse_existing(out)
    with spinner(f"looking at {experiment.name}", hidden=as_json):
        scene = with_integrator(_found(experiment), integrator)
        seen = inspect_experiment(scene, name=str(experiment))
    data = seen.as_dict()
    if out is not None:
        with atomic_file(out, overwrite=force) as partial:
            partial.write_text(json_text(data) + "\n", encoding="utf-8")
    if as_json:
        print_json(data)
        return
    _show(seen, console())
    if out is not None:
        click.echo(f"written: {out}")


def _found(path: Path) -> Experiment:
    from openprc.scenes.catalog import SCENES, build_scene  # noqa: PLC0415 - light help
    from openprc.schema.experiment import load_experiment  # noqa: PLC0415 - reads HDF5

    if path.exists():
        return load_experiment(path)
    name = str(path)
    if name in SCENES:
        return build_scene(name).experiment
    import difflib  # noqa: PLC0415 - only a mistyped name pays for it

    near = difflib.get_close_matches(name, SCENES, n=1)
    raise ConfigError(
        f"there is no folder and no scene {name!r}",
        expected="a folder with input/geometry.h5, or one of " + ", ".join(SCENES),
        fix=f"did you mean {near[0]!r}?" if near else "see `openprc scenes`",
        file=path,
    )


def _show(seen: Inspection, out: Console) -> None:
    rows = [[item.name, item.count, item.text] for item in seen.physics]
    out.print(table(["physics", "count", "which"], rows, title=f"{seen.name}: what it uses"))
    out.print(
        table(
            ["producer", "can run it", "leaves out", "adds", "why, or what to mind"],
            [_producer(item) for item in seen.producers],
            title="who can run it",
        )
    )
    if seen.terms:
        rows = [[item.name, item.state, item.text] for item in seen.terms]
        out.print(table(["term", "of the loop", "how"], rows, title="what the engine compiles"))
    if seen.steps:
        columns = ["integrator", "order", "limit [s]", "set by", "recommended [s]",
                   "present step", "evaluations", "time [s]"]  # fmt: skip
        rows = [_step(item) for item in seen.steps]
        out.print(table(columns, rows, title=_STEPS))
    if seen.plan is not None:
        out.print(table(["plan", "with the settings as they are"], seen.plan.rows()))
    _show_motions(seen, out)
    for note in dict.fromkeys([*seen.notes, *(seen.plan.remarks if seen.plan else ())]):
        out.print(f"note: {note}", markup=False)
    print_findings(out, seen.findings)
    for item in seen.producers:
        if item.state == "refuses" and item.findings:
            out.print(f"{item.producer} refuses:", markup=False)
            print_findings(out, [f for f in item.findings if f.level == "error"])


def _producer(item: ProducerVerdict) -> list[str]:
    state = {"runs": "yes", "refuses": "no", "unavailable": "not installed"}.get(
        item.state, "broken"
    )
    none = "nothing" if item.state == "runs" else "-"
    return [
        item.producer,
        state,
        _lines(item.leaves_out) or none,
        _lines(item.adds) or none,
        item.text or "-",
    ]


def _lines(texts: tuple[str, ...]) -> str:
    if len(texts) < 2:
        return "".join(texts)
    return "\n".join(f"- {text}" for text in texts)


def _step(item: SchemeStep) -> list[object]:
    return [
        item.integrator,
        item.order,
        "none" if item.limit is None else f"{item.limit:.4g}",
        item.set_by or "-",
        "chooses its own" if item.recommended is None else f"{item.recommended:.4g}",
        item.verdict,
        # The bars of respa take more, shorter steps inside.
        f"{item.cost.evaluations:,}" + (" + bars" if item.integrator == "respa" else ""),
        f"{item.cost.seconds:.2g}",
    ]


def _show_motions(seen: Inspection, out: Console) -> None:
    motions = seen.motions
    if motions is None:
        return
    rows = [
        ["free coordinates", f"{motions.n_free:,}"],
        ["strains (rows of the rigidity matrix)", f"{motions.n_rows:,}, rank {motions.rank:,}"],
        ["states of self-stress", f"{motions.n_redundant:,}"],
        ["mechanisms", f"{motions.n_mechanisms:,}"],
        ["motions of pieces as a whole", f"{motions.n_whole:,}"],
        ["redundant rigid elements", f"{motions.n_redundant_rigid:,}"],
        *([motion.kind, motion.text] for motion in motions.shown),
    ]
    out.print(table(["motions that strain nothing", ""], rows))
