"""What an export for ParaView costs, and how fast a mesh series comes in.

    python benchmarks/paraview_export.py [--sizes 1000x500 200x20000] [--rounds 7] [--json FILE]

A size is FRAMESxNODES; each node has about three bars. The unit of an export is copying
the trajectory file: CPU time with that of the system, and bytes written. The peers are
the time series writers of meshio and its fork meshlane, the usual way to get a moving mesh into
ParaView from Python: they write one mesh, the displacement, the velocities, and the strain of
every bar. Everybody takes turns in every round; a ratio is the median over rounds of the ratio
within a round. What was written is opened with VTK, and the error is the largest
difference of places and strains from the trajectory in the first, a middle and the last frame.

The second table imports the series that meshio wrote, places and velocities, in MB of source
arrays a second of CPU time. "host" is all that `import_file` does: reading, checking, writing,
hashing the sources and validating the result. The floor is h5py reading every dataset into an
array that is thrown away; meshio's own reader, which converts and writes nothing, is the peer.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import statistics
import tempfile
import time
from collections.abc import Callable
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from rich.console import Console
from rich.table import Table

from openprc.hooks import export_file, import_file
from openprc.schema import Provenance, Trajectory, TrajectoryWriter

SIZES = ("1000x500", "200x20000")
COPY, XDMF, VTKHDF = "copying the file", "xdmf", "vtkhdf"
PEERS = tuple(name for name in ("meshio", "meshlane") if find_spec(name))


def body(n_nodes: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the points and bars of a strip of crossed cells."""
    columns = n_nodes // 2
    x, y = np.meshgrid(np.arange(columns, dtype=float), [0.0, 1.0])
    points = np.stack([x.ravel(), y.ravel(), np.zeros(2 * columns)], axis=1)
    a = np.arange(columns - 1)
    bars = np.concatenate(
        [np.stack(pair, axis=1) for pair in (
            (a, a + 1), (a + columns, a + columns + 1), (a, a + columns), (a, a + columns + 1),
        )]
    )  # fmt: skip
    return points, bars


def record(path: Path, frames: int, n_nodes: int) -> None:
    """Write a trajectory of a strip in a travelling wave."""
    points, bars = body(n_nodes)
    rng = np.random.default_rng(0)
    with TrajectoryWriter(path, provenance=Provenance("benchmark")) as writer:
        writer.declare_nodes(len(points), 3, unit="m", velocities=True)
        writer.declare_elements("bars", bars, series={"strain": "1"})
        for k in range(frames):
            moved = points + 0.05 * rng.normal(size=points.shape)
            span = moved[bars[:, 1]] - moved[bars[:, 0]]
            writer.append(
                0.01 * k,
                positions=moved,
                velocities=rng.normal(size=points.shape),
                elements={("bars", "strain"): np.linalg.norm(span, axis=1) - 1.0},
            )


def by_peer(name: str, path: Path, folder: Path) -> Path:
    """Write the trajectory with the time series writer of `name`."""
    writers = import_module(name).xdmf
    out = folder / f"{name}.xdmf"
    here = Path.cwd()
    # The heavy file always lands in the current directory.
    os.chdir(folder)
    try:
        with Trajectory(path) as run, writers.TimeSeriesWriter(out) as writer:
            points = run.positions(slice(0, 1))[0]
            writer.write_points_cells(points, [("line", run.indices("bars").astype("i8"))])
            for k, at in enumerate(run.time):
                row = slice(k, k + 1)
                writer.write_data(
                    at,
                    point_data={
                        "u": run.positions(row)[0] - points,
                        "velocities": run.velocities(row)[0],
                    },
                    cell_data={"strain": [run.element("bars", "strain", frames=row)[0]]},
                )
    finally:
        os.chdir(here)
    return out


