"""simulation.h5 of the older engine, of both generations."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import h5py
import numpy as np
from numpy.typing import NDArray

from openprc.errors import Diverged, UnreadableFile
from openprc.schema.legacy_clock import read_times, rebuild
from openprc.schema.legacy_drive import (
    STORED,
    Drive,
    check_followed,
    signal_drives,
    stored_drives,
)
from openprc.schema.legacy_kinds import attribute, numeric, read
from openprc.schema.legacy_siblings import Geometry, find_siblings, read_geometry

if TYPE_CHECKING:
    from openprc.schema import TrajectoryWriter

_BLOCK_BYTES = 8 << 20
_POSITIONS = "time_series/nodes/positions"
_VELOCITIES = "time_series/nodes/velocities"
_ENERGIES = ("kinetic_energy", "potential_energy", "total_energy")
#: Names of bar datasets by their name in the contract, both generations.
_BAR_SERIES = {"length": ("lengths", "length"), "strain": ("strain",)}


@dataclass
class Plan:
    """What will be written, decided before the first frame."""

    rows: int
    dims: int
    geometry: Geometry | None = None
    velocities: bool = False
    system: dict[str, h5py.Dataset] = field(default_factory=dict)
    channels: dict[str, h5py.Dataset] = field(default_factory=dict)
    hinge_angle: h5py.Dataset | None = None
    drives: list[Drive] = field(default_factory=list)


def import_simulation(
    file: h5py.File, path: Path, writer: TrajectoryWriter, options: Mapping[str, Any]
) -> None:
    """Write a run of the older engine.

    Raises
    ------
    Diverged
        A position or velocity is not finite.
    UnreadableFile
        The datasets do not fit together.
    """
    siblings = find_siblings(path)
    plan = Plan(rows=count_rows(file, path, writer), dims=3)
    stored = read_times(file["time_series/time"], plan.rows, path=path)
    clock = rebuild(stored, rates=[attribute(file, "frame_rate", 0.0)])
    if clock.remark:
        writer.note(clock.remark)
    plan.drives = stored_drives(file, path, plan.rows, wires=siblings.wires, unit="m")
    if not plan.drives:
        plan.drives = signal_drives(siblings, clock.time, writer)
    if siblings.config_file is not None:
        writer.add_source(siblings.config_file, role="settings")
    places = _survey(file, path, plan)
    check_followed(plan.drives, places, writer)
    if not plan.drives:
        writer.note("nothing says what drove the body: no stored drive, no input folder with it")
    if siblings.geometry_file is None:
        writer.note("no geometry.h5 in the input folder: the file has no topology")
    else:
        plan.geometry = _matching(read_geometry(siblings.geometry_file), file, plan, writer)
        if plan.geometry is not None:
            writer.add_source(siblings.geometry_file, role="geometry")
    _choose(file, plan, writer)
    _declare(file, plan, writer, driven={wire.node for wire in siblings.wires})
    _note_traits(writer, siblings.number("dt_base"), planar=plan.dims == 2)
    for rows in blocks(file[_POSITIONS], plan.rows):
        _append(file, plan, clock.time, rows, writer)


def count_rows(file: h5py.File, path: Path, writer: TrajectoryWriter) -> int:
    """Return how many frames are whole, and note when that is not all of them.

    Raises
    ------
    UnreadableFile
        When there is none.
    """
    lengths = {
        name: len(file[name])
        for name in ("time_series/time", _POSITIONS, _VELOCITIES)
        if numeric(file, name) is not None
    }
    rows = min(lengths.values())
    total = attribute(file, "total_frames", 0.0)
    if 0 < total < rows:
        rows = int(total)
    if attribute(file, "completed", 1.0) == 0.0:
        # What was allocated and never filled reads as zeros.
        time = read(file["time_series/time"], slice(0, rows)).reshape(-1)
        stop = np.flatnonzero(~(np.diff(time) > 0))
        rows = min(rows, int(stop[0]) + 1) if len(stop) else rows
        writer.note(f"the run did not finish (completed = 0); its {rows} whole frames are kept")
    longest = max(lengths.values())
    if rows < longest:
        writer.note(f"{longest - rows} of {longest} rows are left out: they are no whole frames")
    if rows == 0:
        raise UnreadableFile(
            "the run holds no frame",
            expected="at least one",
            fix="simulate the experiment: `openprc run DIR`",
            file=path,
            key="/time_series/time",
        )
    return rows


def blocks(dataset: h5py.Dataset, rows: int) -> Iterator[slice]:
    """Yield slices along time of a few megabytes each."""
    step = max(1, _BLOCK_BYTES // max(1, int(np.prod(dataset.shape[1:])) * 8))
    for start in range(0, rows, step):
        yield slice(start, min(start + step, rows))


def _survey(file: h5py.File, path: Path, plan: Plan) -> dict[int, NDArray[np.float64]]:
    """Look at every number once: all finite, planar or not, and where the driven nodes were."""
    shape = file[_POSITIONS].shape
    driven = sorted({node for drive in plan.drives for node in drive.nodes if node < shape[1]})
    found: list[NDArray[np.float64]] = []
    planar = True
    velocities = numeric(file, _VELOCITIES)
    plan.velocities = velocities is not None and velocities.shape[1:] == shape[1:]
    names = (_POSITIONS, _VELOCITIES) if plan.velocities else (_POSITIONS,)
    for rows in blocks(file[_POSITIONS], plan.rows):
        for name in names:
            data = read(file[name], rows)
            if not np.isfinite(data).all():
                raise _diverged(data, rows.start, name, path)
            planar = planar and (shape[2] == 2 or not data[..., 2].any())
            if name == _POSITIONS:
                found.append(data[:, driven].astype(np.float64))
    plan.dims = 2 if planar else 3
    if planar:
        plan.drives = [drive.flattened() for drive in plan.drives]
    tracks = np.concatenate(found)
    return {node: tracks[:, place] for place, node in enumerate(driven)}


def _diverged(data: NDArray[Any], start: int, name: str, path: Path) -> Diverged:
    frame, node = np.argwhere(~np.isfinite(data))[0][:2]
    return Diverged(
        f"node {node} is at {data[frame, node].tolist()} in frame {start + frame}",
        expected="finite numbers; that engine did not check, and called the run completed",
        fix="simulate the experiment with a smaller time step: `openprc run DIR`",
        file=path,
        key="/" + name,
    )


def _matching(
    geometry: Geometry, file: h5py.File, plan: Plan, writer: TrajectoryWriter
) -> Geometry | None:
    """Return the geometry if it is that of this run; note why not otherwise."""
    places = file[_POSITIONS]
    reasons = []
    if len(geometry.rest) != places.shape[1]:
        reasons.append(f"it has {len(geometry.rest)} nodes and the run {places.shape[1]}")
    elif geometry.fixed is not None and geometry.fixed.any():
        away = np.abs(geometry.rest - _padded(read(places, slice(0, 1))[0]))[geometry.fixed].max()
        size = max(float(np.ptp(geometry.rest, axis=0).max()), 1e-12)
        driven = {node for drive in plan.drives for node in drive.nodes}
        still = set(np.flatnonzero(geometry.fixed).tolist()) - driven
        if away > 1e-4 * size and still:
            reasons.append(f"fixed nodes of it are up to {away:.1g} m elsewhere in the run")
    for kind, elements in geometry.elements.items():
        group = file.get(f"time_series/elements/{kind}")
        tables = group.values() if isinstance(group, h5py.Group) else ()
        counts = {item.shape[-1] for item in tables if isinstance(item, h5py.Dataset)}
        if counts - {len(elements.indices)}:
            reasons.append(f"it has {len(elements.indices)} {kind} and the run {max(counts)}")
    if reasons:
        writer.note("geometry.h5 does not belong to this run: " + "; ".join(reasons))
        return None
    return geometry


def _padded(places: NDArray[Any]) -> NDArray[np.float64]:
    padded = np.zeros((len(places), 3))
    padded[:, : places.shape[1]] = places
    return padded


def _choose(file: h5py.File, plan: Plan, writer: TrajectoryWriter) -> None:
    """Decide which other series come along, and note which stay behind."""
    taken = {"time_series/time", _POSITIONS, _VELOCITIES}
    for root in ("time_series/system", "system"):
        for name in _ENERGIES:
            item = numeric(file, f"{root}/{name}")
            if item is None or item.ndim not in (1, 2) or item.shape[1:] not in ((), (1,)):
                continue
            if len(item) >= plan.rows:
                plan.system.setdefault(name, item)
                taken.add(f"{root}/{name}")
    known = {} if plan.geometry is None else plan.geometry.elements
    for quantity, names in _BAR_SERIES.items():
        for name in names:
            where = f"time_series/elements/bars/{name}"
            item = numeric(file, where)
            if item is not None and item.ndim == 2 and len(item) >= plan.rows:
                taken.add(where)
                # With the topology both follow exactly from the positions.
                if "bars" not in known and item.shape[1]:
                    plan.channels[f"bar_{quantity}"] = item
    angle = numeric(file, "time_series/elements/hinges/angle")
    count = len(known["hinges"].indices) if "hinges" in known else 0
    if count and angle is not None and angle.shape[1:] == (count,) and len(angle) >= plan.rows:
        plan.hinge_angle = angle
        taken.add("time_series/elements/hinges/angle")
    left: list[str] = []

    def visit(name: str, item: h5py.HLObject) -> None:
        if isinstance(item, h5py.Dataset) and name not in taken and not name.startswith(STORED):
            left.append(name.removeprefix("time_series/"))

    file.visititems(visit)
    if left:
        writer.note(
            "not carried over: "
            + ", ".join(sorted(left))
            + " (stress there is stiffness times strain, and damping_loss has a wrong factor)"
        )


def _declare(file: h5py.File, plan: Plan, writer: TrajectoryWriter, *, driven: set[int]) -> None:
    geometry, places = plan.geometry, file[_POSITIONS]
    fixed = masses = None
    if geometry is not None:
        masses = geometry.masses
        if masses is not None and not (masses >= 0).all():
            writer.note("some masses are negative or not finite: the masses were left out")
            masses = None
        if plan.dims == 2 and geometry.rest[:, 2].any():
            plan.dims = places.shape[2]
        if geometry.fixed is not None:
            # The bit on a driven node only kept the integrator away from it.
            fixed = geometry.fixed & ~np.isin(np.arange(len(geometry.fixed)), list(driven))
    writer.declare_nodes(
        places.shape[1],
        plan.dims,
        unit="m",
        dtype="f4" if places.dtype == np.float32 else "f8",
        velocities=plan.velocities,
        rest=None if geometry is None else geometry.rest[:, : plan.dims],
        mass=masses,
        fixed=fixed,
    )
    for kind, elements in ({} if geometry is None else geometry.elements).items():
        series = {"angle": "rad"} if plan.hinge_angle is not None else {}
        if kind == "bars":
            series = {"length": "m"}
            if "rest_length" in elements.static:
                series["strain"] = "1"
        writer.declare_elements(kind, elements.indices, series=series, static=elements.static)
    for name, item in plan.channels.items():
        columns = [f"bar {number}" for number in range(item.shape[1])]
        unit, quantity = ("m", "length") if name == "bar_length" else ("1", "strain")
        writer.declare_channel(name, columns, unit=unit, quantity=quantity)
    for name in plan.system:
        writer.declare_system(name)
    for drive in plan.drives:
        drive.declare(writer)


def _note_traits(writer: TrajectoryWriter, dt: float | None, *, planar: bool) -> None:
    step = "one integration step" if dt is None else f"one integration step ({dt:g} s)"
    writer.note(
        f"that engine labels a frame {step} early: free nodes are that much later than the "
        "time says, driven nodes are not, and the initial state is not stored"
    )
    writer.note(
        "that engine advances positions with the velocity at the start of the step: first "
        "order in time, and undamped motion gains energy"
    )
    if planar:
        writer.note("z is 0 everywhere and was left out: the file has two dimensions")


def _append(
    file: h5py.File, plan: Plan, time: NDArray[np.float64], rows: slice, writer: TrajectoryWriter
) -> None:
    places = read(file[_POSITIONS], rows)
    elements: dict[tuple[str, str], NDArray[np.float64]] = {}
    known = {} if plan.geometry is None else plan.geometry.elements
    if "bars" in known:
        bars = known["bars"]
        ends = places.astype(np.float64)[:, bars.indices]
        length = np.linalg.norm(ends[:, :, 1] - ends[:, :, 0], axis=2)
        elements["bars", "length"] = length
        if "rest_length" in bars.static:
            rest = bars.static["rest_length"][0].astype(np.float64)
            # A bar without a rest length has no strain: that is NaN, and no warning.
            elements["bars", "strain"] = (length - rest) / np.where(rest > 0, rest, np.nan)
    if plan.hinge_angle is not None:
        elements["hinges", "angle"] = read(plan.hinge_angle, rows)
    writer.append(
        time[rows],
        positions=places[..., : plan.dims],
        velocities=read(file[_VELOCITIES], rows)[..., : plan.dims] if plan.velocities else None,
        elements=elements,
        channels={name: read(item, rows) for name, item in plan.channels.items()},
        system={name: read(item, rows).reshape(-1) for name, item in plan.system.items()},
        inputs={drive.name: drive.value[rows] for drive in plan.drives},
    )
