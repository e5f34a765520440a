"""The runner: quasi-static equilibrium paths of bars and hinges."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import islice
from typing import TYPE_CHECKING, Any

import numpy as np

from openprc.hooks.protocols import Modelled
from openprc.hooks.running import refuse_unsupported, silent
from openprc_merlin.path_findings import path_findings, without_effect

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from openprc.hooks.protocols import Progress
    from openprc.schema import Experiment, Finding, TrajectoryWriter
    from openprc_merlin.equilibrium_path import Balance, PathPoint
    from openprc_merlin.path_control import Course, Drives

    Floats = NDArray[np.float64]


class PathRunner:
    """Runs experiments quasi-statically; offers `openprc.hooks.protocols.Runner`.

    Bars and hinges have the laws of the experiment; "ogden", "enhanced-linear" and
    "four-thirds" are those of MERLIN. Masses, velocities and damping play no part.
    """

    def supports(self, experiment: Experiment) -> Sequence[Finding]:
        """Return what statics cannot model in `experiment`; empty means all of it."""
        return list(path_findings(experiment))

    def models(self, experiment: Experiment) -> Modelled:
        """Return what statics leaves out; it adds nothing."""
        return Modelled(
            leaves_out=(
                "inertia: masses only weigh",
                "time: frames are equilibria, one an increment",
                *dict.fromkeys(without_effect(experiment).values()),
            )
        )

    def run(
        self,
        experiment: Experiment,
        writer: TrajectoryWriter,
        *,
        seed: int | None = None,
        progress: Progress = silent,
        options: Mapping[str, Any] | None = None,
    ) -> None:
        """Follow the equilibria of `experiment` and append every increment, rest first.

        `seed` changes nothing: no random numbers are drawn.

        Parameters
        ----------
        options : mapping, optional
            As in the record of the plugin; those left out have their defaults.

        Raises
        ------
        UnsupportedScene
            When `supports` has something to say.
        ConfigError
            When an option does not fit the experiment.
        NotConverged
            When the path ends before the increments are done; those before are appended.
        """
        # Listing what a scene lacks should not load the solver.
        from openprc.demlat.statics import StaticProblem  # noqa: PLC0415
        from openprc.demlat.statics.equilibrium import refuse_floating  # noqa: PLC0415
        from openprc_merlin.displacement_control import jump  # noqa: PLC0415
        from openprc_merlin.equilibrium_path import Balance, starting_state  # noqa: PLC0415
        from openprc_merlin.path_control import choose_course, read_drives  # noqa: PLC0415
        from openprc_merlin.path_recorder import PathRecorder  # noqa: PLC0415

        del seed
        refuse_unsupported(self.supports(experiment), producer="merlin")
        drives = read_drives(experiment)
        course = choose_course(experiment, drives, {**_defaults(), **(options or {})})
        along = course.control == "arc-length"
        first = drives.stations[0]
        problem = StaticProblem(
            geometry=experiment.geometry,
            gravity=np.array(experiment.gravity),
            held=drives.held,
            positions=first.positions,
        )
        balance = Balance(
            problem, drives.reference if along else first.loads, settings=course.settings
        )
        heaviest = drives.reference if along else drives.largest_loads
        refuse_floating(replace(problem, loads=heaviest))
        factor = 0.0 if along else 1.0
        start, n_negative = starting_state(balance, factor=factor)
        recorder = PathRecorder(experiment, writer, problem=problem, drives=drives, along=along)
        recorder.declare()
        for remark in _remarks(experiment, course, start):
            writer.note(remark)
        before = balance.point(start, factor, iterations=0, n_negative=n_negative)
        recorder.record(before)
        progress(0.0, "at rest")
        lowest = highest = factor
        for number, point in enumerate(_path(balance, start, drives, course), 1):
            recorder.record(point)
            lowest, highest = min(lowest, point.factor), max(highest, point.factor)
            if not along and (released := jump(balance, before, point)):
                writer.note(
                    f"increment {number} is a jump: {released:.3g} J are released on the way to"
                    " an equilibrium that no path leads to"
                )
            before = point
            progress(number / course.increments, f"increment {number} of {course.increments}")
            if ending := _ending(point, course, start):
                writer.note(f"the path ends at increment {number}: {ending}")
                break
        if along:
            writer.note(_range_of_loads(lowest, highest, course))
        if recorder.hidden:
            writer.note(
                f"rounding hides the number of negative eigenvalues in {recorder.hidden} frames:"
                " it is NaN there"
            )


def _path(balance: Balance, start: Floats, drives: Drives, course: Course) -> Iterator[PathPoint]:
    from openprc_merlin.arc_length import arc_length_path  # noqa: PLC0415
    from openprc_merlin.displacement_control import controlled_path  # noqa: PLC0415

    if course.control != "arc-length":
        return controlled_path(
            balance,
            start,
            drives.stations[1:],
            begin=drives.stations[0],
            unstable="settle" if course.unstable == "settle" else "follow",
        )
    path = arc_length_path(
        balance, start, first_factor=course.first_factor, arc_length=course.arc_length
    )
    return islice(path, course.increments)


def _defaults() -> dict[str, Any]:
    from openprc_merlin import RUN_OPTIONS  # noqa: PLC0415 - the records load this module

    return {option.name: option.default for option in RUN_OPTIONS}


def _ending(point: PathPoint, course: Course, start: Floats) -> str:
    """Say why the path ends here, if it does."""
    if abs(point.factor) >= course.max_load:
        return f"the load factor is {point.factor:.6g}; max-load is {course.max_load:g}"
    moved = float(np.linalg.norm(point.positions - start, axis=1).max())
    if moved >= course.max_displacement:
        return f"a node has moved {moved:.6g} m; max-displacement is {course.max_displacement:g}"
    if course.unstable == "stop" and point.n_negative:
        return f"the state is unstable ({point.n_negative} negative eigenvalues of the stiffness)"
    return ""


def _range_of_loads(lowest: float, highest: float, course: Course) -> str:
    """Say how far the path went: its length is a number of increments, not a load."""
    said = f"load factors from {lowest:.4g} to {highest:.4g}"
    if max(-lowest, highest) > 1.0 and not np.isfinite(course.max_load):
        return f"{said}, beyond the forces of the experiment; max-load=1 ends the path there"
    return said


def _remarks(experiment: Experiment, course: Course, start: Floats) -> Iterator[str]:
    """Yield what a reader of the result should know."""
    yield from experiment.notes
    geometry = experiment.geometry
    means = {
        "arc-length": "the load factor is sought along the path; the input load is that factor,"
        " 1 for the forces of the signals at the end of the run",
        "displacement": "driven positions, and forces, are those of the signals at every frame",
        "load": "forces are those of the signals at every frame",
    }
    yield f"quasi-static equilibria, time counts increments: {means[course.control]}"
    shift = np.abs(np.where(experiment.held_axes, 0.0, start - geometry.positions)).max(initial=0.0)
    if shift > 0.0:
        yield (
            f"the body is not in balance as given: frame 0 is the equilibrium nearby, up to"
            f" {shift:.3g} m away"
        )
    if ignored := dict.fromkeys(without_effect(experiment).values()):
        yield f"without effect in a quasi-static run: {', '.join(ignored)}"
