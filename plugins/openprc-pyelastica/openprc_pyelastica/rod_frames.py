"""Frames of a run, laid out as the native engine lays them out."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from openprc.demlat.producer import FrameRecorder
from openprc.demlat.signal_table import sample_signal
from openprc.schema.bend_angle import bend_angles

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from openprc.schema import Experiment, TrajectoryWriter


class RodFrames:
    """Says what is recorded and hands blocks of frames to the writer.

    Parameters
    ----------
    experiment : Experiment
    writer : TrajectoryWriter
    thinning : bool
        Whether the section of a rod thins as it is drawn out.
    """

    def __init__(self, experiment: Experiment, writer: TrajectoryWriter, *, thinning: bool) -> None:
        self.thinning = thinning
        self.experiment = experiment
        self.writer = writer
        self.dims = 2 if experiment.planar else 3
        self.stored = experiment.stored
        self.inputs = FrameRecorder(experiment, writer).inputs
        self.largest_strain = 0.0

    def declare(self) -> None:
        """Declare nodes, bars, bends and inputs."""
        geometry, writer = self.experiment.geometry, self.writer
        dtype: Literal["f8", "f4"] = "f4" if self.stored.precision == "float32" else "f8"
        writer.declare_nodes(
            geometry.n_nodes,
            self.dims,
            unit="m",
            dtype=dtype,
            velocities=self.stored.velocities,
            rest=geometry.positions[:, : self.dims],
            mass=geometry.masses,
            fixed=geometry.fixed,
            labels=None if geometry.labels is None else list(geometry.labels),
        )
        bars, bends = geometry.bars, geometry.bends
        constants: dict[str, tuple[Any, str | None]] = {
            "rest_length": (bars.rest_length, "m"),
            "stiffness": (bars.stiffness, "N/m"),
            "prestress": (bars.prestress, "1"),
        }
        series = {"length": "m", "strain": "1", "force": "N"}
        writer.declare_elements(
            "bars",
            bars.indices,
            series=series if self.stored.elements else {},
            dtype=dtype,
            static=constants,
        )
        if len(bends):
            writer.declare_elements(
                "bends",
                bends.indices,
                series={"angle": "rad", "torque": "N*m"} if self.stored.elements else {},
                dtype=dtype,
                static={
                    "rest_angle": (bends.rest_angle, "rad"),
                    "stiffness": (bends.stiffness, "N*m/rad"),
                },
            )
        if len(geometry.faces):
            writer.declare_elements("faces", geometry.faces)
        for name, settings in self.inputs.items():
            writer.declare_input(name, **settings["declaration"])

    def append(
        self, first: int, positions: NDArray[np.float64], velocities: NDArray[np.float64]
    ) -> None:
        """Append a block of frames (B, N, 3) of which the first has the number `first`."""
        times = (first + np.arange(len(positions))) * self.experiment.save_interval
        bars, bends = self.experiment.geometry.bars, self.experiment.geometry.bends
        arms = positions[:, bars.indices[:, 1]] - positions[:, bars.indices[:, 0]]
        length = np.sqrt(np.einsum("tbx,tbx->tb", arms, arms))
        stretch = length / bars.relaxed_length
        self.largest_strain = max(self.largest_strain, float(np.abs(stretch - 1.0).max()))
        elements: dict[tuple[str, str], NDArray[np.float64]] = {}
        if self.stored.elements:
            elements["bars", "length"] = length
            elements["bars", "strain"] = length / bars.rest_length - 1.0
            tension = bars.stiffness * (length - bars.relaxed_length)
            elements["bars", "force"] = tension / stretch if self.thinning else tension
            if len(bends):
                angle = bend_angles(positions, bends.indices)
                elements["bends", "angle"] = angle
                elements["bends", "torque"] = bends.stiffness * (angle - bends.rest_angle)
        self.writer.append(
            times,
            positions=positions[..., : self.dims],
            velocities=velocities[..., : self.dims] if self.stored.velocities else None,
            elements=elements,
            inputs={
                name: sample_signal(settings["signal"], times)
                for name, settings in self.inputs.items()
            },
        )
