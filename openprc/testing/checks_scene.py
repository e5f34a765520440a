"""RUN, on small scenes: what supports() and models() say of them is so, and can be read."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from openprc.errors import OpenPRCError
from openprc.hooks.protocols import Describer, Modelled
from openprc.hooks.running import silent
from openprc.schema.experiment import Actuator, ActuatorType, Collision, Experiment, Signal
from openprc.schema.geometry import Geometry
from openprc.schema.provenance import Provenance
from openprc.schema.trajectory import Trajectory
from openprc.schema.writer import TrajectoryWriter
from openprc.testing import bodies
from openprc.testing.cases import RunnerCase
from openprc.testing.check import check
from openprc.testing.outcome import NotApplicable, fail
from openprc.testing.simulations import (
    findings_of,
    options_of,
    prepared,
    refusal,
    run,
    runner_of,
)

_RIGHT = np.array([[0, 0, 0], [1, 0, 0], [0.5, 0.8, 0], [0.5, -0.8, 0.0]], dtype=np.float64)
_MOVING = np.array([[0, 0, 0], [0, 0, 0], [0, 0, 0.1], [0, 0, 0.2]])
_PAIRS = np.array([(0, 1), (0, 2), (1, 2), (0, 3), (1, 3)])


def _body(*, bars: dict[str, Any] | None = None, **columns: Any) -> Geometry:
    """Return two triangles on a common edge, stretched a little so that they move."""
    lengths = np.linalg.norm(_RIGHT[_PAIRS[:, 0]] - _RIGHT[_PAIRS[:, 1]], axis=1)
    springs = {"indices": _PAIRS, "stiffness": np.full(5, 40.0), "rest_length": 0.97 * lengths}
    given = {
        "positions": _RIGHT,
        "masses": np.full(4, 0.1),
        "fixed": [True, True, False, False],
        "bars": bodies.bars(**(springs | (bars or {}))),
    }
    return bodies.body(**(given | columns))


def _driven(kind: ActuatorType, *, factor: float = 1.0) -> dict[str, Any]:
    """Return a ramp that drives a node out of the plane, `factor` times as far as it might."""
    value = factor * {"position": 0.01, "force": 0.5, "velocity": 0.1}[kind]
    drive = Signal(name="u", values=np.linspace(0.0, value, 11), dt=0.01, interpolation="linear")
    actuator = Actuator(node=2, signal="u", type=kind, axes=(False, False, True))
    return {"signals": {"u": drive}, "actuators": (actuator,)}


def _accepted(case: RunnerCase) -> Experiment:
    """Return the body left to itself, or driven where the runner wants to be told what moves."""
    left = Experiment(geometry=_body(), duration=0.1, dt=5e-4 * case.dt_factor, save_interval=0.02)
    for changes in ({}, _driven("force"), _driven("position")):
        scene = replace(left, **changes)
        if not refusal(case, scene):
            return scene
    return left


def probes(case: RunnerCase) -> dict[str, tuple[Experiment, Experiment]]:
    """Return, for every thing that a scene can contain, the scene with it and without it."""
    plain = _accepted(case)
    near = _RIGHT.copy()
    near[3] = near[2] + [0.0, 0.0, 0.05]
    touching = _body(positions=near, collidable=np.array([False, False, True, True]))

    def of(**changes: Any) -> tuple[Experiment, Experiment]:
        return replace(plain, **changes), plain

    ones = np.ones(5)
    return {
        "gravity": of(gravity=(0.0, 0.0, -9.81)),
        "damping of nodes": of(damping=0.5),
        "damping of bars": of(geometry=_body(bars={"damping": 0.5 * ones})),
        "prestress": of(geometry=_body(bars={"prestress": -0.02 * ones})),
        "an initial velocity": of(geometry=_body(velocities=_MOVING)),
        "cubic bars": of(geometry=_body(bars={
            "law": np.full(5, "cubic"), "stiffness_cubic": 5e4 * ones})),
        "cables": of(geometry=_body(bars={"law": np.full(5, "cable"),
                                          "prestress": 0.05 * ones})),
        "rigid bars": of(geometry=_body(bars={"rigid": ones.astype(bool)})),
        "hinges": of(geometry=_body(hinges=bodies.hinges(
            indices=[[0, 1, 2, 3]], stiffness=[0.5], rest_angle=[2.5]))),
        "bends": of(geometry=_body(bends=bodies.bends(
            indices=[[2, 0, 3]], stiffness=[0.5], rest_angle=[1.0]))),
        "forces": of(**_driven("force", factor=2.0)),
        "prescribed positions": of(**_driven("position", factor=2.0)),
        "prescribed velocities": of(**_driven("velocity", factor=2.0)),
        "contact": (
            replace(plain, geometry=touching, collision=Collision(enabled=True, radius=0.04)),
            replace(plain, geometry=touching),
        ),
    }  # fmt: skip


def _told(trajectory: Trajectory) -> list[NDArray[np.float64]]:
    """Return what a run says: positions in the plane and out of it, and of load steps the load."""
    x = trajectory.positions()
    out_of_plane = x[..., 2] if x.shape[2] == 3 else np.zeros(x.shape[:2])
    loads = np.zeros(0)
    if trajectory.time_kind == "pseudo" and trajectory.inputs:
        # A path of equilibria is the same for all sizes of a load; the load factors are not.
        loads = np.concatenate([trajectory.input(name).value.ravel() for name in trajectory.inputs])
    return [x[..., :2], out_of_plane, loads]


@check("RUN-7", "what supports() lets pass is run and takes effect", "runner")
def what_is_accepted_takes_effect(case: RunnerCase, folder: Path) -> None:
    """Run small scenes with and without each thing; equal motions mean that it is ignored."""
    looked_at, ignored = 0, []
    for number, (what, (present, absent)) in enumerate(probes(case).items()):
        found = findings_of(case, present)
        if any(item.level == "error" for item in found) or refusal(case, absent):
            continue
        motions = []
        for name, experiment in (("with", present), ("without", absent)):
            try:
                out = run(case, experiment, folder / f"{number}-{name}.h5")
            except OpenPRCError as error:
                fail(
                    f"a scene with {what} passes supports(), and run() says: {error.found}",
                    expected="a run, or an error of supports()",
                    fix="return a Finding of level 'error' for it",
                )
            with Trajectory(out) as trajectory:
                motions.append(_told(trajectory))
        looked_at += 1
        same = all(np.array_equal(*pair) for pair in zip(*motions, strict=True))
        # Who says that it is left out, in a warning, may leave it out.
        if same and not found:
            ignored.append(what)
    if ignored:
        fail(
            f"accepted, and without any effect: {', '.join(ignored)}",
            expected="a motion that depends on it, or a finding of supports()",
            fix="model it, refuse it in supports(), or say there in a warning that it is left out",
        )
    if not looked_at:
        raise NotApplicable("the runner models none of the kit's small scenes")


@check("RUN-8", "what supports() refuses is not run", "runner")
def what_is_refused_is_not_run(case: RunnerCase, folder: Path) -> None:
    """Call run() all the same, on every small scene that supports() refuses."""
    refused = {
        what: present for what, (present, _) in probes(case).items() if refusal(case, present)
    }
    if not refused:
        raise NotApplicable("the runner refuses none of the kit's small scenes")
    for number, (what, experiment) in enumerate(refused.items()):
        for item in findings_of(case, experiment):
            if item.level == "error" and not (item.found and item.expected and item.fix):
                fail(
                    f"the refusal of {what} says {item.found!r}, expected {item.expected!r}, "
                    f"to do {item.fix!r}",
                    expected="all three",
                    fix="say what was found, what was expected, what to do",
                )
        options = options_of(case)
        given = {"options": options} if options else {}
        writer = TrajectoryWriter(folder / f"{number}.h5", provenance=Provenance(case.name))
        try:
            with writer:
                runner_of(case).run(
                    prepared(case, experiment), writer, seed=None, progress=silent, **given
                )
        except OpenPRCError:
            continue
        fail(
            f"a scene with {what} is refused by supports(), and run() ran it",
            expected="UnsupportedScene",
            fix="call refuse_unsupported(self.supports(experiment), producer=...) first",
        )


@check("RUN-9", "models() says in clauses what is left out and added", "runner")
def what_is_left_out_is_told(case: RunnerCase, folder: Path) -> None:
    """Ask of every small scene, those that are refused included."""
    del folder
    runner = runner_of(case)
    if not isinstance(runner, Describer):
        raise NotApplicable("the runner has no models()")
    for what, (present, _) in probes(case).items():
        told = runner.models(prepared(case, present))
        if not isinstance(told, Modelled):
            fail(
                f"of a scene with {what}, models() returns {type(told).__name__}",
                expected="openprc.hooks.protocols.Modelled",
                fix="return Modelled(leaves_out=(...), adds=(...))",
            )
        for field, clauses in (("leaves_out", told.leaves_out), ("adds", told.adds)):
            # A text alone would be taken for as many clauses as it has letters.
            if not isinstance(clauses, tuple) or not all(_is_clause(text) for text in clauses):
                fail(
                    f"of a scene with {what}, models() says {field}={clauses!r}",
                    expected="a tuple of clauses, none empty and none with a full stop at its end",
                    fix=f'write {field}=("what it is: why",)',
                )


def _is_clause(text: Any) -> bool:
    return isinstance(text, str) and bool(text.strip()) and not text.rstrip().endswith(".")


__all__ = ["probes"]
