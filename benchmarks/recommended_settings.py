"""Which integrator and step to use for a folded sheet and for a lattice, at three accuracies.

    python benchmarks/recommended_settings.py [--scenes miura lattice] [--targets 1e-2 1e-4 1e-6]
                                              [--longest 5] [--rounds 3] [--json FILE]

The scenes are the sheet of 4 x 8 cells and the lattice of 10 x 10 nodes of
``engine_scenes.py``, for a second of free motion. One study a scene, as ``openprc tradeoff``
makes it, down to the smallest target; the recommendation for each target is then written as a
config, run from it, and compared with the reference, which is what "verified" means. CPU time is
that of the stepping in one thread, compiling and storing left out.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

from engine_scenes import make_scene, to_experiment
from rich.console import Console
from rich.progress import Progress
from rich.table import Table

from openprc.tradeoff.choices import Choices
from openprc.tradeoff.recommendation import Recommendation, recommend
from openprc.tradeoff.study import Study, run_study
from openprc.tradeoff.subject import as_scene

SCENES = {"miura": "miu4x8", "lattice": "lat10"}
DURATION, FRAME = 1.0, 0.05  # [s]
TARGETS = (1e-2, 1e-4, 1e-6)


def study_of(name: str, target: float, options: argparse.Namespace) -> Study:
    """Return the study of a scene around one target."""
    experiment = to_experiment(
        make_scene(SCENES[name]), duration=DURATION, save_interval=FRAME, dt=FRAME / 100
    )
    choices = Choices(
        groups=("integrator", "precision"),
        target=target,
        longest=options.longest,
        rounds=options.rounds,
    )
    return run_study(as_scene(experiment, name=name), choices)


def row(name: str, study: Study, advice: Recommendation) -> dict[str, Any]:
    """Return what the table says of a recommendation."""
    found = {"scene": name, "target": advice.target, "reached": advice.reached}
    found |= {"reference_uncertainty": study.reference.uncertainty, "limit": advice.limit}
    if advice.point is None:
        return found
    setting, point = dict(advice.point.setting), advice.point
    return found | {
        "setting": setting,
        "label": point.label,
        "step": FRAME / setting["steps_per_frame"] if "steps_per_frame" in setting else None,
        "tolerance": setting.get("tolerance"),
        "cpu_seconds": point.cpu_seconds,
        "evaluations": point.evaluations,
        "measured_error": point.trajectory_error,
        "verified_error": advice.verified_error,
    }


def shown(rows: list[dict[str, Any]]) -> Table:
    """Return the table."""
    table = Table(title=f"cheapest settings, {DURATION:g} s of motion", title_justify="left")
    for column in ("scene", "target", "integrator", "step or tolerance"):
        table.add_column(column, no_wrap=True)
    for column in ("CPU ms", "evaluations", "verified error"):
        table.add_column(column, justify="right", no_wrap=True)
    for found in rows:
        if not found["reached"]:
            table.add_row(found["scene"], f"{found['target']:.0e}", f"none: {found['limit']}")
            continue
        by = (
            f"{1e3 * found['step']:.4g} ms"
            if found["step"] is not None
            else f"tolerance {found['tolerance']:.2g}"
        )
        table.add_row(
            found["scene"],
            f"{found['target']:.0e}",
            found["label"],
            by,
            f"{1e3 * found['cpu_seconds']:.3g}",
            "-" if found["evaluations"] is None else f"{found['evaluations']:,}",
            f"{found['verified_error']:.2e}",
        )
    return table


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--scenes", nargs="+", choices=list(SCENES), default=list(SCENES))
    parser.add_argument("--targets", nargs="+", type=float, default=list(TARGETS))
    parser.add_argument("--longest", type=float, default=5.0, help="seconds of one run")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--json", type=Path, metavar="FILE")
    options = parser.parse_args()
    console = Console(width=max(Console().width, 120))
    rows: list[dict[str, Any]] = []
    with Progress(console=Console(stderr=True), transient=True) as progress:
        task = progress.add_task("", total=len(options.scenes) * len(options.targets))
        for name in options.scenes:
            for target in options.targets:
                progress.update(task, description=f"{name} to {target:g}")
                study = study_of(name, target, options)
                rows.append(row(name, study, recommend(study, target)))
                progress.advance(task)
    console.print(shown(rows))
    if options.json:
        options.json.write_text(json.dumps(rows, indent=2, allow_nan=False) + "\n")


if __name__ == "__main__":
    main()
