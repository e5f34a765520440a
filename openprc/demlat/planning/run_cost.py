"""What a run will cost: evaluations of the force, time, memory, and bytes on disk."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from openprc.demlat.integrators import Settings, find_integrator
from openprc.demlat.models.barhinge.assembly import LEAST_ELEMENTS

if TYPE_CHECKING:
    from openprc.demlat.planning.stability import StepLimit
    from openprc.schema.experiment import Experiment

#: Seconds for one evaluation of all forces, per evaluation, bar and hinge, on one core of a
#: server of 2024 with 512-bit vectors; other machines are within a factor of two or so.
PER_EVALUATION, PER_BAR, PER_HINGE = 1.5e-7, 2.1e-9, 4.5e-9
#: The same for small bodies, which are stepped element by element.
PER_SINGLE_BAR, PER_SINGLE_HINGE = 1.5e-8, 4.0e-8
#: Bytes in memory: tables and work arrays of a node, bar and hinge, and the frames on their way.
NODE_BYTES, BAR_BYTES, HINGE_BYTES, FRAME_BUFFER = 400, 60, 100, 4 << 20
#: Evaluations per radian of the fastest mode at a tolerance of 1e-6, and by what a tenth of
#: the tolerance multiplies them: one over the order.
ADAPTIVE = {"rk45": (28.0, 1.0 / 5.0), "dop853": (7.8, 1.0 / 8.0)}
#: What pefrl takes where there is damping: its kicks are solved by four stages each.
PEFRL_DAMPED = 4


@dataclass(frozen=True, kw_only=True)
class RunCost:
    """Estimates.

    Attributes
    ----------
    evaluations : int
        Of all forces.
    seconds : float
        Without compiling, which the first run on a machine does; good to +-50 % where the
        machine is like the one that the constants were measured on.
    memory : int [B]
        Beyond what Python and the packages take.
    file_size : int [B]
        Of the frames in simulation.h5, uncompressed.
    """

    evaluations: int
    seconds: float
    memory: int
    file_size: int


def run_cost(experiment: Experiment, limit: StepLimit) -> RunCost:
    """Estimate what running an experiment costs."""
    geometry = experiment.geometry
    n_nodes, n_bars = geometry.n_nodes, len(geometry.bars)
    # A bend costs about as much as a hinge.
    n_hinges = len(geometry.hinges) + len(geometry.bends)
    small = n_bars + n_hinges < LEAST_ELEMENTS and experiment.precision == "float64"
    per_bar = PER_SINGLE_BAR if small else PER_BAR
    per_hinge = PER_SINGLE_HINGE if small else PER_HINGE
    evaluations = _evaluations(experiment, limit)
    dims = 2 if experiment.planar else 3
    n_inputs = 3 * len(experiment.signals)
    n_system = 13 + 2 * bool(len(geometry.bends))
    row = 2 * dims * n_nodes + 3 * n_bars + 2 * n_hinges + n_inputs + n_system
    return RunCost(
        evaluations=evaluations,
        seconds=evaluations * (PER_EVALUATION + per_bar * n_bars + per_hinge * n_hinges),
        memory=NODE_BYTES * n_nodes + BAR_BYTES * n_bars + HINGE_BYTES * n_hinges + FRAME_BUFFER,
        file_size=8 * row * experiment.n_frames,
    )


def _evaluations(experiment: Experiment, limit: StepLimit) -> int:
    scheme = find_integrator(experiment.integrator)
    frames = experiment.n_frames - 1
    steps = frames * experiment.steps_per_frame
    if scheme.step != "adaptive":
        damped = limit.damped and scheme.name == "pefrl"
        return scheme.stages * steps * (PEFRL_DAMPED if damped else 1)
    per_radian, power = ADAPTIVE.get(scheme.name, ADAPTIVE["dop853"])
    tolerance = experiment.tolerance or Settings._field_defaults["tolerance"]
    radians = limit.omega * experiment.duration
    return max(int(per_radian * radians * (1e-6 / tolerance) ** power), scheme.stages)
