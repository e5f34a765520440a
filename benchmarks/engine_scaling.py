"""Time per element and memory per node, from a hundred elements to a million.

    python benchmarks/engine_scaling.py [--largest 1000000] [--json FILE]

Square lattices with both diagonals and Miura sheets, classical Runge-Kutta in float64, one
thread. Sizes take turns over the rounds, so that a slow spell of the machine hits all of them;
what counts is the last column, time per element and step relative to the smallest size that
fills the vectors. Memory is what the tables, the state and the scheme hold while stepping; the
buffer of saved frames, whose size is bounded, is listed beside it.
"""

from __future__ import annotations

import argparse
import json
import math
import time
import tracemalloc
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from openprc.demlat import meshing
from openprc.demlat.integrators import INTEGRATORS, Settings
from openprc.demlat.integrators.stepping import FixedControl, advance
from openprc.demlat.models.barhinge.assembly import assemble
from openprc.demlat.models.barhinge.tables import LEDGER_STRIDE, FrameBuffer
from openprc.schema.experiment import Experiment
from openprc.schema.geometry import Bars, Geometry, Hinges

WORK = 4_000_000  # element updates in a round


def lattice(n_elements: int) -> Geometry:
    """Return a lattice with about so many bars."""
    n = max(3, round(math.sqrt(n_elements / 4)))
    mesh = meshing.square_lattice(n, n, spacing=0.1, diagonals="both")
    return geometry(mesh)


def miura(n_elements: int) -> Geometry:
    """Return a Miura sheet with about so many bars and hinges."""
    n = max(1, round(math.sqrt(n_elements / 24)))
    mesh = meshing.miura_sheet(n, n, a=0.1, b=0.1, sector_angle=1.0, tilt=0.6)
    return geometry(mesh)


def geometry(mesh: Any) -> Geometry:
    """Return a mesh with masses and stiffnesses, its start a little out of shape."""
    x = np.array(mesh.positions)
    lengths = np.linalg.norm(x[mesh.bars[:, 1]] - x[mesh.bars[:, 0]], axis=1)
    moved = x + 1e-4 * np.sin(np.arange(x.size).reshape(x.shape))
    n_bars, n_hinges = len(mesh.bars), len(mesh.hinges)
    return Geometry(
        positions=moved,
        masses=np.full(len(x), 0.01),
        fixed=np.arange(len(x)) == 0,
        bars=Bars(
            indices=mesh.bars,
            stiffness=np.full(n_bars, 200.0),
            rest_length=lengths,
            damping=np.full(n_bars, 0.01),
        ),
        hinges=Hinges(
            indices=mesh.hinges,
            stiffness=np.full(n_hinges, 0.01),
            rest_angle=mesh.rest_angles,
        ),
    )


def held_bytes(*tables: Any) -> int:
    """Return the bytes of all arrays in nested tuples, each once."""
    seen: dict[int, int] = {}

    def walk(value: Any) -> None:
        if isinstance(value, np.ndarray):
            seen[id(value)] = value.nbytes
        elif isinstance(value, tuple):
            for part in value:
                walk(part)

    walk(tables)
    return sum(seen.values())


def prepare(body: Geometry) -> tuple[Callable[[int], None], dict[str, Any]]:
    """Return what steps the body, and what is known about it."""
    experiment = Experiment(geometry=body, duration=1e-3, dt=1e-3, save_interval=1e-3, damping=0.01)
    tracemalloc.start()
    began = time.process_time()
    assembly = assemble([experiment])
    settings = Settings(h=1e-3 / assembly.scaler.time, frame_time=1e-3 / assembly.scaler.time)
    scheme = INTEGRATORS["rk4"].load().for_body(assembly.body, settings)
    assembled = time.process_time() - began
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    frames = FrameBuffer.for_frames(
        1,
        n_nodes=body.n_nodes,
        dims=assembly.packing.dims,
        n_bars=len(body.bars),
        n_hinges=len(body.hinges),
    )
    energy = np.zeros(4 * LEDGER_STRIDE)

    def run(n_steps: int) -> None:
        control = FixedControl(settings.frame_time, n_steps, settings.h, np.inf)
        unit = assembly.scaler.output
        advance(scheme, assembly.body, assembly.state, energy, control, 0, 1, unit, frames)

    n_elements = len(body.bars) + len(body.hinges)
    facts = {
        "nodes": body.n_nodes,
        "elements": n_elements,
        "bytes_per_node": held_bytes(assembly.body, assembly.state, scheme) / body.n_nodes,
        "frame_bytes_per_node": held_bytes(frames) / body.n_nodes,
        "peak_bytes_per_node": peak / body.n_nodes,
        "assembly_ns_per_element": 1e9 * assembled / n_elements,
    }
    return run, facts


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--largest", type=int, default=1_000_000)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    console = Console()
    report = {}
    for name, make in (("square lattice", lattice), ("Miura sheet", miura)):
        sizes = [10**p for p in range(2, 8) if 10**p <= options.largest]
        runs = [prepare(make(size)) for size in sizes]
        steps = [max(1, WORK // (4 * facts["elements"])) for _, facts in runs]
        for (run, _), count in zip(runs, steps, strict=True):
            run(min(count, 3))  # compiles
        times: list[list[float]] = [[] for _ in runs]
        for _ in range(options.rounds):
            for (run, facts), count, found in zip(runs, steps, times, strict=True):
                began = time.process_time()
                run(count)
                found.append((time.process_time() - began) / count / facts["elements"])
        rows = [
            facts | {"ns_per_element_and_step": 1e9 * float(np.median(found))}
            for (_, facts), found in zip(runs, times, strict=True)
        ]
        reference = next(r for r in rows if r["elements"] >= 500)["ns_per_element_and_step"]
        table = Table(title=name)
        for heading in (
            "elements",
            "nodes",
            "ns/element/step",
            "relative",
            "B/node",
            "+ frame",
            "peak B/node",
        ):
            table.add_column(heading, justify="right")
        for row in rows:
            row["relative"] = row["ns_per_element_and_step"] / reference
            table.add_row(
                f"{row['elements']}",
                f"{row['nodes']}",
                f"{row['ns_per_element_and_step']:.2f}",
                f"{row['relative']:.2f}",
                f"{row['bytes_per_node']:.0f}",
                f"{row['frame_bytes_per_node']:.0f}",
                f"{row['peak_bytes_per_node']:.0f}",
            )
        console.print(table)
        report[name] = rows
    if options.json:
        options.json.write_text(json.dumps(report, indent=2) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
