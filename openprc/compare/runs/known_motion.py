"""A known motion as a trajectory file, so that runs are compared with it like with any other."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from openprc.errors import ConfigError
from openprc.schema.provenance import Provenance, typed_command
from openprc.schema.writer import TrajectoryWriter

if TYPE_CHECKING:
    from openprc.scenes.scene import Scene
    from openprc.schema.experiment import Experiment

_BLOCK_BYTES = 8 << 20


def reference_name(scene: Scene) -> str:
    """Return what tables call the known motion of a scene, such as "closed-form"."""
    return scene.reference.kind.replace(" ", "-")


def write_exact(scene: Scene, path: str | Path, *, overwrite: bool = False) -> Path:
    """Write the exact motion of a scene at the frames of its experiment.

    Raises
    ------
    ConfigError
        When the scene has no formula for the motion of all nodes.
    ResultExists
        When `path` exists and `overwrite` is false.
    """
    exact = scene.reference.exact
    if exact is None:
        raise ConfigError(
            f"the motion of {scene.name} is not known as a formula",
            expected="a scene with a closed form",
            fix="take a producer as the reference",
        )
    experiment = scene.experiment
    times = experiment.frame_times
    rows = max(1, _BLOCK_BYTES // (24 * experiment.geometry.n_nodes))
    with TrajectoryWriter(
        path,
        provenance=Provenance(reference_name(scene), command=typed_command()),
        overwrite=overwrite,
        on_failure="discard",
    ) as writer:
        dims = declare_like(experiment, writer)
        writer.note(f"{scene.reference.text} ({scene.reference.source})")
        for start in range(0, len(times), rows):
            part = times[start : start + rows]
            writer.append(part, positions=np.asarray(exact(part))[..., :dims])
    return Path(path)


def declare_like(experiment: Experiment, writer: TrajectoryWriter) -> int:
    """Declare the nodes and the bars of an experiment; return the dimensions of space."""
    geometry = experiment.geometry
    dims = 2 if experiment.planar else 3
    writer.declare_nodes(
        geometry.n_nodes,
        dims,
        unit="m",
        rest=geometry.positions[:, :dims],
        mass=geometry.masses,
        fixed=geometry.fixed,
        labels=None if geometry.labels is None else list(geometry.labels),
    )
    if len(geometry.bars):
        writer.declare_elements("bars", geometry.bars.indices)
    return dims


__all__ = ["declare_like", "reference_name", "write_exact"]
