"""What contact costs per step and node, from a hundred nodes to a hundred thousand.

    python benchmarks/contact_scaling.py [--most 100000] [--seconds 2] [--json]

*gas*: free nodes at a fixed density that bounce off each other. *sheet*: a crumpled sheet of
triangles without bars in the same kind of motion, every node of which may touch every face.
Each is stepped with and without contact in one run, taking turns; beside it stands one look at
all pairs (and all pairs of nodes and faces), which is what a step takes without cell lists.
Ratios count: "growth" is the cost per node relative to the first row.
"""

from __future__ import annotations

import argparse
import json
import time
from dataclasses import replace

import numba
import numpy as np
from rich.console import Console
from rich.table import Table

from openprc.demlat import BarHingeModel
from openprc.schema import Experiment
from openprc.schema.experiment import Collision
from openprc.schema.geometry import Geometry

STEP, STEPS = 1e-3, 50  # [s], in a frame
RADIUS = 0.2  # [m], in cells of 1 m3
SIZES = (100, 1_000, 10_000, 100_000)
#: All pairs are looked at up to this many.
MOST_PAIRS = 3e9


def gas(n: int) -> Experiment:
    """Return `n` nodes near the points of a cubic grid with random velocities."""
    rng = np.random.default_rng(1)
    side = int(np.ceil(n ** (1 / 3)))
    grid = np.stack(np.meshgrid(*[np.arange(float(side))] * 3, indexing="ij"), -1)
    positions = grid.reshape(-1, 3)[:n] + rng.uniform(-0.25, 0.25, (n, 3))
    return _experiment(positions, rng.normal(size=(n, 3)), np.zeros((0, 3), int), RADIUS)


def sheet(n: int) -> Experiment:
    """Return a wavy sheet of about `n` nodes whose waves run into each other."""
    rng = np.random.default_rng(1)
    side = round(n**0.5)
    u, w = np.meshgrid(np.arange(float(side)), np.arange(float(side)), indexing="ij")
    positions = np.stack([u, w, 0.3 * np.sin(0.7 * u) * np.cos(0.6 * w)], -1).reshape(-1, 3)
    number = np.arange(side * side).reshape(side, side)
    a, b, c, d = number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]
    faces = np.stack([np.stack([a, b, c], -1), np.stack([a, c, d], -1)], 2).reshape(-1, 3)
    return _experiment(positions, 0.3 * rng.normal(size=positions.shape), faces, 0.1)


def _experiment(positions: np.ndarray, velocities: np.ndarray, faces: np.ndarray, radius: float):  # noqa: ANN202
    geometry = Geometry(
        positions=positions,
        velocities=velocities,
        masses=np.ones(len(positions)),
        collidable=np.ones(len(positions), bool),
        faces=faces,
    )
    return Experiment(
        geometry=geometry,
        duration=1e6,
        dt=STEP,
        save_interval=STEP * STEPS,
        collision=Collision(enabled=True, radius=radius, faces=len(faces) > 0),
    )


@numba.njit(fastmath=True)
def count_near(points: np.ndarray, others: np.ndarray, reach: float) -> int:
    """Count others that are nearer than `reach`, looking at each point and each other."""
    count = 0
    for i in range(len(points)):
        for j in range(len(others)):
            dx = points[i, 0] - others[j, 0]
            dy = points[i, 1] - others[j, 1]
            dz = points[i, 2] - others[j, 2]
            count += dx * dx + dy * dy + dz * dz < reach * reach
    return count


def time_per_step(experiments: list[Experiment], seconds: float) -> list[float]:
    """Return the processor time of a step [s] of each, from frames taken in turns: the median."""
    runs = []
    for experiment in experiments:
        # One frame a block, so that there is a clock reading for each.
        few = replace(experiment, duration=experiment.save_interval * 100_000)
        model = BarHingeModel(few)
        model._buffer = _one_frame(model._buffer)
        runs.append(model.blocks())
        next(runs[-1])
        next(runs[-1])
    taken: list[list[float]] = [[] for _ in runs]
    start = time.perf_counter()
    while time.perf_counter() - start < seconds or len(taken[0]) < 3:
        for run, times in zip(runs, taken, strict=True):
            before = time.process_time()
            next(run)
            times.append((time.process_time() - before) / STEPS)
    return [float(np.median(times)) for times in taken]


def _one_frame(make):  # noqa: ANN001, ANN202
    def buffer(assembly):  # noqa: ANN001, ANN202
        whole = make(assembly)
        return type(whole)(*(column[:1] for column in whole))

    return buffer


def measure(name: str, n: int, seconds: float) -> dict[str, float | str | int]:
    """Return one row of the table."""
    scene = {"gas": gas, "sheet": sheet}[name](n)
    positions, faces = scene.geometry.positions, scene.geometry.faces
    n = len(positions)
    with_contact, without = time_per_step([scene, replace(scene, collision=Collision())], seconds)
    others = positions if not len(faces) else np.concatenate([positions, positions[faces].mean(1)])
    all_pairs = float("nan")
    if n * len(others) <= MOST_PAIRS:
        count_near(positions[:2], others[:2], 1.0)
        before = time.process_time()
        count_near(positions, others, RADIUS)
        # Every pair of nodes once, not twice.
        all_pairs = (time.process_time() - before) * (1.0 - 0.5 * n / len(others))
    contact = with_contact - without
    return {
        "scene": name,
        "nodes": n,
        "faces": len(faces),
        "step_us": 1e6 * with_contact,
        "contact_ns_per_node": 1e9 * contact / n,
        "contact_to_rest": contact / without,
        "all_pairs_to_contact": all_pairs / contact,
    }


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--most", type=int, default=SIZES[-1])
    parser.add_argument("--seconds", type=float, default=2.0)
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    rows = []
    for name in ("gas", "sheet"):
        first = None
        for n in SIZES:
            if n > options.most:
                break
            row = measure(name, n, options.seconds)
            first = first or row["contact_ns_per_node"]
            row["growth"] = row["contact_ns_per_node"] / first
            rows.append(row)
    if options.json:
        print(json.dumps(rows, indent=2))
        return
    table = Table(title="contact, a step of rk4")
    for column in rows[0]:
        table.add_column(column.replace("_", " "), justify="left" if column == "scene" else "right")
    for row in rows:
        table.add_row(*(f"{v:.3g}" if isinstance(v, float) else f"{v}" for v in row.values()))
    Console(width=140).print(table)


if __name__ == "__main__":
    main()
