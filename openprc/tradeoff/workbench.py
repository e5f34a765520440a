"""`Workbench`: measures settings of one scene, each once, however often it is interrupted."""

from __future__ import annotations

import statistics
import tempfile
import time
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from openprc.demlat.planning.run_cost import run_cost
from openprc.demlat.planning.stability import step_limit
from openprc.errors import Diverged, NotConverged, OpenPRCError
from openprc.hooks.running import silent
from openprc.tradeoff.file_runs import read_outcome, run_to_file
from openprc.tradeoff.outcome import Outcome, relative_error, run_in_memory
from openprc.tradeoff.point import Point, Status
from openprc.tradeoff.settings import configured
from openprc.tradeoff.store import PointStore, StoredPoint

if TYPE_CHECKING:
    from openprc.hooks.protocols import Progress
    from openprc.schema.experiment import Experiment
    from openprc.tradeoff.reference import ConvergedReference

#: Frames that are wrong by so many times the motion are a blow-up that ended too early to be seen.
BLOWN_UP = 1e2
#: Seconds below which a run is repeated within a round, since clocks and caches jitter.
SHORT = 0.02
REPEATS = 3
#: Seconds above which a run is timed once: it is disturbed by little, and costs most.
LONG = 1.0


class BudgetSpent(Exception):
    """The time for measuring is over; what was measured is kept."""


