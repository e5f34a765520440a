"""A scene in the arrays that CUDA kernels take, on the device."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numba import cuda

from openprc.demlat.backends.cuda_elements import (
    CABLE,
    COSINE,
    CUBIC,
    DAMPING,
    DAMPING_CUBIC,
    DRAG_I,
    DRAG_J,
    HIGH,
    HIGH_ROOM,
    LINEAR,
    LOW,
    LOW_ROOM,
    OGDEN,
    RELAXED,
    REST_BEND,
    SINE,
    STIFFNESS,
    STIFFNESS_CUBIC,
    STRUT,
    Bars,
    Drives,
    Hinges,
)
from openprc.demlat.backends.cuda_kernels import Elements, Frames, Nodes
from openprc.demlat.models.barhinge import tables

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from openprc.demlat.models.barhinge.assembly import Assembly

_LAWS = {
    tables.LinearBars: LINEAR,
    tables.CubicBars: CUBIC,
    tables.Cables: CABLE,
    tables.Struts: STRUT,
    tables.OgdenBars: OGDEN,
}
_BAR_ROWS = {
    "stiffness": STIFFNESS,
    "relaxed": RELAXED,
    "damping": DAMPING,
    "stiffness_cubic": STIFFNESS_CUBIC,
    "damping_cubic": DAMPING_CUBIC,
    "drag_i": DRAG_I,
    "drag_j": DRAG_J,
}
_HINGE_ROWS = {
    "stiffness": STIFFNESS,
    "sine": SINE,
    "damping": DAMPING,
    "cosine": COSINE,
    "rest_bend": REST_BEND,
    "low": LOW,
    "high": HIGH,
    "low_room": LOW_ROOM,
    "high_room": HIGH_ROOM,
}


@dataclass(frozen=True)
class DeviceScene:
    """A scene on the device.

    Attributes
    ----------
    elements : Elements
    nodes : Nodes
    drives : Drives
    n_nodes, n_elements : int
    """

    elements: Elements
    nodes: Nodes
    drives: Drives
    n_nodes: int
    n_elements: int

    @classmethod
    def from_assembly(cls, assembly: Assembly) -> DeviceScene:
        """Copy a scene to the device.

        Parameters
        ----------
        assembly : Assembly
            Of one scene in three dimensions, element by element, in absolute coordinates.
        """
        packing, body = assembly.packing, assembly.body
        n, stride = packing.n_nodes, packing.stride
        n_bars, n_hinges = len(body.scratch[0]), len(body.scratch[2])

        def by_axis(flat: NDArray[np.float64]) -> NDArray[np.float64]:
            return flat.reshape(3, stride)[:, :n]

        bars, hinges = bar_table(body.bars, n_bars), hinge_table(body.hinges, n_hinges)
        first_end, slots, n_slots = gather_list(bars, hinges, n)
        start = [by_axis(assembly.state.x), by_axis(assembly.state.v)]
        motion = np.concatenate([*start, *start, np.zeros((6, n))])
        columns = (body.inverse_mass, body.drag, body.weight, body.full_weight)
        constants = np.concatenate([*(by_axis(c) for c in columns), by_axis(body.mass)[:1]])
        nodes = Nodes(motion, constants, np.zeros((2, n)), first_end, slots)
        elements = Elements(
            bars,
            hinges,
            np.zeros((3, n_slots)),
            np.zeros(n_bars + n_hinges),
            np.zeros(n_bars + n_hinges),
        )
        return cls(
            on_device(elements),
            on_device(nodes),
            on_device(drive_table(body.drives, n, stride)),
            n,
            n_bars + n_hinges,
        )


def on_device(record: Any) -> Any:
    """Return arrays, or a record of arrays and records, on the device."""
    if isinstance(record, tuple):
        return type(record)(*(on_device(part) for part in record))
    return cuda.to_device(np.ascontiguousarray(record))


def bar_table(groups: tuple[Any, ...], n_bars: int) -> Bars:
    """Return the bars of all groups in the order of the geometry, on the host."""
    table = Bars(np.zeros((3, n_bars), np.int32), np.zeros((7, n_bars)))
    for group in groups:
        if type(group) in _LAWS:
            table.nodes[:2, group.element] = group.i, group.j
            table.nodes[2, group.element] = _LAWS[type(group)]
        _fill(table.reals, group, _BAR_ROWS)
    return table


def hinge_table(groups: tuple[Any, ...], n_hinges: int) -> Hinges:
    """Return the hinges of all groups in the order of the geometry, on the host."""
    table = Hinges(np.zeros((5, n_hinges), np.int32), np.zeros((9, n_hinges)))
    for group in groups:
        table.nodes[:4, group.element] = group.j, group.k, group.i, group.l
        table.nodes[4, group.element] = isinstance(group, tables.WalledHinges)
        _fill(table.reals, group, _HINGE_ROWS)
    return table


def _fill(reals: NDArray[np.float64], group: Any, rows: dict[str, int]) -> None:
    for name, row in rows.items():
        if name in group._fields:
            reals[row, group.element] = getattr(group, name)


def gather_list(
    bars: Bars, hinges: Hinges, n_nodes: int
) -> tuple[NDArray[np.int32], NDArray[np.int32], int]:
    """Return which slots a node adds up, and how many slots there are.

    The two ends of a bar share a slot, with opposite signs, unless its damper is as printed.

    Returns
    -------
    first : (N + 1,) i4
    slots : (E,) i4
        By node, in the order of the elements; ``-1 - s`` for the negative of slot s.
    n_slots : int
    """
    n_bars, n_hinges = bars.nodes.shape[1], hinges.nodes.shape[1]
    number = np.arange(n_bars)
    apart = (bars.reals[DRAG_I] != 0.0) | (bars.reals[DRAG_J] != 0.0)
    n_bar_slots = 2 * n_bars if apart.any() else n_bars
    folds = n_bar_slots + np.arange(4 * n_hinges).reshape(4, n_hinges)
    at = np.concatenate([bars.nodes[0], bars.nodes[1], hinges.nodes[:4].reshape(-1)])
    slot = np.concatenate(
        [number, np.where(apart, n_bars + number, -1 - number), folds.reshape(-1)]
    )
    order = np.argsort(at, kind="stable")
    first = np.concatenate([[0], np.cumsum(np.bincount(at, minlength=n_nodes))])
    n_slots = n_bar_slots + 4 * n_hinges
    return first.astype(np.int32), slot[order].astype(np.int32), n_slots


def drive_table(drives: tables.Drives, n_nodes: int, stride: int) -> Drives:
    """Return the drives by coordinate, on the host."""
    signals = drives.signals
    motion_row = np.full((3, n_nodes), -1, np.int32)
    axis, node = np.divmod(drives.motion_at, stride)
    motion_row[axis, node] = np.arange(len(node))
    axis, node = np.divmod(drives.force_at, stride)
    target = 3 * node + axis
    order = np.argsort(target, kind="stable")
    first = np.concatenate([[0], np.cumsum(np.bincount(target, minlength=3 * n_nodes))])
    return Drives(
        motion_row=motion_row,
        motion_column=drives.motion_signal.astype(np.int32),
        motion_reals=np.stack([drives.motion_start, drives.motion_drag, drives.motion_weight]),
        push_first=first.astype(np.int32),
        push_column=drives.force_signal[order].astype(np.int32),
        signal_rows=np.stack([signals.first, signals.count]).astype(np.int32),
        signal_dt=signals.dt,
        coefficients=signals.coefficients,
    )


def device_frames(count: int, *, n_nodes: int, n_bars: int, n_hinges: int) -> Frames:
    """Return room for `count` frames on the device."""
    nodes = (count, n_nodes, 3)
    widths = (n_bars, n_bars, n_hinges, n_hinges)
    return on_device(
        Frames(
            np.zeros(nodes),
            np.zeros(nodes),
            *(np.zeros((count, width)) for width in widths),
            np.zeros((2, n_nodes)),
        )
    )
