"""What a quasi-static run leaves in its file: the layout of the engine's runs, without time."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from openprc.demlat.producer import FrameRecorder
from openprc.demlat.signal_table import sample_signal
from openprc.schema.bend_angle import bend_angles
from openprc_merlin import extension

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from openprc.demlat.statics import StaticProblem
    from openprc.schema import Experiment, TrajectoryWriter
    from openprc_merlin.equilibrium_path import PathPoint
    from openprc_merlin.path_control import Drives

    Floats = NDArray[np.float64]

_ENERGIES = ("elastic_energy_bars", "elastic_energy_hinges", "elastic_energy_bends")


class PathRecorder(FrameRecorder):
    """Turns points of a path into frames, one an increment.

    Parameters
    ----------
    experiment : Experiment
    writer : TrajectoryWriter
    problem : StaticProblem
        Without the reference load.
    drives : Drives
    along : bool
        Whether the load factor is found along an arc, and is the input; else the signals are.
    """

    def __init__(
        self,
        experiment: Experiment,
        writer: TrajectoryWriter,
        *,
        problem: StaticProblem,
        drives: Drives,
        along: bool,
    ) -> None:
        super().__init__(experiment, writer)
        self.problem = problem
        self.along = along
        self.count = 0
        self.hidden = 0
        self.reaction_axes = _imposed(experiment, drives)
        self.held = drives.held.copy()
        self.held.reshape(-1)[self.reaction_axes] = False
        self.reference = drives.reference
        loaded = drives.reference.any(axis=1) if along else np.zeros(len(drives.held), bool)
        self.targets = [f"node {node}" for node in np.flatnonzero(loaded)]
        elements = experiment.geometry.bars, experiment.geometry.hinges, experiment.geometry.bends
        self.energies = [n for n, e in zip(_ENERGIES, elements, strict=True) if len(e)]
        self.heavy = bool(np.any(experiment.gravity))

    def declare(self) -> None:
        """Declare the pseudo time, nodes, elements, energies, inputs and reactions."""
        writer = self.writer
        writer.declare_time(unit="1", kind="pseudo")
        self.declare_body(velocities=False)
        for name in (*self.energies, *(["gravity_energy"] if self.heavy else [])):
            writer.declare_system(name, unit="J")
        writer.declare_system("potential_energy", unit="J")
        writer.declare_system("residual", unit="N")
        writer.declare_system("iterations", unit="1")
        writer.declare_system("negative_eigenvalues", unit="1")
        # Supports of single axes, and the load that the factor multiplies, have no other place.
        writer.declare_extension(extension.NAME, extension.VERSION)
        writer.put_extension(
            extension.NAME, "held", self.held.astype("u1"), comment="supported degrees of freedom"
        )
        if self.along:
            writer.put_extension(
                extension.NAME, "reference_load", self.reference, unit="N",
                comment="forces at a load factor of 1",
            )  # fmt: skip
            writer.declare_input(
                "load", ["load factor"], quantity="load factor", unit="1", targets=self.targets
            )
            return
        for name, settings in self._followed().items():
            writer.declare_input(name, **settings["declaration"])
        if len(self.reaction_axes):
            writer.declare_channel(
                "reaction",
                [f"{self._label(dof // 3)} {'xyz'[dof % 3]}" for dof in self.reaction_axes],
                unit="N",
                quantity="minus the force applied at each imposed degree of freedom",
            )

    def record(self, point: PathPoint) -> None:
        """Append the next increment."""
        problem, x = self.problem, point.positions
        geometry = problem.geometry
        *elastic, applied = (float(part.sum()) for part in problem.energies(x))
        kept = dict(zip(_ENERGIES, elastic, strict=True))
        system = {name: kept[name] for name in self.energies}
        if self.heavy:
            system["gravity_energy"] = applied
        system["potential_energy"] = sum(elastic) + applied
        system["residual"] = point.residual
        system["iterations"] = float(point.iterations)
        negative = point.n_negative
        self.hidden += negative is None
        system["negative_eigenvalues"] = np.nan if negative is None else float(negative)
        elements: dict[tuple[str, str], Any] = {}
        if self.stored.elements and len(bars := geometry.bars):
            length = np.linalg.norm(x[bars.indices[:, 1]] - x[bars.indices[:, 0]], axis=1)
            elements["bars", "length"] = length
            elements["bars", "force"] = problem.bar_forces(x)
            if self.with_strain:
                elements["bars", "strain"] = length / bars.rest_length - 1.0
        if self.stored.elements and len(geometry.hinges):
            elements["hinges", "angle"] = problem.bends(x) + np.pi
            elements["hinges", "torque"] = problem.hinge_moments(x)
        if self.stored.elements and len(geometry.bends):
            elements["bends", "angle"] = bend_angles(x[np.newaxis], geometry.bends.indices)[0]
            elements["bends", "torque"] = problem.bend_torques(x)
        channels = {}
        if not self.along and len(self.reaction_axes):
            channels["reaction"] = -point.reactions.ravel()[self.reaction_axes]
        self.writer.append(
            float(self.count),
            positions=x[:, : self.dims],
            elements=elements,
            system=system,
            inputs=self._inputs_at(point),
            channels=channels,
        )
        self.count += 1

    def _inputs_at(self, point: PathPoint) -> dict[str, Any]:
        if self.along:
            return {"load": [point.factor]}
        now = np.array([self.count * self.experiment.save_interval])
        return {
            name: sample_signal(settings["signal"], now)[0]
            for name, settings in self._followed().items()
        }

    def _followed(self) -> dict[str, dict[str, Any]]:
        """Return the inputs that change, or are forces; constant positions are supports."""
        times = self.experiment.frame_times
        followed = {}
        for name, settings in self.inputs.items():
            values = sample_signal(settings["signal"], times)
            declaration = dict(settings["declaration"])
            if declaration["quantity"] == "position" and not np.ptp(values, axis=0).any():
                continue
            if "hold" in declaration:
                # Time is counted in increments here.
                declaration["hold"] /= self.experiment.save_interval
            followed[name] = {"signal": settings["signal"], "declaration": declaration}
        return followed

    def _label(self, node: int) -> str:
        labels = self.experiment.geometry.labels
        return str(node) if labels is None else labels[node]


def _imposed(experiment: Experiment, drives: Drives) -> NDArray[np.int64]:
    """Return the degrees of freedom whose positions change in the run, ascending."""
    way = np.array([station.positions for station in drives.stations])
    moving = np.ptp(way, axis=0) > 0.0
    return np.flatnonzero(moving & experiment.driven_axes("position"))