def read_back(out: Path, path: Path) -> float | None:
    """Return the largest difference that VTK sees; None without VTK."""
    if find_spec("vtk") is None:
        return None
    vtk = import_module("vtk")
    as_array = import_module("vtk.util.numpy_support").vtk_to_numpy
    reader = vtk.vtkXdmfReader() if out.suffix == ".xdmf" else vtk.vtkHDFReader()
    reader.SetFileName(str(out))
    reader.UpdateInformation()
    times = reader.GetOutputInformation(0).Get(vtk.vtkStreamingDemandDrivenPipeline.TIME_STEPS())
    worst = 0.0
    with Trajectory(path) as run:
        for k in (0, run.n_frames // 2, run.n_frames - 1):
            reader.UpdateTimeStep(times[k])
            grid = reader.GetOutputDataObject(0)
            while grid.IsA("vtkMultiBlockDataSet"):
                grid = grid.GetBlock(0)
            places = as_array(grid.GetPoints().GetData()).astype(float)
            if grid.GetPointData().HasArray("u"):
                places = places + as_array(grid.GetPointData().GetArray("u"))
            strain = as_array(grid.GetCellData().GetArray("strain"))
            row = slice(k, k + 1)
            worst = max(
                worst,
                float(np.abs(places - run.positions(row)[0]).max()),
                float(np.abs(strain - run.element("bars", "strain", frames=row)[0]).max()),
            )
    return worst


def cpu(call: Callable[[], object]) -> float:
    """Return the CPU seconds of one call, those of the system included."""
    start = time.process_time()
    call()
    return time.process_time() - start


def turns(calls: dict[str, Callable[[], object]], rounds: int) -> dict[str, list[float]]:
    """Let everybody take turns; return seconds by name."""
    for call in calls.values():
        call()
    times: dict[str, list[float]] = {name: [] for name in calls}
    for _ in range(rounds):
        for name, call in calls.items():
            times[name].append(cpu(call))
    return times


def exports(size: str, folder: Path, rounds: int) -> list[dict[str, Any]]:
    """Measure the exports of one size."""
    frames, n_nodes = (int(part) for part in size.split("x"))
    path = folder / "run.h5"
    record(path, frames, n_nodes)
    made: dict[str, tuple[Path, ...]] = {
        COPY: (folder / "copy.h5",),
        XDMF: (folder / "out.xdmf",),
        VTKHDF: (folder / "out.vtkhdf",),
        **{name: (folder / f"{name}.xdmf", folder / f"{name}.h5") for name in PEERS},
    }
    calls: dict[str, Callable[[], object]] = {
        COPY: lambda: shutil.copyfile(path, made[COPY][0]),
        XDMF: lambda: export_file(path, made[XDMF][0], overwrite=True),
        VTKHDF: lambda: export_file(path, made[VTKHDF][0], overwrite=True),
        **{name: (lambda name=name: by_peer(name, path, folder)) for name in PEERS},
    }
    times = turns(calls, rounds)
    return [
        {
            "size": size,
            "export": name,
            "cpu_s": min(times[name]),
            "cpu_over_copying": statistics.median(
                a / b for a, b in zip(times[name], times[COPY], strict=True)
            ),
            "bytes": sum(file.stat().st_size for file in files),
            "bytes_over_copying": sum(f.stat().st_size for f in files) / path.stat().st_size,
            "error": None if name == COPY else read_back(files[0], path),
        }
        for name, files in made.items()
    ]


def imports(size: str, folder: Path, rounds: int) -> list[dict[str, Any]]:
    """Measure the import of the series that a peer wrote."""
    if not PEERS:
        return []
    source = folder / f"{PEERS[0]}.xdmf"
    readers = import_module(PEERS[0]).xdmf
    frames, n_nodes = (int(part) for part in size.split("x"))
    megabytes = 2 * frames * n_nodes * 24 / 1e6

    def floor() -> None:
        with h5py.File(source.with_suffix(".h5")) as file:
            for name in file:
                file[name][()]

    def peer() -> None:
        with readers.TimeSeriesReader(source) as reader:
            reader.read_points_cells()
            for k in range(reader.num_steps):
                reader.read_data(k)

    def host() -> None:
        import_file(
            source, folder / "in.h5", as_name="meshio", overwrite=True,
            options={"unit": "m", "velocity": "velocities"},
        )  # fmt: skip

    calls = {"h5py, nothing kept": floor, f"{PEERS[0]}, nothing kept": peer, "host": host}
    times = turns(calls, rounds)
    with Trajectory(folder / "run.h5") as run, Trajectory(folder / "in.h5") as found:
        error = float(np.abs(found.positions() - run.positions()).max())
    return [
        {
            "size": size,
            "reader": name,
            "cpu_s": min(taken),
            "mb_per_s": megabytes / statistics.median(taken),
            "error": error if name == "host" else None,
        }
        for name, taken in times.items()
    ]


def shown(value: float | None) -> str:
    """Return an error for the table."""
    return "-" if value is None else f"{value:.1e}" if value else "0"


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--sizes", nargs="+", default=SIZES, metavar="FRAMESxNODES")
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    out, back = [], []
    for size in arguments.sizes:
        with tempfile.TemporaryDirectory() as name:
            out += exports(size, Path(name), arguments.rounds)
            back += imports(size, Path(name), arguments.rounds)
    table = Table(title="Export, in units of copying the trajectory")
    for column in ("size", "export", "CPU s", "CPU", "MB", "bytes", "error"):
        table.add_column(column, justify="left" if column == "export" else "right")
    for row in out:
        table.add_row(
            row["size"], row["export"], f"{row['cpu_s']:.3f}", f"{row['cpu_over_copying']:.2f}",
            f"{row['bytes'] / 1e6:.2f}", f"{row['bytes_over_copying']:.3f}", shown(row["error"]),
        )  # fmt: skip
    Console().print(table)
    table = Table(title="Import of an XDMF series in HDF5")
    for column in ("size", "reader", "CPU s", "MB/s", "error"):
        table.add_column(column, justify="left" if column == "reader" else "right")
    for row in back:
        table.add_row(row["size"], row["reader"], f"{row['cpu_s']:.3f}",
                      f"{row['mb_per_s']:.0f}", shown(row["error"]))  # fmt: skip
    Console().print(table)
    if arguments.json:
        arguments.json.write_text(json.dumps({"exports": out, "imports": back}, indent=1))


if __name__ == "__main__":
    main()
