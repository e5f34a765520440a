"""What comparing two long trajectories costs beside merely reading them: CPU, wall and memory.

    python benchmarks/compare_large.py [--frames 1000000] [--nodes 100] [--rounds 3]
        [--folder DIR] [--cases same finer moved] [--json]

Two files are written that differ by a known deviation, and every candidate runs in a process of
its own, taking turns over rounds: h5py reading both files once in blocks of the same size, and
`compare_files`. Memory is the largest resident set of that process; time is that of the work
alone, after the imports and after compiling on a small pair. One thread; medians over rounds.
Each case prints its figures as ratios to the reading of the same round. The known limit is that
ratio at 1: all numbers have to be read once, and twice for a rigid motion over all instants.

same    both clocks agree, nodes in the same order, with spectra
bare    the same, without spectra
moved   a rigid motion found over all instants first: both files are read twice
finer   the other file has twice the frames between, so it is interpolated (cubic)
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from rich.console import Console
from rich.table import Table

from openprc.compare.alignment.settings import AlignmentSettings
from openprc.compare.comparison import compare_files
from openprc.schema import Provenance, TrajectoryWriter

DT, AMPLITUDE, DEVIATION = 1e-3, 1e-2, 1e-5
DIMS = 3
BLOCK_BYTES = 2 << 20
CASES: dict[str, dict[str, Any]] = {
    "same": {},
    "bare": {"spectra": False},
    "moved": {"rigid_motion": "all"},
    "finer": {},
}


def write_file(path: Path, *, frames: int, nodes: int, other: bool, step: float = DT) -> None:
    """Write nodes that swing about a grid, each at a frequency of its own.

    Frame i is at ``(i + 1/2) step`` where it lies between those of the reference.
    """
    rest = np.stack(np.unravel_index(np.arange(nodes), (nodes, 1, 1)), axis=1).astype("f8")
    frequency = np.linspace(3.0, 23.0, nodes)[:, np.newaxis]
    phase = np.arange(DIMS) * 0.7
    size = max(1, (8 << 20) // (nodes * DIMS * 8))
    start = 0.5 * step if step != DT else 0.0
    with TrajectoryWriter(path, provenance=Provenance("benchmark"), overwrite=True) as writer:
        writer.declare_nodes(nodes, DIMS, unit="m")
        for first in range(0, frames, size):
            t = start + step * np.arange(first, min(first + size, frames))
            angle = 2.0 * np.pi * frequency * t[:, np.newaxis, np.newaxis] + phase
            places = rest + AMPLITUDE * np.sin(angle)
            if other:
                places += DEVIATION * np.cos(angle)
            writer.append(t, positions=places)


def read_both(paths: list[str]) -> None:
    """Read the positions of both files once, block by block in turns."""
    files = [h5py.File(path) for path in paths]
    data = [file["time_series/nodes/positions"] for file in files]
    rows = [max(1, BLOCK_BYTES // (d.shape[1] * d.shape[2] * 8)) for d in data]
    rows = [r if r < d.chunks[0] else r - r % d.chunks[0] for r, d in zip(rows, data, strict=True)]
    starts = [0, 0]
    while any(s < len(d) for s, d in zip(starts, data, strict=True)):
        for k in (0, 1):
            if starts[k] < len(data[k]):
                data[k][starts[k] : starts[k] + rows[k]]
                starts[k] += rows[k]
    for file in files:
        file.close()


def work(case: str, paths: list[str], small: list[str]) -> dict[str, Any]:
    """Do one candidate in this process and return what it took."""
    found: dict[str, Any] = {}
    if case == "read":
        read_both(small)
        wall, cpu = time.perf_counter(), time.process_time()
        read_both(paths)
    else:
        settings = AlignmentSettings(**CASES[case])
        compare_files(small[0], small[1:], settings=settings)
        wall, cpu = time.perf_counter(), time.process_time()
        pair = compare_files(paths[0], paths[1:], settings=settings).pairs[0]
        found = {"rms": pair.rms, "interpolant": pair.interpolant, "samples": pair.n_samples}
    found["cpu"], found["wall"] = time.process_time() - cpu, time.perf_counter() - wall
    # Kilobytes on Linux, bytes on macOS.
    unit = 1 if sys.platform == "darwin" else 1024
    found["rss"] = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit
    return found


def apart(case: str, paths: list[Path], small: list[Path]) -> dict[str, Any]:
    """Do one candidate in a process of its own."""
    command = [sys.executable, __file__, "--work", case, *map(str, paths), *map(str, small)]
    single = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    done = subprocess.run(
        command, check=True, capture_output=True, text=True, env={**os.environ, **single}
    )
    answer: dict[str, Any] = json.loads(done.stdout)
    return answer


def measure(options: argparse.Namespace, folder: Path) -> list[dict[str, Any]]:
    """Write the files and run the candidates in turns."""
    sizes = {"": options.frames, "small_": 2000}
    files: dict[str, dict[str, list[Path]]] = {}
    for kind in ("same", "finer"):
        if kind == "finer" and "finer" not in options.cases:
            continue
        files[kind] = {}
        for prefix, frames in sizes.items():
            first, second = folder / f"{prefix}reference.h5", folder / f"{prefix}{kind}.h5"
            if not first.exists():
                write_file(first, frames=frames, nodes=options.nodes, other=False)
            if kind == "same":
                write_file(second, frames=frames, nodes=options.nodes, other=True)
            else:
                write_file(second, frames=2 * frames, nodes=options.nodes, other=True,
                           step=DT / 2)  # fmt: skip
            files[kind][prefix] = [first, second]
    found: dict[str, list[dict[str, Any]]] = {}
    for _ in range(options.rounds):
        for case in options.cases:
            pair = files["finer" if case == "finer" else "same"]
            read = apart("read", pair[""], pair["small_"])
            ours = apart(case, pair[""], pair["small_"])
            found.setdefault(case, []).append({"read": read, "ours": ours})
    return [summary(case, rounds) for case, rounds in found.items()]


def summary(case: str, rounds: list[dict[str, Any]]) -> dict[str, Any]:
    """Return medians, and ratios within each round."""

    def middle(who: str, what: str) -> float:
        return statistics.median(r[who][what] for r in rounds)

    def ratio(what: str) -> float:
        return statistics.median(r["ours"][what] / r["read"][what] for r in rounds)

    return {
        "case": case,
        "interpolant": rounds[0]["ours"]["interpolant"],
        "instants": rounds[0]["ours"]["samples"],
        "rms": rounds[0]["ours"]["rms"],
        "read_cpu_s": middle("read", "cpu"),
        "compare_cpu_s": middle("ours", "cpu"),
        "cpu_ratio": ratio("cpu"),
        "read_wall_s": middle("read", "wall"),
        "compare_wall_s": middle("ours", "wall"),
        "wall_ratio": ratio("wall"),
        "read_peak_MiB": max(r["read"]["rss"] for r in rounds) / 2**20,
        "compare_peak_MiB": max(r["ours"]["rss"] for r in rounds) / 2**20,
    }


def main() -> None:
    """Measure and print."""
    if sys.argv[1:2] == ["--work"]:
        case, *paths = sys.argv[2:]
        print(json.dumps(work(case, paths[:2], paths[2:])))
        return
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--frames", type=int, default=1_000_000)
    parser.add_argument("--nodes", type=int, default=100)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--folder", type=Path, help="where the files go for the time being")
    parser.add_argument("--cases", nargs="+", choices=tuple(CASES), default=["same", "bare"])
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    size = options.frames * (options.nodes * DIMS + 1) * 8
    needed = size * (4 if "finer" in options.cases else 2)
    with tempfile.TemporaryDirectory(dir=options.folder) as name:
        free = shutil.disk_usage(name).free
        if needed > 0.9 * free:
            raise SystemExit(
                f"the files take {needed / 2**30:.1f} GiB and {free / 2**30:.1f} GiB are free:"
                " choose another --folder, or fewer --frames"
            )
        rows = measure(options, Path(name))
    if options.json:
        print(json.dumps({"frames": options.frames, "nodes": options.nodes, "bytes": size,
                          "deviation": DEVIATION, "rows": rows}, indent=2))  # fmt: skip
        return
    title = f"{options.frames} frames of {options.nodes} nodes, {size / 1e9:.2f} GB a file"
    table = Table(title=title)
    for column in ("case", "rms [m]", "reading\nCPU [s]", "compare\nCPU [s]", "CPU\nratio",
                   "wall\nratio", "peak\n[MiB]", "reading\n[MiB]"):  # fmt: skip
        table.add_column(column, justify="right")
    for row in rows:
        table.add_row(
            row["case"], f"{row['rms']:.4g}", f"{row['read_cpu_s']:.2f}",
            f"{row['compare_cpu_s']:.2f}", f"{row['cpu_ratio']:.2f}", f"{row['wall_ratio']:.2f}",
            f"{row['compare_peak_MiB']:.0f}", f"{row['read_peak_MiB']:.0f}",
        )  # fmt: skip
    Console().print(table)


if __name__ == "__main__":
    main()
