"""Small trajectories with every kind of content, for exporters to carry away."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from openprc.schema.dihedral import dihedral_angles
from openprc.schema.provenance import Provenance
from openprc.schema.writer import TrajectoryWriter
from openprc.testing.workbench import kit_folder

N_FRAMES, DT, HOLD = 25, 0.02, 0.1

#: What there is, and what it stands for.
KINDS = {
    "body": "nodes in space with bars, a hinge, faces, velocities, a channel and a held input",
    "planar": "nodes in a plane",
    "gaps": "nodes of which some were not seen in some frames",
    "channels": "sensor readings without nodes",
}


def times() -> NDArray[np.float64]:
    """Return the frame times, (T,) [s]."""
    return DT * np.arange(N_FRAMES, dtype=np.float64)


def places(dims: int) -> NDArray[np.float64]:
    """Return a motion of four nodes, (T, 4, dims) [m], different in every coordinate."""
    t = times()[:, np.newaxis]
    node = np.arange(4.0)
    columns = (
        node + 0.1 * np.sin(3.0 * t + node),
        0.5 * node**2 + 0.05 * np.cos(5.0 * t - node),
        0.2 * node + 0.3 * t * (node + 1.0),
    )
    return np.stack(columns[:dims], axis=-1)


def seen() -> NDArray[np.uint8]:
    """Return the mask of the trajectory with gaps, (T, 4)."""
    mask = np.ones((N_FRAMES, 4), np.uint8)
    mask[5:8, 1] = 0
    mask[20, 3] = 0
    return mask


def drive() -> NDArray[np.float64]:
    """Return the input on the clock of the frames, (T, 1)."""
    return symbols()[np.minimum(np.arange(N_FRAMES) // 5, len(symbols()) - 1)]


def symbols() -> NDArray[np.float64]:
    """Return the symbols of the input, (5, 1)."""
    return np.array([[0.1], [-0.4], [0.25], [0.9], [-0.7]])


@cache
def trajectory(kind: str) -> Path:
    """Return a finished file of one of `KINDS`, written once a process."""
    path = kit_folder() / f"exported-{kind}.h5"
    with TrajectoryWriter(path, provenance=Provenance("closed-form")) as writer:
        content: dict[str, Any] = {}
        if kind == "channels":
            writer.declare_channel("gauge", ["left", "right"], unit="V")
            content["channels"] = {"gauge": places(2)[:, :2, 0]}
        else:
            _nodes(writer, content, kind)
        writer.declare_input(
            "u", ["u"], quantity="force", unit="N", sequence=symbols(), hold=HOLD, start=0.0
        )
        writer.append(times(), inputs={"u": drive()}, **content)
    return path


def _nodes(writer: TrajectoryWriter, content: dict[str, Any], kind: str) -> None:
    dims = 2 if kind == "planar" else 3
    x = places(dims)
    body = kind == "body"
    writer.declare_nodes(
        4, dims, unit="m", velocities=body, observed=kind == "gaps", mass=np.full(4, 0.1),
        rest=x[0],
    )  # fmt: skip
    if kind == "gaps":
        content["observed"] = seen()
        x[seen() == 0] = np.nan
    if body:
        pairs = np.array([(0, 1), (0, 2), (1, 2), (0, 3), (1, 3)])
        length = np.linalg.norm(x[:, pairs[:, 0]] - x[:, pairs[:, 1]], axis=2)
        writer.declare_elements(
            "bars", pairs, series={"length": "m"},
            static={"rest_length": (length[0], "m"), "stiffness": (np.full(5, 50.0), "N/m")},
        )  # fmt: skip
        crease = np.array([[0, 1, 2, 3]])
        writer.declare_elements(
            "hinges", crease, series={"angle": "rad"},
            static={"rest_angle": (dihedral_angles(x[:1], crease)[0], "rad"),
                    "stiffness": (np.ones(1), "N*m/rad")},
        )  # fmt: skip
        writer.declare_elements("faces", np.array([(0, 1, 2), (0, 3, 1)]))
        writer.declare_channel("gauge", ["left"], unit="V")
        content["velocities"] = np.gradient(x, times(), axis=0)
        content["elements"] = {
            ("bars", "length"): length,
            ("hinges", "angle"): dihedral_angles(x, crease),
        }
        content["channels"] = {"gauge": x[:, :1, 0]}
    content["positions"] = x


__all__ = ["KINDS", "drive", "places", "seen", "symbols", "times", "trajectory"]
