"""The exporter to FOLD 1.2: a trajectory as an animation (https://github.com/edemaine/fold)."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from openprc.errors import MissingData
from openprc.exporters.rows import Rows, require_positions
from openprc_merlin import geometry
from openprc_merlin.exported_file import new_file
from openprc_merlin.fold_creases import Creases, creases_of
from openprc_merlin.fold_units import frame_unit

if TYPE_CHECKING:
    from openprc.schema import Trajectory

Floats = NDArray[np.float64]
_BLOCK = 256
#: Constants of bars and hinges that are kept.
_CONSTANTS = (
    "rest_length", "rest_angle", "stiffness", "damping", "prestress", "area", "crease_length",
    "moment_coefficient", "moment_exponent", "kind_code", "law", "rigid", "limit_low", "limit_high",
    "stiffness_cubic", "damping_cubic",
)  # fmt: skip


class FoldExporter:
    """Writes frame 0 as the key frame and every other one into ``file_frames``.

    Bars become edges, hinges their fold angles. Assignments are those of the rest shape, fold
    angles those of each frame. What FOLD has no key for (instants, rest shape, constants,
    inputs) stands under keys that begin with ``openprc:``. Velocities, channels, whole-body
    quantities and what can be computed from the positions stay behind.
    """

    def export(
        self, trajectory: Trajectory, path: Path, *, options: Mapping[str, Any]
    ) -> list[Path]:
        """Write `trajectory` to `path` and return the one file made.

        Raises
        ------
        MissingData
            When there are no nodes, or a point is missing.
        ConfigError
            When `stride` is below 1.
        ResultExists
            When `path` exists.
        """
        path = Path(path)
        rows = Rows(trajectory.n_frames, options)
        require_positions(trajectory)
        creases = creases_of(trajectory)
        frames = np.arange(0, trajectory.n_frames, rows.stride)
        states = _states(trajectory, creases, frames, rows.stride)
        key = {**_envelope(trajectory, creases, frames), **next(states)}
        with new_file(path) as stream:
            stream.write(b"{\n")
            for name, value in key.items():
                stream.write(f"{json.dumps(name)}: {_text(value)},\n".encode())
            stream.write(b'"file_frames": [')
            for number, state in enumerate(states):
                state = {"frame_inherit": True, "frame_parent": 0, **state}
                stream.write(((",\n" if number else "\n") + _text(state)).encode())
            stream.write(b"\n]}\n")
        return [path]


def _text(value: Any) -> str:
    # The shortest text of a float reads back as the same one.
    return json.dumps(value, allow_nan=False, separators=(",", ":"))


def _states(
    trajectory: Trajectory, creases: Creases, frames: NDArray[np.intp], stride: int
) -> Iterator[dict[str, Any]]:
    """Yield what changes from frame to frame."""
    time = trajectory.time
    for begin in range(0, len(frames), _BLOCK):
        chosen = frames[begin : begin + _BLOCK]
        positions = trajectory.positions(slice(int(chosen[0]), int(chosen[-1]) + 1, stride))
        bad = np.argwhere(~np.isfinite(positions))
        if bad.size:
            raise MissingData(
                f"node {int(bad[0, 1])} is missing in frame {int(chosen[bad[0, 0]])}",
                expected="the position of every node in every frame: JSON has no NaN",
                fix="export a run without gaps, or fill them first",
                file=trajectory.path,
                key="/time_series/nodes/observed",
            )
        folded = _fold_angles(positions, creases)
        for row, frame in enumerate(chosen.tolist()):
            state: dict[str, Any] = {"vertices_coords": positions[row].tolist()}
            if folded is not None:
                state["edges_foldAngle"] = [
                    None if angle != angle else angle for angle in folded[row].tolist()
                ]
            state["openprc:time"] = float(time[frame])
            yield state


def _fold_angles(positions: Floats, creases: Creases) -> Floats | None:
    """Return (B, E) fold angles [deg], positive for valleys, NaN where none is defined."""
    if not creases.is_folded:
        return None
    angles = np.where(creases.boundary, 0.0, np.nan) * np.ones((len(positions), 1))
    opening = geometry.dihedral_angles(positions, creases.hinges)
    angles[:, creases.edge_of_hinge] = np.rad2deg(creases.sense * (np.pi - opening))
    # -0.0 and 0.0 are one angle, and should be one text.
    return angles + 0.0


def _envelope(trajectory: Trajectory, creases: Creases, frames: NDArray[np.intp]) -> dict[str, Any]:
    """Return the keys that every frame inherits."""
    envelope: dict[str, Any] = {
        "file_spec": 1.2,
        "file_creator": "OpenPRC",
        "file_classes": ["animation"],
        "frame_classes": ["foldedForm"],
        "frame_attributes": [f"{trajectory.dims}D"],
        "frame_unit": frame_unit(trajectory.position_unit),
    }
    if len(creases.edges):
        envelope["edges_vertices"] = creases.edges.tolist()
        envelope["edges_assignment"] = list(creases.assignments)
    if len(creases.faces):
        envelope["faces_vertices"] = creases.faces.tolist()
        as_stored = trajectory.indices("faces")
        if not np.array_equal(as_stored, creases.faces):
            # FOLD wants neighbours turned alike, which not every producer cares for.
            envelope["openprc:faces"] = {"vertices": as_stored.tolist()}
    envelope["openprc:clock"] = {"unit": trajectory.time_unit, "kind": trajectory.time_kind}
    envelope["openprc:nodes"] = _nodes(trajectory)
    for kind in ("bars", "hinges"):
        if kind not in trajectory.element_kinds:
            continue
        rows = trajectory.indices(kind)
        said: dict[str, Any] = {"count": len(rows)}
        if kind == "hinges":
            said["vertices"] = rows.tolist()
        envelope[f"openprc:{kind}"] = {**said, "static": _constants(trajectory, kind)}
    inputs = {name: _signal(trajectory, name, frames) for name in trajectory.inputs}
    if inputs:
        envelope["openprc:inputs"] = inputs
    return envelope


def _nodes(trajectory: Trajectory) -> dict[str, Any]:
    said: dict[str, Any] = {"unit": trajectory.position_unit}
    for name in ("rest", "mass", "fixed", "id", "label"):
        path = f"/topology/nodes/{name}"
        if trajectory.has(path):
            said[name] = [_plain(value) for value in trajectory.node(name)]
            if name == "mass":
                said["mass_unit"] = trajectory.unit(path)
    return said


def _constants(trajectory: Trajectory, kind: str) -> dict[str, Any]:
    constants = {}
    for name in _CONSTANTS:
        path = f"/topology/{kind}/{name}"
        if not trajectory.has(path):
            continue
        values = trajectory.element_static(kind, name)
        unit = trajectory.unit(path) if values.dtype.kind == "f" else None
        constants[name] = {
            "values": [_plain(value) for value in values],
            "unit": unit,
            "type": values.dtype.kind,
        }
    return constants


def _plain(value: Any) -> Any:
    """Return a number, list or text for JSON; NaN and infinity, which it has not, as null."""
    if isinstance(value, bytes):
        return value.decode("utf-8", "replace")
    if isinstance(value, np.ndarray):
        return [_plain(item) for item in value]
    if isinstance(value, np.floating):
        return float(value) if np.isfinite(value) else None
    return value.item() if isinstance(value, np.generic) else value


def _signal(trajectory: Trajectory, name: str, frames: NDArray[np.intp]) -> dict[str, Any]:
    signal = trajectory.input(name)
    said: dict[str, Any] = {
        "columns": list(signal.columns),
        "unit": signal.unit,
        "quantity": signal.quantity,
        "targets": list(signal.targets),
        "values": signal.value[frames].tolist(),
    }
    if signal.sequence is not None:
        said |= {"sequence": signal.sequence.tolist(), "hold": signal.hold, "start": signal.start}
    return said
