"""``openprc info``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from openprc.cli.blame import reading
from openprc.cli.console import console, json_option, print_json, table
from openprc.schema.describe import describe
from openprc.schema.experiment import load_experiment


@click.command("info")
@click.argument("path", type=click.Path(path_type=Path))
@json_option
def command(path: Path, as_json: bool) -> None:
    """Show what PATH, a file of the package or an experiment folder, holds."""
    with reading(path):
        outline = _experiment(path) if path.is_dir() else describe(path)
    if as_json:
        print_json(outline)
        return
    out = console()
    out.print(table(["what", "value"], _rows(outline)))


def _experiment(path: Path) -> dict[str, Any]:
    scene = load_experiment(path)
    geometry = scene.geometry
    return {
        "path": str(path),
        "kind": "experiment",
        "layout": scene.layout,
        "n_nodes": geometry.n_nodes,
        "n_bars": len(geometry.bars),
        "n_hinges": len(geometry.hinges),
        **({"n_bends": len(geometry.bends)} if len(geometry.bends) else {}),
        "duration": scene.duration,
        "dt": scene.dt if scene.dt_stated else None,
        "save_interval": scene.save_interval,
        "integrator": scene.integrator,
        "accuracy": scene.accuracy,
        "gravity": list(scene.gravity),
        "damping": scene.damping,
        "signals": sorted(scene.signals),
        "actuators": [f"{a.type} {a.signal} on node {a.node}" for a in scene.actuators],
        "notes": list(scene.notes),
    }


def _rows(outline: dict[str, Any], prefix: str = "") -> list[list[str]]:
    rows: list[list[str]] = []
    for key, value in outline.items():
        name = f"{prefix}{key}"
        if isinstance(value, dict):
            rows += _rows(value, f"{name}.")
        elif isinstance(value, list) and value and isinstance(value[0], dict):
            rows += [[name, ", ".join(f"{k} {v}" for k, v in item.items())] for item in value]
        elif isinstance(value, list):
            rows.append([name, ", ".join(str(item) for item in value) or "none"])
        else:
            rows.append([name, "-" if value is None else str(value)])
    return rows
