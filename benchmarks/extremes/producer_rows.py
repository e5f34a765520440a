"""Other producers on steps that are too long: nothing may end as a result."""

from __future__ import annotations

import math
import re
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from bodies import X, Y
from cells import TOLERANCE, Cell, Kind, all_finite
from report import messages, short
from rich.table import Table

from openprc.demlat.planning.stability import step_limit
from openprc.errors import Diverged, OpenPRCError, UnsupportedScene
from openprc.hooks import run_experiment
from openprc.hooks.registry import default_registry
from openprc.schema import Trajectory
from openprc.schema.bend_angle import bend_angles
from openprc.schema.experiment import Experiment, save_experiment
from openprc.schema.geometry import Bars, Bends, Geometry


@dataclass(frozen=True)
class Place:
    """A producer, and a step as a share of the limit of a scheme like Verlet's."""

    name: str
    level: str
    producer: str
    options: tuple[tuple[str, object], ...]
    fraction: float
    check: str


def todo() -> list[Place]:
    """Return every cell, of the producers that are installed."""
    known = {item.spec.name for item in default_registry().producers}
    places = []
    for producer, options in (("pybullet", ()), ("pyelastica", (("substeps", 1),))):
        if producer not in known:
            continue
        for fraction in (0.5, 0.95, 1.05, 1.5):
            for check in ("refuse", "warn"):
                level = f"{fraction:g} of the limit, {check}"
                places.append(Place("another producer", level, producer, options, fraction, check))
    return places


def cantilever() -> Experiment:
    """Return a slender rod of bars and bends that swings; it says what rods and nodes both can."""
    n, length = 11, 0.1
    bars = np.stack([np.arange(n - 1), np.arange(1, n)], axis=1)
    bends = np.stack([np.arange(n - 2), np.arange(1, n - 1), np.arange(2, n)], axis=1)
    positions = length * np.outer(np.arange(n), X)
    velocities = np.outer(np.linspace(0.0, 1.0, n) ** 2, Y)
    velocities[:2] = 0.0
    geometry = Geometry(
        positions=positions,
        velocities=velocities,
        masses=np.full(n, 0.01),
        fixed=np.arange(n) < 2,
        bars=Bars(indices=bars, stiffness=np.full(n - 1, 1e4), rest_length=np.full(n - 1, length)),
        bends=Bends(indices=bends, stiffness=np.full(n - 2, 1.0)),
    )
    return Experiment(geometry=geometry, duration=1.0, dt=1e-3, save_interval=1e-2)


def run(place: Place) -> Cell:
    """Run one cell."""
    scene = replace(cantilever(), integrator="verlet", step_check=place.check)
    dt = place.fraction * step_limit(scene).limit
    scene = replace(scene, dt=dt, save_interval=10 * dt, duration=2000 * dt)
    began = time.process_time()
    kind, error, at, texts = _outcome(place, scene)
    return Cell(
        name=place.name,
        level=place.level,
        integrator=place.producer,
        precision="float64",
        kind=kind,
        error=error,
        at=at,
        seconds=time.process_time() - began,
        messages=texts,
    )


def _outcome(
    place: Place, scene: Experiment
) -> tuple[Kind, float | None, float | None, tuple[str, ...]]:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        save_experiment(scene, folder)
        try:
            path = run_experiment(folder, producer=place.producer, options=dict(place.options)).path
        except Diverged as error:
            found = re.search(r"t = (\S+) s", error.found)
            finite = all_finite(folder / "output" / "simulation.h5.partial")
            kind: Kind = "diverged, told" if finite else "SILENT"
            return kind, None, float(found.group(1)) if found else None, (_words(error),)
        except UnsupportedScene as error:
            return "refused", None, None, (_words(error),)
        except OpenPRCError as error:
            return "SILENT", None, None, (_words(error),)
        with Trajectory(path) as trajectory:
            notes = tuple(trajectory.provenance["notes"])
            if not all_finite(path):
                return "SILENT", math.nan, None, ("not finite",)
            error = _gap(trajectory)
    if error <= TOLERANCE:
        return "accurate", error, None, notes
    told = any(" of energy by t = " in note for note in notes)
    return ("inaccurate, told" if told else "SILENT"), error, None, notes


def _gap(run: Trajectory) -> float:
    """Return the largest change of the energy over the largest kinetic energy.

    From the frames alone, as not every producer stores energies; nothing damps or drives the rod.
    """
    geometry = cantilever().geometry
    x, v = (np.zeros((run.n_frames, geometry.n_nodes, 3)) for _ in range(2))
    x[..., : run.dims], v[..., : run.dims] = run.positions(), run.velocities()
    kinetic = 0.5 * np.einsum("n,tna,tna->t", geometry.masses, v, v)
    i, j = geometry.bars.indices.T
    stretch = np.linalg.norm(x[:, j] - x[:, i], axis=2) - geometry.bars.rest_length
    turned = bend_angles(x, geometry.bends.indices) - geometry.bends.rest_angle
    total = kinetic + 0.5 * stretch**2 @ geometry.bars.stiffness
    total += 0.5 * turned**2 @ geometry.bends.stiffness
    return float(np.abs(total - total[0]).max() / kinetic.max())


def _words(error: OpenPRCError) -> str:
    return f"{error.found}; expected {error.expected}; {error.fix}"


def table(cells: Sequence[Cell]) -> Table:
    """Return the table of other producers."""
    made = Table(title="other producers, a swinging rod of 10 bars", title_justify="left")
    producers = list(dict.fromkeys(cell.integrator for cell in cells))
    for name in ("step", *producers):
        made.add_column(name)
    for level in dict.fromkeys(cell.level for cell in cells):
        by_name = {cell.integrator: cell for cell in cells if cell.level == level}
        made.add_row(level, *(short(by_name.get(name)) for name in producers))
    return made


def markdown(cells: Sequence[Cell]) -> str:
    """Return the same, and messages."""
    if not cells:
        return ""
    producers = list(dict.fromkeys(cell.integrator for cell in cells))
    lines = [["step", *producers], ["---"] * (1 + len(producers))]
    for level in dict.fromkeys(cell.level for cell in cells):
        by_name = {cell.integrator: cell for cell in cells if cell.level == level}
        lines.append([level, *(short(by_name.get(name)) for name in producers)])
    grid = "\n".join("| " + " | ".join(line) + " |" for line in lines)
    stops = [m for m in messages(cells) if m[0] != "remark"]
    told = "\n".join(f"- {kind} ({where}): {text}" for kind, text, _, where in stops)
    return f"\n## other producers\n\n{grid}\n\n{told}\n"
