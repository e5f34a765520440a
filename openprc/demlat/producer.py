"""The engine as a producer: the one way from an experiment to a trajectory."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from openprc.demlat.backends.choose import choose_backend
from openprc.demlat.models.barhinge.model import Backend, BarHingeModel
from openprc.demlat.planning.model_differences import modelled
from openprc.demlat.signal_table import sample_signal
from openprc.demlat.stored_digits import SpreadSum, digits_remark
from openprc.hooks.running import refuse_unsupported, silent
from openprc.schema.experiment import ACTUATOR_UNITS
from openprc.schema.geometry import Bars, Bends, Hinges

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from openprc.demlat.models.barhinge.tables import FrameBuffer
    from openprc.demlat.planning.plan import Plan
    from openprc.hooks.protocols import Modelled, Progress
    from openprc.schema import Experiment, Finding, TrajectoryWriter

#: Columns of `FrameBuffer.energy` and `FrameBuffer.ledger`.
ENERGIES = ("kinetic_energy", "elastic_energy_bars", "elastic_energy_hinges", "gravity_energy")
LOSSES = ("dissipated_drag", "dissipated_bars", "dissipated_hinges", "dissipated_contact")
#: The last column of either, in scenes with bends.
OF_BENDS = ("elastic_energy_bends", "dissipated_bends")
TOTALS = ("potential_energy", "total_energy", "work_in", "dissipated")


class DemlatProducer:
    """Runs experiments with the native engine; offers `openprc.hooks.protocols.Runner`.

    Parameters
    ----------
    model : type, default BarHingeModel
    backend : {"auto", "cpu", "cuda", "jax"}
    """

    def __init__(
        self, *, model: type[BarHingeModel] = BarHingeModel, backend: Backend = "auto"
    ) -> None:
        self.model = model
        self.backend = backend

    def supports(self, experiment: Experiment) -> Sequence[Finding]:
        """Return what the engine cannot model in `experiment`; empty means all of it.

        Where integrator or step are left to an accuracy, those that can be found do not count.
        """
        if experiment.accuracy is not None:
            from openprc.demlat.planning.accuracy_schemes import representative  # noqa: PLC0415

            return representative(experiment)[1]
        return self.model.supports(experiment)

    def settled(self, experiment: Experiment, *, verify: bool = False) -> Experiment:
        """Return `experiment` with integrator and step for its accuracy.

        Parameters
        ----------
        experiment : Experiment
            Without an accuracy, and unless `verify`, it is returned as it is.
        verify : bool
            Estimate the error of the run by repeating a stretch of it more finely.

        Raises
        ------
        ConfigError
            When the accuracy is out of reach.
        UnsupportedScene
            When the engine cannot model the scene.
        """
        if experiment.accuracy is None and not verify:
            return experiment
        # A pilot is compiled code; most experiments state their step.
        from openprc.demlat.planning.accuracy import settled  # noqa: PLC0415
        from openprc.demlat.planning.accuracy_check import verified  # noqa: PLC0415

        experiment = settled(experiment, only=self._only(experiment))
        return verified(experiment) if verify else experiment

    def _only(self, experiment: Experiment) -> tuple[str, ...]:
        """Return what a back end that was asked for limits the choice to."""
        if self.backend not in ("cuda", "jax"):
            return ()
        trial = replace(experiment, integrator="rk4", accuracy=None, dt_stated=True)
        return ("rk4",) if choose_backend(trial, self.backend).name != "cpu" else ()

    def models(self, experiment: Experiment) -> Modelled:
        """Return what the scheme does to the motion that the scene does not ask for."""
        return modelled(experiment)

    def plan(self, experiment: Experiment) -> Plan:
        """Return what a run of `experiment` would do and cost; nothing is run."""
        # Checks that only a plan makes load scipy.
        from openprc.demlat.planning.plan import make_plan  # noqa: PLC0415

        return make_plan(experiment, only=self._only(experiment) if experiment.accuracy else ())

    def run(
        self,
        experiment: Experiment,
        writer: TrajectoryWriter,
        *,
        seed: int | None = None,
        progress: Progress = silent,
    ) -> None:
        """Simulate `experiment` and append every frame, t = 0 first.

        `seed` changes nothing: the engine draws no random numbers.

        Raises
        ------
        UnsupportedScene
            When `supports` has something to say.
        Diverged
            When the integration blows up; the frames before that are appended.
        """
        del seed
        experiment = self.settled(experiment)
        refuse_unsupported(self.supports(experiment), producer="demlat")
        model = self.model(experiment, backend=self.backend)
        for remark in model.remarks():
            writer.note(remark)
        recorder = FrameRecorder(experiment, writer)
        recorder.declare()
        n_frames = experiment.n_frames
        progress(0.0, "t = 0 s")
        for first, block in model.blocks():
            recorder.append(first, block)
            done = first + len(block.x)
            time = (done - 1) * experiment.save_interval
            progress(done / n_frames, f"t = {time:g} s of {experiment.duration:g} s")
        for remark in model.closing_remarks():
            writer.note(remark)
        if effort := model.effort:
            writer.note(
                f"{experiment.integrator} took {effort['steps']} steps and rejected"
                f" {effort['rejected']}, with {effort['evaluations']} evaluations of the forces"
            )
        for remark in recorder.remarks():
            writer.note(remark)


class FrameRecorder:
    """Says what is recorded and turns blocks of frames into what the writer takes."""

    def __init__(self, experiment: Experiment, writer: TrajectoryWriter) -> None:
        self.experiment = experiment
        self.writer = writer
        self.dims = 2 if experiment.planar else 3
        self.stored = experiment.stored
        self.dtype: Literal["f8", "f4"] = "f4" if self.stored.precision == "float32" else "f8"
        self.inputs = _inputs(experiment)
        self.motion: dict[str, SpreadSum] = {}
        # The strain of a bar without a rest length is not defined.
        self.with_strain = bool((experiment.geometry.bars.rest_length > 0).all())

    def declare(self) -> None:
        """Declare nodes, elements, energies and inputs."""
        self.declare_body(velocities=self.stored.velocities)
        bends = self.experiment.geometry.bends
        for name in (*ENERGIES, *LOSSES, *TOTALS, *(OF_BENDS if len(bends) else ())):
            self.writer.declare_system(name, unit="J")
        for name, settings in self.inputs.items():
            self.writer.declare_input(name, **settings["declaration"])

    def declare_body(self, *, velocities: bool) -> None:
        """Declare nodes and elements."""
        geometry, writer = self.experiment.geometry, self.writer
        writer.declare_nodes(
            geometry.n_nodes,
            self.dims,
            unit="m",
            dtype=self.dtype,
            velocities=velocities,
            rest=geometry.positions[:, : self.dims],
            mass=geometry.masses,
            fixed=geometry.fixed,
            labels=None if geometry.labels is None else list(geometry.labels),
        )
        bars, hinges = geometry.bars, geometry.hinges
        if len(bars):
            series = {"length": "m", "strain": "1", "force": "N"}
            if not self.with_strain:
                del series["strain"]
                writer.note("no strain is stored: a bar has the rest length 0")
            writer.declare_elements(
                "bars",
                bars.indices,
                series=series if self.stored.elements else {},
                dtype=self.dtype,
                static=_constants(
                    bars,
                    rest_length="m",
                    stiffness="N/m",
                    damping="N*s/m" if self.experiment.bar_damping == "axial" else "1",
                    prestress="1",
                    stiffness_cubic="N/m3",
                    damping_cubic="N*s3/m3",
                ),
            )
        if len(hinges):
            writer.declare_elements(
                "hinges",
                hinges.indices,
                series={"angle": "rad", "torque": "N*m"} if self.stored.elements else {},
                dtype=self.dtype,
                static=_constants(
                    hinges,
                    rest_angle="rad",
                    stiffness="N*m/rad",
                    damping="N*m*s/rad",
                    limit_low="rad",
                    limit_high="rad",
                ),
            )
        if len(geometry.bends):
            writer.declare_elements(
                "bends",
                geometry.bends.indices,
                series={"angle": "rad", "torque": "N*m"} if self.stored.elements else {},
                dtype=self.dtype,
                static=_constants(
                    geometry.bends, rest_angle="rad", stiffness="N*m/rad", damping="N*m*s/rad"
                ),
            )
        if len(geometry.faces):
            writer.declare_elements("faces", geometry.faces)

    def append(self, first: int, block: FrameBuffer) -> None:
        """Append a block of frames of which the first has the number `first`."""
        times = (first + np.arange(len(block.x))) * self.experiment.save_interval
        geometry = self.experiment.geometry
        if self.dtype == "f4":
            self._watch("positions", block.x[..., : self.dims].reshape(len(block.x), -1))
            if self.stored.elements and len(geometry.bars):
                self._watch("lengths of the bars", block.length)
        elements: dict[tuple[str, str], NDArray[np.float64]] = {}
        if self.stored.elements and len(bars := geometry.bars):
            elements["bars", "length"] = block.length
            elements["bars", "force"] = block.tension
            if self.with_strain:
                elements["bars", "strain"] = block.length / bars.rest_length - 1.0
        if self.stored.elements and len(geometry.hinges):
            elements["hinges", "angle"] = block.angle
            elements["hinges", "torque"] = block.moment
        if self.stored.elements and len(geometry.bends):
            elements["bends", "angle"] = block.bend_angle
            elements["bends", "torque"] = block.bend_moment
        system = {name: block.energy[:, kind] for kind, name in enumerate(ENERGIES)}
        system |= {name: block.ledger[:, kind] for kind, name in enumerate(LOSSES, 1)}
        if len(geometry.bends):
            for name, columns in zip(OF_BENDS, (block.energy, block.ledger), strict=True):
                system[name] = columns[:, -1]
        system["work_in"] = block.ledger[:, 0]
        system["dissipated"] = block.ledger[:, 1:].sum(axis=1)
        system["potential_energy"] = block.energy[:, 1:].sum(axis=1)
        system["total_energy"] = system["kinetic_energy"] + system["potential_energy"]
        self.writer.append(
            times,
            positions=block.x[..., : self.dims],
            velocities=block.v[..., : self.dims] if self.stored.velocities else None,
            elements=elements,
            system=system,
            inputs={
                name: sample_signal(settings["signal"], times)
                for name, settings in self.inputs.items()
            },
        )

    def _watch(self, what: str, values: NDArray[np.float64]) -> None:
        self.motion.setdefault(what, SpreadSum(values[0])).add(values)

    def remarks(self) -> Iterator[str]:
        """Yield what storing in float32 lost of the motion, once all frames are appended."""
        strains = self.with_strain and self.stored.elements
        for what, spread in self.motion.items():
            finer = ", or read BarExtensions, which come from the strains"
            remedy = finer if strains and what != "positions" else ""
            remark = digits_remark(what, spread, remedy=remedy)
            if remark is not None:
                yield remark


def _constants(elements: Bars | Hinges | Bends, **units: str) -> dict[str, tuple[Any, str | None]]:
    """Return the constants of elements; special ones only where they say something."""
    if isinstance(elements, Bends):  # they have one law, and are never rigid
        return {name: (getattr(elements, name), unit) for name, unit in units.items()}
    special = {
        "stiffness_cubic": (elements.law == "cubic").any(),
        "damping_cubic": (elements.law == "cubic").any(),
        "limit_low": isinstance(elements, Hinges) and elements.limited.any(),
        "limit_high": isinstance(elements, Hinges) and elements.limited.any(),
    }
    constants: dict[str, tuple[Any, str | None]] = {
        name: (getattr(elements, name), unit)
        for name, unit in units.items()
        if special.get(name, True)
    }
    if elements.rigid.any():
        constants["rigid"] = (elements.rigid.astype("u1"), None)
    if (elements.law != "linear").any():
        constants["law"] = ([str(law) for law in elements.law], None)
    return constants


def _inputs(experiment: Experiment) -> Mapping[str, dict[str, Any]]:
    """Return one input for each signal and each quantity that it drives."""
    uses: dict[tuple[str, str], list[str]] = {}
    for actuator in experiment.actuators:
        axes = "".join(name for name, on in zip("xyz", actuator.axes, strict=True) if on)
        targets = uses.setdefault((actuator.signal, actuator.type), [])
        targets.append(f"node {actuator.node} {axes}")
    names = [name for name, _ in uses]
    inputs = {}
    for (name, quantity), targets in uses.items():
        signal = experiment.signals[name]
        width = signal.values.shape[1]
        declaration: dict[str, Any] = {
            "columns": ["value"] if width == 1 else list("xyz"),
            "quantity": quantity,
            "unit": ACTUATOR_UNITS[quantity],
            "targets": targets,
        }
        if signal.sequence is not None:
            declaration |= {"sequence": signal.sequence, "hold": signal.hold, "start": 0.0}
        # One signal may move one node and push another.
        key = name if names.count(name) == 1 else f"{name} {quantity}"
        inputs[key] = {"signal": signal, "declaration": declaration}
    return inputs
