"""One scene on every back end that this machine has: time of a step, and how much of the device.

    python benchmarks/backends.py [--scenes lat10 lat100] [--seconds 3] [--large 300]
                                  [--json FILE]

Each back end integrates the same experiment (RK4 in float64, every tenth step saved), compiled
before the clock starts; wall time of a step, with saving. Ratios are to the compiled CPU
kernels (one thread) in the same run, and the table says how far positions after five frames
differ from theirs, over the size of the scene. ``--large N`` adds an N x N lattice, for which
devices are made.

Of CUDA the table also gives the bytes that a step has to move at least, a second, over what
copying a large array on the same device moves: 1 would be a step that does nothing but read
and write each of its numbers once.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from engine_scenes import Scene, lattice, make_scene, to_experiment
from rich.console import Console
from rich.table import Table

from openprc.demlat import BarHingeModel
from openprc.demlat.backends import choose_backend
from openprc.errors import OpenPRCError

STEPS_PER_FRAME = 10
N_FRAMES = 1_000_000  # more than there is time for
COPY_BYTES = 1 << 29
REPEATS = 20
#: Frames after which positions are compared, over the size of the scene.
COMPARED = 5


def seconds_a_step(blocks: Iterator[Any], seconds: float) -> float:
    """Return what a step takes, timed for at least that many seconds after compiling."""
    for _ in range(2):  # t = 0, and a block that compiles
        next(blocks)
    timed, frames = 0.0, 0
    while timed < seconds:
        began = time.perf_counter()
        _, block = next(blocks)
        timed += time.perf_counter() - began
        frames += len(block.x)
    return timed / frames / STEPS_PER_FRAME


def last_frame(scene: Scene, backend: str, count: int) -> np.ndarray:
    """Return positions of frame number `count`: (N, 2), as planar scenes have no z on the CPU."""
    dt = scene.dt / 2
    interval = STEPS_PER_FRAME * dt
    experiment = to_experiment(scene, duration=count * interval, save_interval=interval, dt=dt)
    last = np.zeros(0)
    for _, block in BarHingeModel(experiment, backend=backend).blocks():
        last = block.x[-1, :, :2].copy()
    return last


def traffic(scene: Scene) -> int:
    """Return the bytes that a step of the CUDA kernels moves at least.

    Of an element and stage: nodes, parameters, what its ends get, and its loss, read and
    written; of a node: its stage read once for the elements; ends and their list; position,
    velocity, stage and sums, its constants, its work and loss, and where its drives are.
    """
    n, m, k = scene.size
    bar = 12 + 5 * 8 + 24 + 2 * 8
    hinge = 20 + 9 * 8 + 4 * 24 + 2 * 8
    ends = (2 * m + 4 * k) * (24 + 4)
    node = 48 + (48 + 2 * 48 + 2 * 48) + 9 * 8 + 4 * 8 + 4 + 12 + 12
    return 4 * (m * bar + k * hinge + ends + n * node)


def copy_rate() -> float:
    """Return the bytes a second that a copy on the CUDA device reads and writes."""
    from numba import cuda  # noqa: PLC0415 - only where there is a device

    source = cuda.device_array(COPY_BYTES, np.uint8)
    target = cuda.device_array(COPY_BYTES, np.uint8)
    target.copy_to_device(source)
    cuda.synchronize()
    began = time.perf_counter()
    for _ in range(REPEATS):
        target.copy_to_device(source)
    cuda.synchronize()
    return 2 * COPY_BYTES * REPEATS / (time.perf_counter() - began)


def measure(scene: Scene, seconds: float) -> list[dict[str, Any]]:
    """Return a row for each back end that can run the scene."""
    dt = scene.dt / 2
    interval = STEPS_PER_FRAME * dt
    experiment = to_experiment(scene, duration=N_FRAMES * interval, save_interval=interval, dt=dt)
    reference = last_frame(scene, "cpu", COMPARED)
    size = float(np.ptp(scene.positions, axis=0).max())
    rows: list[dict[str, Any]] = []
    for backend in ("cpu", "jax", "cuda"):
        row: dict[str, Any] = {"scene": scene.name, "backend": backend}
        rows.append(row)
        try:
            choice = choose_backend(experiment, backend)
        except OpenPRCError as error:
            row["left out"] = error.found
            continue
        if choice.name != backend:
            row["left out"] = "not on this machine"
            continue
        blocks = BarHingeModel(experiment, backend=backend).blocks()
        row["step"] = seconds_a_step(blocks, seconds)
        row["ratio"] = rows[0]["step"] / row["step"]
        row["difference"] = float(np.abs(last_frame(scene, backend, COMPARED) - reference).max())
        row["difference"] /= size
        if backend == "cuda":
            row["bytes a second"] = traffic(scene) / row["step"]
            row["of the device"] = row["bytes a second"] / copy_rate()
    return rows


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--scenes", nargs="+", default=["lat10", "lat100", "miu4x8", "miu20"])
    parser.add_argument("--large", type=int, default=0, metavar="N")
    parser.add_argument("--seconds", type=float, default=2.0)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    scenes = [make_scene(name) for name in options.scenes]
    if options.large:
        scenes.append(lattice(f"lat{options.large}", n=options.large))
    rows = [row for scene in scenes for row in measure(scene, options.seconds)]
    table = Table("scene", "backend", "µs a step", "x cpu", "differs by", "GB/s", "of a copy")
    for row in rows:
        if "left out" in row:
            table.add_row(row["scene"], row["backend"], row["left out"])
            continue
        table.add_row(
            row["scene"],
            row["backend"],
            f"{1e6 * row['step']:.4g}",
            f"{row['ratio']:.3g}",
            f"{row['difference']:.1e}",
            f"{1e-9 * row['bytes a second']:.3g}" if "bytes a second" in row else "",
            f"{row['of the device']:.2f}" if "of the device" in row else "",
        )
    Console().print(table)
    if options.json:
        options.json.write_text(json.dumps(rows, indent=1))


if __name__ == "__main__":
    main()
