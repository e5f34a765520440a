"""Writing, reading and validating 20,000 frames of 200 nodes: ratios to plain h5py and to disk.

    python benchmarks/schema_io.py [--repeat 5] [--json]

The peer is a single h5py ``create_dataset`` of the whole array, contiguous and without
checksums: the least that HDF5 can do. Every figure is a median over rounds in which all
candidates take turns, as a ratio to that peer; MB/s are given for orientation.
"""

from __future__ import annotations

import argparse
import json
import statistics
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np

from openprc.schema import Provenance, Trajectory, TrajectoryWriter
from openprc.schema.validate import validate_file

T, N, D = 20_000, 200, 3
BLOCK = 100


def write_ours(path: Path, data: np.ndarray) -> None:
    """Stream the trajectory in blocks of 100 frames."""
    with TrajectoryWriter(path, provenance=Provenance("benchmark"), overwrite=True) as writer:
        writer.declare_nodes(N, D, unit="m")
        for start in range(0, T, BLOCK):
            instants = np.arange(start, start + BLOCK) * 1e-3
            writer.append(instants, positions=data[start : start + BLOCK])


def write_peer(path: Path, data: np.ndarray) -> None:
    """Write the same array at once."""
    with h5py.File(path, "w") as file:
        file["positions"] = data
        file["time"] = np.arange(T) * 1e-3


def read_ours(path: Path) -> np.ndarray:
    """Read all positions."""
    with Trajectory(path) as trajectory:
        return trajectory.positions()


def read_peer(path: Path) -> np.ndarray:
    """Read the same array."""
    with h5py.File(path) as file:
        return file["positions"][()]


def timed(call: Callable[[], object]) -> float:
    """Return the seconds of one call."""
    start = time.perf_counter()
    call()
    return time.perf_counter() - start


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repeat", type=int, default=5)
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    data = np.random.default_rng(0).normal(size=(T, N, D))
    megabytes = data.nbytes / 1e6
    seconds: dict[str, list[float]] = {}
    with tempfile.TemporaryDirectory() as folder:
        ours, peer = Path(folder) / "ours.h5", Path(folder) / "peer.h5"
        calls: dict[str, Callable[[], object]] = {
            "write, h5py at once": lambda: write_peer(peer, data),
            "write, TrajectoryWriter": lambda: write_ours(ours, data),
            "read, h5py at once": lambda: read_peer(peer),
            "read, Trajectory": lambda: read_ours(ours),
            "read one node, Trajectory": lambda: Trajectory(ours).positions(nodes=[7]),
            "validate_file": lambda: validate_file(ours),
        }
        for _ in range(options.repeat):
            for name, call in calls.items():
                seconds.setdefault(name, []).append(timed(call))
        assert np.array_equal(read_ours(ours), data)
        assert validate_file(ours).ok
    medians = {name: statistics.median(values) for name, values in seconds.items()}
    rows = [
        {
            "what": name,
            "MB/s": megabytes / median,
            "ratio to peer": median
            / medians["write, h5py at once" if name.startswith("write") else "read, h5py at once"],
        }
        for name, median in medians.items()
    ]
    if options.json:
        print(json.dumps({"shape": [T, N, D], "MB": megabytes, "rows": rows}, indent=2))
        return
    print(f"{T} x {N} x {D} float64, {megabytes:.0f} MB, median of {options.repeat} rounds")
    for row in rows:
        print(f"{row['what']:28s} {row['MB/s']:8.0f} MB/s   {row['ratio to peer']:6.2f} x peer")


if __name__ == "__main__":
    main()
