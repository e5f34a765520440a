"""What drove an older run: stored in it, or recovered from the folder around it."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import h5py
import numpy as np
from numpy.typing import NDArray

from openprc.errors import UnreadableFile
from openprc.schema import safety
from openprc.schema.legacy_kinds import read
from openprc.schema.legacy_siblings import Siblings, Wire

if TYPE_CHECKING:
    from openprc.schema import TrajectoryWriter

_UNITS = {"position": "m", "force": "N", "velocity": "m/s"}
_UNUSABLE = re.compile(r"[^A-Za-z0-9_.\- ]")
STORED = "time_series/actuation_signals"


@dataclass(frozen=True)
class Drive:
    """One input on the clock of the frames.

    Parameters
    ----------
    name, quantity, unit : str
    nodes : the nodes it acted on
    value : (T, C)
    absolute : bool
        Whether a position is meant, and not a displacement.
    """

    name: str
    quantity: str
    unit: str
    nodes: tuple[int, ...]
    value: NDArray[np.float64]
    absolute: bool = False

    @property
    def columns(self) -> list[str]:
        """Names of the C columns."""
        if self.value.shape[1] == 1:
            return ["value"]
        return ["x", "y", "z"][: self.value.shape[1]]

    def flattened(self) -> Drive:
        """Return the drive of a planar body: without z where that is 0 throughout."""
        if self.value.shape[1] < 3 or self.value[:, 2].any():
            return self
        return replace(self, value=self.value[:, :2])

    def declare(self, writer: TrajectoryWriter) -> None:
        """Tell the writer."""
        writer.declare_input(
            self.name,
            self.columns,
            quantity=self.quantity,
            unit=self.unit,
            targets=[f"node {node}" for node in self.nodes],
        )


def stored_drives(
    file: h5py.File, path: Path, rows: int, *, wires: tuple[Wire, ...], unit: str
) -> list[Drive]:
    """Return the drives that the file itself holds, one for each driven node.

    Positions were stored as displacement from where the node was at the start.

    Raises
    ------
    UnreadableFile
        When one of them is not a table of numbers of the length of the run.
    """
    group = file.get(STORED)
    if not isinstance(group, h5py.Group):
        return []
    wired = {wire.node: wire for wire in wires}  # of two on one node, only the last acted
    drives: list[Drive] = []
    for key in sorted(group, key=lambda name: (len(name), name)):
        item = group[key]
        width = item.shape[1:] if isinstance(item, h5py.Dataset) else ()
        if (
            not isinstance(item, h5py.Dataset)
            or item.dtype.kind not in "fiu"
            or item.ndim not in (1, 2)
            or width not in ((), (1,), (2,), (3,))
            or len(item) < rows
            or not key.isdecimal()
        ):
            raise UnreadableFile(
                "a stored drive has a form that is not known",
                expected=f"a dataset named by a node number, of {rows} rows and 1 to 3 columns",
                fix="remove it from the file, or export the run again",
                file=path,
                key=f"{STORED}/{key}",
            )
        value = read(item, slice(0, rows)).astype(np.float64).reshape(rows, -1)
        _check_finite(value, path, f"{STORED}/{key}")
        wire = wired.get(int(key))
        kind = "position" if wire is None else wire.type
        drives.append(
            Drive(
                name=_plain(wire.signal if wire else f"actuation_{key}"),
                quantity="displacement" if kind == "position" else kind,
                unit=unit if kind == "position" else _UNITS.get(kind, "arb"),
                nodes=(int(key),),
                value=value,
            )
        )
    return _merge(drives)


def signal_drives(
    siblings: Siblings, time: NDArray[np.float64], writer: TrajectoryWriter
) -> list[Drive]:
    """Return the drives recovered from signals.h5 and config.json, on the clock of the frames.

    Raises
    ------
    UnreadableFile
        When a signal is not a table of numbers, or the file does not say its time step.
    """
    path = siblings.signals_file
    if path is None or not siblings.wires:
        return []
    drives: list[Drive] = []
    absent: list[str] = []
    end = np.inf
    acting = {wire.node: wire for wire in siblings.wires}
    with safety.open_hdf5(path, allow_vlen=True) as file:
        dt = _signal_step(file, siblings, path)
        for wire in acting.values():
            item = file.get(wire.signal)
            if not isinstance(item, h5py.Dataset):
                absent.append(wire.signal)
                continue
            drives.append(_sample(item, wire, time, dt, path))
            end = min(end, (len(item) - 1) * dt)
    if absent:
        writer.note("signals.h5 has no signal " + ", ".join(sorted(set(absent))))
    if len(acting) < len(siblings.wires):
        writer.note("several actuators on one node: that engine let only the last one act")
    if any(drive.quantity == "velocity" for drive in drives):
        writer.note("velocity actuators had no effect in that engine")
    if any(not all(wire.dof) for wire in acting.values()):
        writer.note("some actuators name single axes (dof): most versions of that engine drove all")
    if drives:
        writer.add_source(path, role="signals")
        held = "; after that the last sample stays" if time[-1] > end * (1 + 1e-9) else ""
        writer.note(
            f"the drive was recovered from signals.h5 (a sample every {dt:g} s, up to {end:g} s"
            f"{held}) by linear interpolation at the frame times; that engine took the nearest "
            "sample"
        )
    return _merge(drives)


def _signal_step(file: h5py.File, siblings: Siblings, path: Path) -> float:
    stored = file.attrs.get("dt_base", siblings.number("dt_base"))
    dt = float(stored) if np.ndim(stored) == 0 and stored is not None else np.nan
    if not (np.isfinite(dt) and dt > 0):
        raise UnreadableFile(
            f"the time step of the signals is {stored}",
            expected="a root attribute dt_base above 0 [s]",
            fix="add it, or move the input folder away to import the run without its drive",
            file=path,
            key="@dt_base",
        )
    return dt


def _sample(
    item: h5py.Dataset, wire: Wire, time: NDArray[np.float64], dt: float, path: Path
) -> Drive:
    good = item.dtype.kind in "fiu" and item.ndim in (1, 2) and len(item) > 0
    values = read(item).astype(np.float64) if good else np.empty(0)
    values = values.reshape(len(values), -1)
    _check_finite(values, path, wire.signal)
    if not good or values.shape[1] not in (1, 3):
        raise UnreadableFile(
            f"the signal is {item.dtype} of shape {item.shape}",
            expected="(T,) or (T, 3) numbers",
            fix="correct it, or move the input folder away to import the run without its drive",
            file=path,
            key=wire.signal,
        )
    at = np.arange(len(values)) * dt
    return Drive(
        name=_plain(wire.signal),
        quantity=wire.type,
        unit=_UNITS.get(wire.type, "arb"),
        nodes=(wire.node,),
        value=np.stack([np.interp(time, at, column) for column in values.T], axis=1),
        absolute=wire.type == "position",
    )


def _check_finite(values: NDArray[np.float64], path: Path, key: str) -> None:
    bad = np.flatnonzero(~np.isfinite(values).all(axis=1))
    if bad.size:
        raise UnreadableFile(
            f"the drive is {values[bad[0]].tolist()} at sample {bad[0]}",
            expected="finite numbers",
            fix="correct it, or remove it to import the run without this drive",
            file=path,
            key=key,
        )


def _merge(drives: list[Drive]) -> list[Drive]:
    """Join the drives of one signal; tell apart those that share a name only."""
    merged: dict[str, Drive] = {}
    for drive in drives:
        twin = merged.get(drive.name)
        if twin is None:
            merged[drive.name] = drive
        elif twin.quantity == drive.quantity and np.array_equal(twin.value, drive.value):
            merged[drive.name] = replace(twin, nodes=twin.nodes + drive.nodes)
        else:
            # One signal displaces two nodes differently: each started somewhere else.
            name = f"{drive.name} of node {drive.nodes[0]}"
            merged[name] = replace(drive, name=name)
    return list(merged.values())


def _plain(name: str) -> str:
    return _UNUSABLE.sub("_", name).lstrip(".- ") or "_"


def check_followed(
    drives: list[Drive], places: Mapping[int, NDArray[np.float64]], writer: TrajectoryWriter
) -> None:
    """Compare position drives with what the driven nodes did, and note the outcome.

    Parameters
    ----------
    places : mapping of node to (T, 2 or 3) [m]
    """
    worst, last = 0.0, 0.0
    strangers: list[str] = []
    for drive in drives:
        if drive.quantity not in ("position", "displacement") or drive.value.shape[1] < 2:
            continue
        for node in drive.nodes:
            if node not in places:
                continue
            error = places[node][:, : drive.value.shape[1]] - drive.value
            if not drive.absolute:
                # Displacement from the start, which is not stored: any constant will do.
                error -= np.median(error, axis=0)
            distance = np.abs(error).max(axis=1)
            reach = max(float(np.ptp(drive.value, axis=0).max()), 1e-12)
            if len(distance) < 2 or distance[:-1].max() > 1e-2 * reach:
                strangers.append(f"node {node}")
            else:
                worst, last = max(worst, distance[:-1].max()), max(last, distance[-1])
    if strangers:
        writer.note(
            "the stored drive and the motion disagree at "
            + ", ".join(strangers)
            + ": the input folder may belong to another run, or the actuator had no effect"
        )
    if last > 10 * worst and last > 1e-9:
        writer.note(
            f"driven nodes follow the drive to within {worst:.1g} m, except in the last frame "
            f"({last:.1g} m): the program extrapolated the drive there"
        )