class Workbench:
    """Runs settings, compares them with the reference, and keeps what comes out.

    Parameters
    ----------
    experiment : Experiment
        Up to the horizon of the reference.
    reference : ConvergedReference
    store : PointStore
    rounds : int
        CPU times are medians of so many.
    budget : float, optional [s]
        Of wall-clock time, for all measurements.
    longest : float [s]
        CPU time that one run may take, as far as it can be told before.
    """

    def __init__(
        self,
        experiment: Experiment,
        reference: ConvergedReference,
        *,
        store: PointStore,
        rounds: int = 3,
        budget: float | None = None,
        longest: float = 5.0,
    ) -> None:
        self.experiment = experiment
        self.reference = reference
        self.store = store
        self.rounds = rounds
        self.longest = longest
        self.limit = budget
        self._began = time.monotonic()
        self._warm: set[tuple[Any, ...]] = set()
        #: How many runs were made for points: none for those that were in the store.
        self.n_measured = 0

    # --- single settings ------------------------------------------------------------------------

    def measure(self, group: str, label: str, setting: Mapping[str, Any]) -> Point:
        """Return the point of a setting, measured now unless it is in the store.

        Raises
        ------
        BudgetSpent
        """
        known = self.store.get(group, setting)
        if known is not None:
            return known.point
        self.check_budget()
        self.n_measured += 1
        point = Point(group=group, label=label, setting=dict(setting))
        try:
            self._warm_up(setting)
            outcome, size = self._run(setting)
        except OpenPRCError as problem:
            status: Status = "refused"
            if isinstance(problem, Diverged | NotConverged):
                status = "diverged"
            elif problem.exit_code == 1:
                status = "failed"
            return self._keep(replace(point, status=status, note=problem.found))
        wrong = relative_error(outcome.positions, self.reference.positions)
        if not wrong < BLOWN_UP:
            text = f"the positions are wrong by {wrong:.1e} of the motion"
            return self._keep(replace(point, status="diverged", note=text))
        note = "at the floor of the reference" if wrong < self.reference.floor else ""
        if setting.get("step_check") == "warn" and "steps_per_frame" in setting:
            note = "above the stability limit, which the engine refuses unless told otherwise"
        return self._keep(
            replace(
                point,
                note=note,
                trajectory_error=wrong,
                cpu_seconds=outcome.seconds,
                evaluations=outcome.evaluations,
                file_size=size,
            ),
            outcome.seconds,
        )

    def refuse(self, group: str, label: str, setting: Mapping[str, Any], *, why: str) -> Point:
        """Keep a setting that was not run, and why."""
        known = self.store.get(group, setting)
        if known is not None:
            return known.point
        point = Point(group=group, label=label, setting=dict(setting), status="refused", note=why)
        return self._keep(point)

    def put_scores(
        self, point: Point, scores: Mapping[str, float], errors: Mapping[str, float]
    ) -> Point:
        """Add figures of tasks to a point."""
        known = self.store.get(point.group, point.setting)
        made = replace(point, scores=dict(scores), score_errors=dict(errors))
        self.store.put(made, seconds=() if known is None else known.seconds)
        return made

    def expected_seconds(self, setting: Mapping[str, Any]) -> float:
        """Return a rough estimate of the CPU time of a run of the engine [s]."""
        experiment = configured(self.experiment, setting)
        return run_cost(experiment, step_limit(experiment)).seconds

    def check_budget(self) -> None:
        """Raise `BudgetSpent` when the time for measuring is over."""
        if self.limit is not None and time.monotonic() - self._began > self.limit:
            raise BudgetSpent

    # --- further rounds -------------------------------------------------------------------------

    def time_again(self, *, progress: Progress = silent) -> None:
        """Time everything that ended well in turn, until every point has all its rounds.

        Going through all settings before one is repeated lets a busy spell of the machine hit
        all of them alike.

        Raises
        ------
        BudgetSpent
        """
        for number in range(2, self.rounds + 1):
            todo = [s for s in self._timed() if len(s.seconds) < number and s.seconds[0] < LONG]
            for done, stored in enumerate(todo):
                self.check_budget()
                point = stored.point
                progress(done / len(todo), f"round {number} of {self.rounds}: {point.label}")
                self._warm_up(point.setting)
                outcome, _ = self._run(point.setting)
                self._keep(point, *stored.seconds, outcome.seconds)

    def _timed(self) -> list[StoredPoint]:
        found = (self.store.get(point.group, point.setting) for point in self.store.points)
        return [stored for stored in found if stored is not None and stored.seconds]

    # --- inside ---------------------------------------------------------------------------------

    def _keep(self, point: Point, *seconds: float) -> Point:
        if seconds:
            point = replace(point, cpu_seconds=statistics.median(seconds))
        self.store.put(point, seconds=seconds)
        return point

    def _warm_up(self, setting: Mapping[str, Any]) -> None:
        """Compile what a setting needs, on the first frame of the scene."""
        steps = setting.get("steps_per_frame") if "backend" in setting else None
        traits = (
            "integrator", "precision", "backend", "model", "producer", "storage",
            "constraint_tolerance",
        )  # fmt: skip
        key = (*(setting.get(trait) for trait in traits), steps)
        if key in self._warm:
            return
        self._warm.add(key)
        first = replace(self.experiment, duration=self.experiment.save_interval)
        if steps is not None:
            first = self.experiment  # compiled for one number of steps, and of frames
        try:
            self._execute(first, setting, 1)
        except OpenPRCError:
            return  # the run itself will say what is wrong

    def _run(self, setting: Mapping[str, Any]) -> tuple[Outcome, int | None]:
        outcome, size = self._execute(self.experiment, setting, self.reference.stride)
        # The best of several, because a short run is disturbed by anything.
        for _ in range(REPEATS - 1):
            if not outcome.seconds < SHORT or size is not None:
                break
            again, _ = self._execute(self.experiment, setting, self.reference.stride)
            if again.seconds < outcome.seconds:
                outcome = again
        return outcome, size

    def _execute(
        self, experiment: Experiment, setting: Mapping[str, Any], stride: int
    ) -> tuple[Outcome, int | None]:
        made = configured(experiment, setting)
        if "storage" not in setting and "producer" not in setting:
            backend = setting.get("backend", "cpu")
            return run_in_memory(made, backend=backend, stride=stride), None
        producer = setting.get("producer", "demlat")
        with tempfile.TemporaryDirectory(prefix="openprc-tradeoff-") as folder:
            path = Path(folder) / "simulation.h5"
            seconds = run_to_file(made, path, producer=producer)
            outcome = read_outcome(path, made, stride=stride, seconds=seconds, producer=producer)
            return outcome, path.stat().st_size if "storage" in setting else None
