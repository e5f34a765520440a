"""What of a trajectory both exporters show: places, nodal fields, fields of bars and faces."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from openprc.errors import MissingData
from openprc.exporters.rows import Rows, require_positions
from openprc.schema import safety

if TYPE_CHECKING:
    import h5py

    from openprc.schema import Trajectory

POSITIONS = "/time_series/nodes/positions"
OBSERVED = "/time_series/nodes/observed"
#: Kinds of elements that a viewer can draw.
DRAWN = ("bars", "faces")


@dataclass(frozen=True)
class Field:
    """A dataset with time along axis 0.

    Attributes
    ----------
    name : str
        As viewers show it.
    path : str
        In the file.
    shape : tuple of int
        (T, N, D), (T, E) or (T, E, k).
    dtype : str
        ``f8``, ``f4`` or ``u1``.
    """

    name: str
    path: str
    shape: tuple[int, ...]
    dtype: str
    unit: str = ""


@dataclass(frozen=True)
class Outline:
    """What is exported.

    Attributes
    ----------
    frames : range
        Rows of the trajectory.
    elements : mapping of kind to number
    nodal : fields of the nodes; cell : mapping of kind to fields
    remarks : mapping of key to text
        Units and gaps, for the head of the file.
    """

    frames: range
    dims: int
    n_nodes: int
    positions: Field
    nodal: tuple[Field, ...]
    elements: Mapping[str, int]
    cell: Mapping[str, tuple[Field, ...]]
    remarks: Mapping[str, str]


def outline(trajectory: Trajectory, options: Mapping[str, Any]) -> Outline:
    """Look at what there is to export and at what is asked for.

    Raises
    ------
    MissingData
        When there are no positions, or there is no such field.
    ConfigError
        When the stride is below 1.
    """
    stride = Rows(trajectory.n_frames, options).stride
    require_positions(trajectory)
    with safety.open_hdf5(trajectory.path) as file:
        positions = _field(file, "positions", POSITIONS)
        nodal = [
            _field(file, name, f"/time_series/nodes/{name}")
            for name in ("velocities", "observed")
            if f"/time_series/nodes/{name}" in file
        ]
        elements = {
            kind: len(file[f"topology/{kind}/indices"])
            for kind in DRAWN
            if f"topology/{kind}/indices" in file
        }
        cell = {
            kind: [
                _field(file, quantity, f"/time_series/elements/{kind}/{quantity}")
                for quantity in trajectory.element_series(kind)
            ]
            for kind, count in elements.items()
            if count
        }
    known = {field.name for field in [*nodal, *(f for fields in cell.values() for f in fields)]}
    chosen = set(options.get("fields") or known)
    if chosen == {"none"}:
        chosen = set()
    elif chosen - known:
        raise MissingData(
            f"there is no field {sorted(chosen - known)[0]!r} to export",
            expected="none, or some of " + (", ".join(sorted(known)) or "no field at all"),
            fix="correct the option fields",
            file=trajectory.path,
            key="fields",
        )
    nodal = [field for field in nodal if field.name in chosen]
    cell = {kind: [f for f in fields if f.name in chosen] for kind, fields in cell.items()}
    frames = range(0, trajectory.n_frames, stride)
    return Outline(
        frames=frames,
        dims=trajectory.dims,
        n_nodes=trajectory.n_nodes,
        positions=positions,
        nodal=tuple(nodal),
        elements=elements,
        cell={kind: tuple(fields) for kind, fields in cell.items()},
        remarks=_remarks(trajectory, [positions, *nodal], cell, frames),
    )


def _field(file: h5py.File, name: str, path: str) -> Field:
    item = file[path]
    unit = str(item.attrs.get("unit", ""))
    return Field(name, path, item.shape, f"{item.dtype.kind}{item.dtype.itemsize}", unit)


def _remarks(
    trajectory: Trajectory,
    nodal: list[Field],
    cell: Mapping[str, list[Field]],
    frames: range,
) -> dict[str, str]:
    remarks = {
        "openprc.dims": str(trajectory.dims),
        "openprc.time.unit": trajectory.time_unit,
        "openprc.time.kind": trajectory.time_kind,
    }
    remarks.update({f"openprc.unit.{field.name}": field.unit for field in nodal if field.unit})
    for kind, fields in cell.items():
        remarks.update({f"openprc.unit.{kind}.{f.name}": f.unit for f in fields})
    if trajectory.has(OBSERVED):
        marks = trajectory.observed(slice(frames.start, frames.stop, frames.step))
        gone = int(np.count_nonzero(marks == 0))
        if gone:
            remarks["openprc.missing"] = (
                f"{gone} of {marks.size} places were not observed and are NaN; "
                "the field observed is 0 there"
            )
    return remarks
