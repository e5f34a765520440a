"""How fast foreign files become trajectories: MB of source arrays per second of CPU time.

    python benchmarks/import_throughput.py [--megabytes 150] [--repeat 3] [--only npz] [--json]

Every importer is given a large generated file and runs as `openprc import` does: the source is
hashed, the arrays are read and checked, the result is written with checksums, validated by a
second reading, and published. The floor beside it is what no importer can avoid: the same arrays
read (`numpy.load`, h5py or `scipy.io.loadmat`) and written once by h5py, chunked, with fletcher32
checksums. CPU time of one thread, medians over rounds in which both take turns. "stored / source"
is how much the importer writes for each byte it reads: MERLIN runs get lengths, strains and
angles of their elements, which the source does not hold. With ``--parts`` the time is split up
where it is spent.

The bar is 100 MB/s for npz and HDF5 sources.
"""

from __future__ import annotations

import argparse
import json
import statistics
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from rich.console import Console
from rich.table import Table
from scipy.io import loadmat, savemat

from openprc.hooks import default_registry, import_file
from openprc.hooks import importing as host
from openprc.schema import Trajectory, provenance, safety, validate
from openprc.schema.blocks import BlockChecker
from openprc.schema.streams import StreamSet

BAR = 100.0
_BLOCK = 4 << 20


@dataclass(frozen=True)
class Case:
    """One generated file: who reads it, its arrays, and how to read them plainly."""

    name: str
    producer: str
    path: Path
    n_bytes: int
    read: Callable[[Path], dict[str, np.ndarray]]
    positions: Callable[[], np.ndarray]
    options: dict[str, Any]


def waves(n_frames: int, n_nodes: int) -> np.ndarray:
    """Return (T, N, 3) positions of a swinging grid [m]: numbers that do not compress."""
    rng = np.random.default_rng(7)
    rest = rng.uniform(-1.0, 1.0, (n_nodes, 3))
    phase = rng.uniform(0.0, 2 * np.pi, (n_nodes, 3))
    t = 1e-3 * np.arange(n_frames)[:, None, None]
    return rest + 0.01 * np.sin(2 * np.pi * 3.0 * t + phase)


def npz_arrays(path: Path) -> dict[str, np.ndarray]:
    """Read every array of an archive."""
    with np.load(path) as archive:
        return {name: archive[name] for name in archive.files}


def hdf5_arrays(path: Path) -> dict[str, np.ndarray]:
    """Read every numeric dataset of a file."""
    found: dict[str, np.ndarray] = {}

    def visit(name: str, item: Any) -> None:
        if isinstance(item, h5py.Dataset) and item.dtype.kind in "fiu":
            found[name] = item[()]

    with h5py.File(path) as file:
        file.visititems(visit)
    return found


def mat_arrays(path: Path) -> dict[str, np.ndarray]:
    """Read the history of a MAT-file of level 5."""
    return {"Uhis": loadmat(path, variable_names=["Uhis"])["Uhis"]}


