"""RUN: what running an experiment promises."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from openprc.hooks.validating import validate_run
from openprc.schema.atomic import partial_path
from openprc.schema.trajectory import Trajectory
from openprc.testing.cases import RunnerCase
from openprc.testing.check import check
from openprc.testing.outcome import NotApplicable, fail
from openprc.testing.simulations import (
    commanded,
    driven_oscillator,
    driven_scene,
    refusal,
    run,
    simulated,
)
from openprc.testing.watching import changes, elsewhere, snapshot, watching


@check("RUN-1", "a driven scene is run, the file is valid, and running it again says the same",
       "runner")  # fmt: skip
def same_seed_same_content(case: RunnerCase, folder: Path) -> None:
    """Run the driven scene twice with one seed."""
    scene = driven_scene(case)
    digests = []
    for name in ("one.h5", "two.h5"):
        out = run(case, scene, folder / name)
        report = validate_run(out, registry=case.plugins)
        worst = [finding for finding in report.findings if finding.level == "error"]
        if worst:
            fail(
                f"{worst[0].code} at {worst[0].path}: {worst[0].found}",
                expected=worst[0].expected,
                fix=worst[0].fix,
            )
        with Trajectory(out) as trajectory:
            digests.append(trajectory.content_digest())
    if digests[0] != digests[1]:
        fail(
            "two runs with one seed have different contents",
            expected="the same content",
            fix="draw from numpy.random.default_rng(seed); start from a fresh state",
        )


@check("RUN-2", "Ctrl-C leaves the frames before it, readable, with status interrupted", "runner")
def ctrl_c_leaves_a_prefix(case: RunnerCase, folder: Path) -> None:
    """Raise KeyboardInterrupt from progress(), and compare with the whole run."""
    scene, whole = simulated(case)
    seen: list[float] = []

    def interrupt(fraction: float, message: str) -> None:
        del message
        seen.append(float(fraction))
        if fraction > 0.0:
            raise KeyboardInterrupt

    out = folder / "out.h5"
    try:
        run(case, scene, out, progress=interrupt)
    except KeyboardInterrupt:
        pass
    else:
        told = "was never called" if not seen else f"was called with {seen[:3]} only"
        fail(
            f"progress() {told}, or its KeyboardInterrupt was caught",
            expected="calls with fractions up to 1, from which Ctrl-C gets out",
            fix="call progress(fraction, message) while running; do not catch it",
        )
    if not all(0.0 <= fraction <= 1.0 for fraction in seen):
        fail(
            f"progress() was called with {seen}",
            expected="fractions from 0 to 1",
            fix="divide by the number of frames",
        )
    partial = partial_path(out)
    if out.exists() or not partial.exists():
        left = sorted(path.name for path in folder.iterdir())
        fail(
            f"Ctrl-C left {left or 'nothing'}",
            expected=f"{partial.name}",
            fix="append frames as they come, before reporting progress",
        )
    with Trajectory(partial, allow_incomplete=True) as part, Trajectory(whole) as full:
        status, count = part.status, part.n_frames
        same = np.array_equal(part.positions(), full.positions()[:count], equal_nan=True)
    if status != "interrupted" or count < 1 or not same:
        fail(
            f"{count} frames with status {status!r}{'' if same else ', unlike those of the run'}",
            expected="the first frames of the run, with status 'interrupted'",
            fix="append frames as they come; leave the status to the host",
        )


@check("RUN-3", "the frames are at i * save_interval from t = 0, as many as the experiment says",
       "runner")  # fmt: skip
def frames_are_where_they_should_be(case: RunnerCase, folder: Path) -> None:
    """Look at the clock and the first frame; also with 0.3 s saved every 0.1 s."""
    scene, out = simulated(case)
    runs = [(scene, out)]
    awkward = replace(
        driven_oscillator(factor=case.dt_factor), duration=0.3, save_interval=0.1
    )  # floor(0.3 / 0.1) is 2 in floating point
    if case.scene is None and not refusal(case, awkward):
        runs.append((awkward, run(case, awkward, folder / "awkward.h5")))
    for experiment, path in runs:
        with Trajectory(path) as trajectory:
            times, kind = trajectory.time, trajectory.time_kind
            start = trajectory.positions(unit="m", frames=slice(0, 1))[0]
        if len(times) != experiment.n_frames:
            fail(
                f"{len(times)} rows for {experiment.duration:g} s saved every "
                f"{experiment.save_interval:g} s",
                expected=f"{experiment.n_frames}",
                fix="take experiment.n_frames; do not truncate a ratio",
            )
        wanted = experiment.frame_times
        if kind == "physical" and not np.allclose(times, wanted, rtol=1e-9, atol=1e-12):
            first = int(np.argmax(~np.isclose(times, wanted, rtol=1e-9, atol=1e-12)))
            fail(
                f"row {first} is at t = {times[first]:.9g}",
                expected=f"{wanted[first]:.9g}",
                fix="append experiment.frame_times, t = 0 first",
            )
        body = experiment.geometry.positions[:, : start.shape[1]]
        # Nodes that are driven to another place may be there from the beginning.
        free = ~experiment.held_axes[:, : start.shape[1]]
        off = np.abs(start - body)[free].max() if free.any() else 0.0
        if kind == "physical" and off > 1e-6 * max(1.0, float(np.abs(body).max())):
            fail(
                f"the first row is {off:.3g} m away from the initial state",
                expected="the state at t = 0, before any step",
                fix="append once before the first step",
            )


@check("RUN-4", "the recorded input is the commanded one, with its symbols", "runner")
def input_is_the_commanded_one(case: RunnerCase, folder: Path) -> None:
    """Compare the input of the file with the signal of the experiment, frame by frame."""
    del folder
    scene, out = simulated(case)
    driving = {actuator.signal for actuator in scene.actuators}
    if not driving:
        raise NotApplicable("the scene of the case is not driven")
    with Trajectory(out) as trajectory:
        if trajectory.time_kind == "pseudo" and trajectory.inputs:
            raise NotApplicable("the rows are load steps, and signals are functions of time")
        for name in sorted(driving):
            signal = scene.signals[name]
            named = [n for n in trajectory.inputs if n == name or n.startswith(f"{name} ")]
            if not named:
                fail(
                    f"the inputs are {list(trajectory.inputs)}",
                    expected=f"{name!r}",
                    fix="declare and append an input for every signal that drives",
                )
            stored = trajectory.input(named[0])
            if signal.interpolation == "cubic":
                continue
            wanted = commanded(signal, trajectory.time)
            if stored.value.shape != wanted.shape or not np.allclose(
                stored.value, wanted, rtol=1e-9, atol=1e-12
            ):
                fail(
                    f"the input {name!r} is {_first_difference(stored.value, wanted)}",
                    expected="the value of the signal at the time of the row",
                    fix="sample the signal at t, not at the step before or after",
                )
            if signal.sequence is not None and (
                stored.sequence is None or not np.array_equal(stored.sequence, signal.sequence)
            ):
                fail(
                    f"the input {name!r} has {'other' if stored.sequence is not None else 'no'} "
                    "symbols",
                    expected="signal.sequence, with signal.hold and start 0",
                    fix="pass sequence=, hold= and start=0.0 to declare_input()",
                )


def _first_difference(found: np.ndarray, wanted: np.ndarray) -> str:
    if found.shape != wanted.shape:
        return f"of shape {found.shape} instead of {wanted.shape}"
    frame = int(np.argmax(~np.isclose(found, wanted, rtol=1e-9, atol=1e-12).all(axis=1)))
    return f"{found[frame].tolist()} in row {frame} instead of {wanted[frame].tolist()}"


@check("RUN-5", "masses, fixed nodes and bars of the file are those of the experiment", "runner")
def topology_is_the_experiments(case: RunnerCase, folder: Path) -> None:
    """Compare the topology, and stored lengths with the distances between positions."""
    del folder
    scene, out = simulated(case)
    body = scene.geometry
    with Trajectory(out) as trajectory:
        if trajectory.n_nodes != body.n_nodes:
            fail(
                f"{trajectory.n_nodes} nodes",
                expected=f"{body.n_nodes}",
                fix="record every node of the experiment, in its order",
            )
        for name, wanted in (("mass", body.masses), ("fixed", body.fixed)):
            path = f"/topology/nodes/{name}"
            found = trajectory.node(name) if trajectory.has(path) else None
            if found is None or not np.allclose(found, wanted):
                fail(
                    f"{path} is {'not there' if found is None else found[:5].tolist()}",
                    expected=f"{wanted[:5].tolist()}",
                    fix=f"pass {name}= to writer.declare_nodes()",
                )
        if len(body.bars) and (
            "bars" not in trajectory.element_kinds
            or not np.array_equal(trajectory.indices("bars"), body.bars.indices)
        ):
            fail(
                "the bars of the file are not those of the experiment",
                expected=f"{len(body.bars)} bars in their order",
                fix="writer.declare_elements('bars', experiment.geometry.bars.indices)",
            )
        if "length" not in trajectory.element_series("bars"):
            return
        x = trajectory.positions()
        i, j = body.bars.indices.T
        off = np.abs(trajectory.element("bars", "length")
                     - np.linalg.norm(x[:, i] - x[:, j], axis=2))  # fmt: skip
    if off.max() > 1e-6 * max(1.0, float(np.abs(body.bars.rest_length).max())):
        frame, bar = np.unravel_index(int(off.argmax()), off.shape)
        fail(
            f"the length of bar {bar} in row {frame} is {off.max():.3g} m off the distance of "
            "its nodes",
            expected="lengths of the same instant as the positions",
            fix="compute lengths from the positions that are appended",
        )


@check("RUN-6", "nothing is written but the result, and nothing is printed", "runner")
def running_leaves_no_trace(case: RunnerCase, folder: Path) -> None:
    """Run with empty folders as current, home and temporary ones, and look into them."""
    scene, _ = simulated(case)
    target = folder / "out"
    with elsewhere(folder / "else") as other:
        before = snapshot(other)
        with watching() as watched:
            run(case, scene, target / "out.h5")
        left = changes(before, snapshot(other))
    astray = watched.written_outside(target, folder / "else" / "temporary")
    left += [f"{path} was written" for path in astray]
    left += [f"{path.name} is new" for path in target.iterdir() if path.name != "out.h5"]
    if left:
        fail(
            f"running leaves something behind: {left[0]}",
            expected="the result and nothing else",
            fix="write through the writer; use and remove a temporary folder",
        )
    if watched.printed.strip() or watched.warned:
        text = watched.printed.strip() or watched.warned[0]
        fail(
            f"running says {text[:200]!r}",
            expected="silence",
            fix="say it with writer.note() or progress()",
        )
