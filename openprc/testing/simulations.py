"""Runs of a runner: of the kit's scenes, and of the case's own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from openprc.errors import OpenPRCError
from openprc.hooks.options import check_options
from openprc.hooks.protocols import Progress, Runner
from openprc.hooks.running import silent, simulate
from openprc.schema.experiment import Actuator, Experiment, Signal
from openprc.schema.findings import Finding
from openprc.schema.provenance import Provenance
from openprc.testing import bodies
from openprc.testing.cases import RunnerCase
from openprc.testing.outcome import NotApplicable
from openprc.testing.workbench import bench_of

SEED = 12


def runner_of(case: RunnerCase) -> Runner:
    """Return a fresh runner."""
    runner: Runner = case.plugins.load(case.item, capability="run")
    return runner


def options_of(case: RunnerCase) -> dict[str, Any]:
    """Return every option of the runner, with those of the case."""
    return check_options(case.record, case.record.run_options, case.options)


def prepared(case: RunnerCase, experiment: Experiment) -> Experiment:
    """Return the experiment with the integrator of the case."""
    if case.integrator is None:
        return experiment
    return replace(experiment, integrator=case.integrator)


def findings_of(case: RunnerCase, experiment: Experiment) -> Sequence[Finding]:
    """Return what the runner says of an experiment."""
    return list(runner_of(case).supports(prepared(case, experiment)))


def refusal(case: RunnerCase, experiment: Experiment) -> str:
    """Return why the runner refuses an experiment; empty when it does not."""
    errors = [item for item in findings_of(case, experiment) if item.level == "error"]
    return errors[0].found if errors else ""


def run(
    case: RunnerCase, experiment: Experiment, out: Path, *, progress: Progress = silent
) -> Path:
    """Simulate an experiment into `out` as the host does.

    Raises
    ------
    OpenPRCError
        Whatever the host or the runner raises.
    """
    simulate(
        prepared(case, experiment),
        runner_of(case),
        target=out,
        provenance=Provenance(
            case.item.name, plugin=case.item.distribution, plugin_version=case.item.version,
            seed=SEED,
        ),
        owner=case.item.qualified_name,
        options=options_of(case),
        seed=SEED,
        progress=progress,
        registry=case.plugins,
    )  # fmt: skip
    return out


# --- driven scenes -----------------------------------------------------------------------------


def driven_oscillator(*, kind: str = "force", factor: float = 1.0) -> Experiment:
    """Return a damped mass on a bar; a held force, or the held place of its foot, drives it."""
    symbols = np.random.default_rng(3).uniform(-1.0, 1.0, 20)
    forced = kind == "force"
    values = symbols if forced else 0.02 * symbols
    if not forced:
        values[0] = 0.0  # where the foot is
    return Experiment(
        geometry=bodies.body(
            positions=[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]],
            masses=[0.5, 0.5],
            fixed=[forced, False],
            bars=bodies.bars(indices=[[0, 1]], stiffness=[50.0], rest_length=[1.0], damping=[0.5]),
        ),
        signals={
            "drive": Signal(name="drive", values=values, dt=0.05,
                            interpolation="hold" if forced else "linear")
        },
        actuators=(
            Actuator(node=1 if forced else 0, signal="drive",
                     type="force" if forced else "position", axes=(True, False, False)),
        ),
        duration=1.0, dt=5e-4 * factor, save_interval=0.01,
    )  # fmt: skip


LATTICE_SIDE, HOLD, N_SYMBOLS = 3, 0.1, 240


def driven_lattice(*, factor: float = 1.0) -> Experiment:
    """Return a small lattice with a fixed column; a held random force pulls at a corner.

    Its slowest modes last for several symbols, which is the memory that a readout is to find.
    """
    number = np.arange(LATTICE_SIDE**2).reshape(LATTICE_SIDE, LATTICE_SIDE)
    runs = (
        (number[:-1], number[1:]), (number[:, :-1], number[:, 1:]),
        (number[:-1, :-1], number[1:, 1:]), (number[1:, :-1], number[:-1, 1:]),
    )  # fmt: skip
    pairs = np.array([(i, j) for a, b in runs for i, j in zip(a.flat, b.flat, strict=True)])
    places = np.array([(0.1 * c, 0.1 * r, 0.0) for c in range(LATTICE_SIDE)
                       for r in range(LATTICE_SIDE)])  # fmt: skip
    lengths = np.linalg.norm(places[pairs[:, 0]] - places[pairs[:, 1]], axis=1)
    rng = np.random.default_rng(5)
    return Experiment(
        geometry=bodies.body(
            positions=places,
            masses=np.full(len(places), 0.01),
            fixed=places[:, 0] == 0.0,
            bars=bodies.bars(
                indices=pairs,
                stiffness=6.0 * rng.uniform(0.7, 1.3, len(pairs)),
                rest_length=lengths,
                damping=np.full(len(pairs), 0.02),
            ),
        ),
        signals={
            "force": Signal(name="force", values=rng.uniform(-0.1, 0.1, N_SYMBOLS), dt=HOLD,
                            interpolation="hold")
        },
        actuators=(
            Actuator(node=len(places) - 1, signal="force", type="force",
                     axes=(False, True, False)),
        ),
        duration=N_SYMBOLS * HOLD, dt=2e-3 * factor, save_interval=HOLD / 5, damping=0.03,
    )  # fmt: skip


def driven_scene(case: RunnerCase) -> Experiment:
    """Return the case's own scene, or the first of the kit's driven oscillators that it models.

    Raises
    ------
    NotApplicable
        When the runner can model neither.
    """
    if case.scene is not None:
        given: Experiment = case.scene()
        return given
    reasons = []
    for kind in ("force", "position"):
        scene = driven_oscillator(kind=kind, factor=case.dt_factor)
        reason = refusal(case, scene)
        if not reason:
            return scene
        reasons.append(reason)
    raise NotApplicable(
        f"not modelled: {reasons[0]}; give the case a driven scene that is (scene=)"
    )


def simulated(case: RunnerCase) -> tuple[Experiment, Path]:
    """Return the driven scene and its run, made once.

    Raises
    ------
    NotApplicable
        When it cannot be run; RUN-1 says why.
    """
    bench = bench_of(case)
    experiment = driven_scene(case)
    if "driven" not in bench.made:
        try:
            bench.made["driven"] = run(case, experiment, bench.folder / "driven.h5")
        except OpenPRCError as error:
            bench.made["driven"] = error
    if isinstance(bench.made["driven"], OpenPRCError):
        raise NotApplicable("the driven scene cannot be run: see RUN-1")
    return experiment, bench.made["driven"]


def commanded(signal: Signal, times: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return what a held or linear signal says at times: (T, d); its last value stays."""
    position = times / signal.dt
    # A time that is meant to lie on a sample belongs to it, whatever its last digits say.
    whole = np.rint(position)
    position = np.where(np.abs(position - whole) < 1e-6, whole, position)
    last = len(signal.values) - 1
    first = np.clip(np.floor(position).astype(int), 0, last)
    values: NDArray[np.float64] = signal.values[first]
    if signal.interpolation == "linear":
        after = signal.values[np.minimum(first + 1, last)]
        share = np.clip(position - first, 0.0, 1.0)[:, np.newaxis]
        values = values + share * (after - values)
    return values


__all__ = [
    "commanded", "driven_lattice", "driven_oscillator", "driven_scene", "findings_of", "options_of",
    "prepared", "refusal", "run", "runner_of", "simulated",
]  # fmt: skip