def pybullet_npz(folder: Path, n_bytes: int) -> Case:
    """A user's loop, saved with `numpy.savez`: t and pos (T, N, 3)."""
    data = waves(n_bytes // (8 * 600), 200)
    path = folder / "links.npz"
    np.savez(path, t=np.arange(len(data)) / 240.0, pos=data)
    return Case("npz, positions", "pybullet", path, data.nbytes, npz_arrays, lambda: data, {})


def pyelastica_npz(folder: Path, n_bytes: int) -> Case:
    """A rod's callback, saved with `numpy.savez`: (T, 3, n + 1) and (T, 3, 3, n)."""
    n = 100
    rows = n_bytes // (8 * (2 * 3 * (n + 1) + 9 * n))
    line = np.zeros((rows, n + 1, 3))
    line[..., 2] = np.linspace(0.0, 1.0, n + 1)
    line += 0.01 * (waves(rows, n + 1) - waves(1, n + 1))
    position = np.ascontiguousarray(line.transpose(0, 2, 1))
    velocity = 0.1 * position
    directors = np.tile(np.eye(3)[None, :, :, None], (rows, 1, 1, n))
    path = folder / "rod.npz"
    arrays = {"position": position, "velocity": velocity, "directors": directors}
    np.savez(path, time=np.arange(rows) * 1e-3, step=np.arange(rows), **arrays)
    total = sum(array.nbytes for array in arrays.values())
    return Case("npz, a rod", "pyelastica", path, total, npz_arrays, lambda: line, {})


def legacy_hdf5(folder: Path, n_bytes: int) -> Case:
    """A simulation.h5 of the older engine: positions and velocities."""
    data = waves(n_bytes // (16 * 600), 200)
    path = folder / "simulation.h5"
    with h5py.File(path, "w") as file:
        file.attrs["schema_version"] = "1.0"
        file.attrs["frame_rate"] = 1000.0
        file["time_series/time"] = np.arange(len(data)) * 1e-3
        file["time_series/nodes/positions"] = data
        file["time_series/nodes/velocities"] = 0.1 * data
    return Case("HDF5, older engine", "legacy", path, 2 * data.nbytes, hdf5_arrays,
                lambda: data, {})  # fmt: skip


def _sheet(side: int) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Return the nodes of a square sheet and MERLIN's tables of it, counted from 1."""
    grid = np.arange(side * side).reshape(side, side)
    a, b, c, d = (grid[i : side - 1 + i, j : side - 1 + j].ravel() for i, j in
                  ((0, 0), (0, 1), (1, 1), (1, 0)))  # fmt: skip
    x, y = np.meshgrid(np.arange(side), np.arange(side))
    nodes = np.column_stack([x.ravel(), y.ravel(), 0.2 * (x.ravel() % 2)]).astype(float)
    bend = np.column_stack([a, c, d, b])
    along = np.column_stack([grid[1:-1, :-1].ravel(), grid[1:-1, 1:].ravel(),
                             grid[2:, 1:].ravel(), grid[:-2, :-1].ravel()])  # fmt: skip
    rim = np.concatenate([np.column_stack([grid[r, :-1], grid[r, 1:]]) for r in (0, -1)])
    upright = np.column_stack([grid[:-1].ravel(), grid[1:].ravel()])
    bars = np.concatenate([bend[:, :2], along[:, :2], rim, upright])
    faces = np.concatenate([np.column_stack([a, b, c]), np.column_stack([a, c, d])])
    tables = {"Bars": bars, "bend": bend, "fold": along, "Trigl": faces}
    return nodes, {name: table + 1.0 for name, table in tables.items()}


def _merlin(n_bytes: int) -> tuple[np.ndarray, dict[str, np.ndarray], np.ndarray]:
    side = 40
    nodes, tables = _sheet(side)
    frames = n_bytes // (8 * nodes.size)
    moved = 0.1 * (waves(frames, len(nodes)) - waves(1, len(nodes)))
    return nodes, tables, moved


def merlin_v73(folder: Path, n_bytes: int, *, whole: bool) -> Case:
    """A workspace in MATLAB's v7.3 layout, with or without bars and hinges."""
    nodes, tables, moved = _merlin(n_bytes)
    path = folder / f"v73_{'whole' if whole else 'points'}.mat"

    def put(group: Any, name: str, array: np.ndarray) -> None:
        group.create_dataset(name, data=np.ascontiguousarray(array.T))
        group[name].attrs["MATLAB_class"] = np.bytes_("double")

    with h5py.File(path, "w", userblock_size=512) as file:
        put(file, "Uhis", moved.reshape(len(moved), -1).T)
        put(file, "Fhis", np.arange(len(moved))[:, None] * 1.0)
        groups = {"truss": {"Node": nodes}, "angles": {}}
        if whole:
            groups["truss"] |= {name: tables[name] for name in ("Bars", "Trigl")}
            groups["angles"] = {name: tables[name] for name in ("bend", "fold")}
        for name, members in groups.items():
            group = file.create_group(name)
            group.attrs["MATLAB_class"] = np.bytes_("struct")
            for key, value in members.items():
                put(group, key, value)
    with path.open("r+b") as stream:
        stream.write(b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM")
    name = "HDF5, MERLIN v7.3" + (", bars and hinges" if whole else ", points")
    return Case(name, "merlin", path, moved.nbytes, hdf5_arrays, lambda: nodes + moved, {})


def merlin_v5(folder: Path, n_bytes: int) -> Case:
    """The same run without bars as a MAT-file of level 5, not compressed."""
    nodes, _, moved = _merlin(n_bytes)
    path = folder / "v5.mat"
    run = {"Uhis": moved.reshape(len(moved), -1).T, "Fhis": np.arange(len(moved)) * 1.0}
    savemat(path, {**run, "truss": {"Node": nodes}}, oned_as="column")
    return Case("MAT v5, MERLIN, points", "merlin", path, moved.nbytes, mat_arrays,
                lambda: nodes + moved, {})  # fmt: skip


CASES: dict[str, Callable[[Path, int], Case]] = {
    "npz-pybullet": pybullet_npz,
    "npz-pyelastica": pyelastica_npz,
    "hdf5-legacy": legacy_hdf5,
    "hdf5-merlin": lambda folder, n: merlin_v73(folder, n, whole=False),
    "hdf5-merlin-whole": lambda folder, n: merlin_v73(folder, n // 2, whole=True),
    "mat5-merlin": merlin_v5,
}


def floor(case: Case, out: Path) -> None:
    """Read the arrays and write them once, chunked and with checksums."""
    arrays = case.read(case.path)
    with h5py.File(out, "w") as file:
        for name, array in arrays.items():
            rows = max(1, min(len(array), _BLOCK // max(1, array[:1].nbytes))) if array.ndim else 0
            chunks = (rows, *array.shape[1:]) if array.ndim and array.size else None
            file.create_dataset(name, data=array, chunks=chunks, fletcher32=chunks and True)


def ours(case: Case, out: Path) -> None:
    """Import as the command does."""
    import_file(case.path, out, as_name=case.producer, options=case.options, overwrite=True)


class Parts:
    """CPU time by part, that of nested parts counted once."""

    def __init__(self) -> None:
        self.spent: dict[str, float] = defaultdict(float)
        self._stack: list[float] = []
        self._undo: list[tuple[Any, str, Any]] = []

    def watch(self, owner: Any, name: str, part: str) -> None:
        """Time every call of ``owner.name``."""
        kept = owner.__dict__[name]
        function = getattr(owner, name)

        def timed(*args: Any, **kwargs: Any) -> Any:
            self._stack.append(0.0)
            began = time.process_time()
            try:
                return function(*args, **kwargs)
            finally:
                took = time.process_time() - began
                self.spent[part] += took - self._stack.pop()
                if self._stack:
                    self._stack[-1] += took

        self._undo.append((owner, name, kept))
        setattr(owner, name, timed)

    def __enter__(self) -> Parts:
        self.watch(provenance, "_feed", "hash of the source")
        self.watch(BlockChecker, "check", "checks while writing")
        self.watch(StreamSet, "append", "copies")
        self.watch(StreamSet, "commit", "HDF5 and checksums")
        self.watch(host, "validate_run", "validation")
        for reader, name in ((safety, "load_npz"), (h5py.Dataset, "__getitem__")):
            self.watch(reader, name, "reading")
        return self

    def __exit__(self, *_: object) -> None:
        for owner, name, kept in reversed(self._undo):
            setattr(owner, name, kept)


def cpu(call: Callable[[], object]) -> float:
    """Return the CPU seconds of one call."""
    began = time.process_time()
    call()
    return time.process_time() - began


def measure(case: Case, folder: Path, repeat: int) -> dict[str, Any]:
    """Take turns, compare what arrived with what was generated, and split one round up."""
    out, plain = folder / "out.h5", folder / "plain.h5"
    rounds: dict[str, list[float]] = {"ours": [], "floor": []}
    for _ in range(repeat):
        rounds["ours"].append(cpu(lambda: ours(case, out)))
        rounds["floor"].append(cpu(lambda: floor(case, plain)))
    with Trajectory(out) as trajectory:
        arrived = trajectory.positions()
        error = float(np.abs(arrived[-len(case.positions()) :] - case.positions()).max())
        stored = out.stat().st_size / case.n_bytes
    parts = Parts()
    with parts:
        total = cpu(lambda: ours(case, out))
    parts.spent["the importer itself"] = total - sum(parts.spent.values())
    medians = {name: statistics.median(values) for name, values in rounds.items()}
    return {
        "source": case.name,
        "producer": case.producer,
        "MB": case.n_bytes / 1e6,
        "MB/s": case.n_bytes / 1e6 / medians["ours"],
        "floor MB/s": case.n_bytes / 1e6 / medians["floor"],
        "times the floor": medians["ours"] / medians["floor"],
        "stored / source": stored,
        "largest error": error,
        "parts": {name: seconds / total for name, seconds in sorted(parts.spent.items())},
    }


def show(rows: list[dict[str, Any]], *, parts: bool) -> None:
    """Print the table."""
    console = Console(width=150)
    table = Table(title=f"imports, CPU time of one thread; bar {BAR:.0f} MB/s for npz and HDF5")
    for name in ("source", "producer", "MB", "MB/s", "floor MB/s", "times the floor",
                 "stored / source", "largest error"):  # fmt: skip
        table.add_column(name, justify="left" if name in ("source", "producer") else "right")
    for row in rows:
        table.add_row(
            row["source"], row["producer"], f"{row['MB']:.0f}", f"{row['MB/s']:.0f}",
            f"{row['floor MB/s']:.0f}", f"{row['times the floor']:.2f}",
            f"{row['stored / source']:.2f}", f"{row['largest error']:.1e}",
        )  # fmt: skip
    console.print(table)
    if parts:
        for row in rows:
            shares = ", ".join(
                f"{name} {share:.0%}" for name, share in row["parts"].items() if share >= 0.01
            )
            console.print(f"{row['source']}: {shares}")


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--megabytes", type=float, default=150.0)
    parser.add_argument("--repeat", type=int, default=3)
    parser.add_argument("--only", nargs="*", choices=sorted(CASES), default=sorted(CASES))
    parser.add_argument("--parts", action="store_true")
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    default_registry()
    validate.all_checks()
    rows = []
    for name in options.only:
        with tempfile.TemporaryDirectory() as folder:
            case = CASES[name](Path(folder), int(options.megabytes * 1e6))
            rows.append(measure(case, Path(folder), options.repeat))
    if options.json:
        print(json.dumps({"bar": BAR, "rows": rows}, indent=2))
        return
    show(rows, parts=options.parts)


if __name__ == "__main__":
    main()
