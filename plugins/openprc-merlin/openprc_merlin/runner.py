"""The runner: quasi-static equilibrium paths of bars and hinges."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import islice
from typing import TYPE_CHECKING, Any

import numpy as np

from openprc.hooks.running import refuse_unsupported
from openprc_merlin.path_findings import path_findings

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

    def run(
        self,
        experiment: Experiment,
        writer: TrajectoryWriter,
        *,
        seed: int | None = None,
        progress: Progress | None = None,
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
        from openprc_merlin.equilibrium_path import Balance  # noqa: PLC0415
        from openprc_merlin.path_control import choose_course, read_drives  # noqa: PLC0415
        from openprc_merlin.path_recorder import PathRecorder  # noqa: PLC0415

        del seed
        refuse_unsupported(self.supports(experiment), producer="merlin")
        drives = read_drives(experiment)
        course = choose_course(experiment, drives, _filled(options))
        along = course.control == "arc-length"
        first = drives.stations[0]
        problem = StaticProblem(
            geometry=experiment.geometry,
            gravity=np.array(experiment.gravity),
            held=drives.held,
            positions=first.positions,
        )
        balance = Balance(
            problem, drives.reference if along else None, settings=course.settings
        )
        start, shift = starting_state(balance, None if along else first.loads)
        recorder = PathRecorder(experiment, writer, problem=problem, drives=drives, along=along)
        recorder.declare()
        for remark in _remarks(experiment, course, shift):
            writer.note(remark)
        rest = balance.point(
            start, 0.0, iterations=0, n_negative=balance.factors(start).n_negative
        )
        recorder.append(rest, reference=None if along else first.loads)
        if progress is not None:
            progress(0.0, "at rest")
        for number, point in enumerate(_path(balance, start, drives, course), 1):
            recorder.append(point)
            if progress is not None:
                progress(number / course.increments, f"increment {number}")
            if number < course.increments and (ending := _ending(point, course, start)):
                writer.note(f"the path ends at increment {number}: {ending}")
                return


def _path(
    balance: Balance, start: Floats, drives: Drives, course: Course
) -> Iterator[PathPoint]:
    from openprc_merlin.arc_length import arc_length_path  # noqa: PLC0415
    from openprc_merlin.displacement_control import controlled_path  # noqa: PLC0415

    if course.control != "arc-length":
        return controlled_path(
            balance,
            start,
            drives.stations[1:],
            begin=drives.stations[0],
            unstable=course.unstable,
        )
    path = arc_length_path(
        balance, start, first_factor=course.first_factor, arc_length=course.arc_length
    )
    return islice(path, course.increments)
