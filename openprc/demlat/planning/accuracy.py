"""Integrator and step for an accuracy, chosen on a pilot.

The accuracy of a run is the largest, over its frames, of the rms error of the positions over the
rms displacement of the true motion from its start. It is aimed at over the whole run. A pilot, the
first part of the run, is tried in memory with each integrator that comes into question, at
settings that approach the one with the wanted error; errors are taken against the most exact
trial, and extrapolated to the end of the run as `openprc.demlat.planning.accuracy_growth` says.
The cheapest scheme wins by counted evaluations and fixed costs, never by a clock, so that the same
experiment gives the same choice and the same bits.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import TYPE_CHECKING
from weakref import WeakKeyDictionary

import numpy as np

from openprc.demlat.contact.findings import can_touch
from openprc.demlat.integrators import find_integrator
from openprc.demlat.models.barhinge.assembly import LEAST_ELEMENTS
from openprc.demlat.models.barhinge.support import supports
from openprc.demlat.planning import run_cost
from openprc.demlat.planning.accuracy_choice import AccuracyChoice
from openprc.demlat.planning.accuracy_growth import Stability, judge_twin
from openprc.demlat.planning.accuracy_pilot import (
    Pilot,
    error_curve,
    make_window,
    rms_displacement,
)
from openprc.demlat.planning.accuracy_schemes import (
    Eligible,
    eligible_schemes,
    representative,
    steps_unit,
    with_scheme,
)
from openprc.demlat.planning.accuracy_search import Candidate, Search, Truth
from openprc.demlat.planning.stability import step_limit
from openprc.errors import ConfigError
from openprc.hooks.running import refuse_unsupported
from openprc.schema.experiment import AUTO
from openprc.schema.experiment_checks import check_experiment

if TYPE_CHECKING:
    from openprc.schema.experiment import Experiment

#: A pilot may take this share of what the run is expected to cost ...
SHARE = 0.05
#: ... or this long by the cost constants [s], whichever is more.
LEAST_SECONDS = 0.25
#: Runs of the expected cost that a pilot needs for as long as it lasts.
PILOT_RUNS = 12.0
#: A pilot covers so many symbols of every signal from where it begins to change.
SYMBOLS = 3
#: ... and at least so many periods of the fastest mode.
PERIODS = 8.0
#: All trials together cost at most so many times what the window was made for.
OVERRUN = 4.0
#: ... or, where nothing got there, this many times more.
LONGER = 25.0
#: A motion whose best estimate is above this is not short of digits but unstable.
LOST = 1e-3
#: A signal that has this many times the range of the pilot later on is remarked upon.
STRONGER = 2.0


_KNOWN: WeakKeyDictionary[Experiment, AccuracyChoice] = WeakKeyDictionary()


def settled(experiment: Experiment, *, only: tuple[str, ...] = ()) -> Experiment:
    """Return the experiment with integrator and step for its accuracy; notes say which and why.

    Parameters
    ----------
    experiment : Experiment
        Without an accuracy it is returned as it is.
    only : tuple of str, optional
        Names of integrators, where a back end knows no others.

    Raises
    ------
    ConfigError, UnsupportedScene
        See `choose_for_accuracy`.
    """
    if experiment.accuracy is None:
        return experiment
    choice = choose_for_accuracy(experiment, only=only)
    return replace(
        experiment, accuracy=None, integrator=choice.integrator, dt=choice.dt, dt_stated=True,
        tolerance=choice.tolerance, notes=(*experiment.notes, choice.note, *choice.remarks),
    )  # fmt: skip


def choose_for_accuracy(
    experiment: Experiment, *, only: tuple[str, ...] = (), seconds: float = LEAST_SECONDS
) -> AccuracyChoice:
    """Choose integrator and step for the accuracy of an experiment.

    Parameters
    ----------
    experiment : Experiment
        With an `accuracy`. An integrator that is named is kept; `dt` and `tolerance` are not.
    only : tuple of str, optional
        Names of integrators to choose from.
    seconds : float [s]
        What a pilot may cost by the cost constants even where the run itself is cheap.

    Raises
    ------
    ConfigError
        When the experiment is wrong or the accuracy is out of reach.
    UnsupportedScene
        When the engine cannot model it.
    """
    if not only and seconds == LEAST_SECONDS and experiment in _KNOWN:
        return _KNOWN[experiment]
    check_experiment(experiment)
    accuracy = experiment.accuracy
    if accuracy is None:
        raise ConfigError(
            "no accuracy", expected="a share of the displacement", key="simulation.accuracy"
        )
    if experiment.integrator != AUTO and find_integrator(experiment.integrator).step == "legacy":
        raise ConfigError(
            f"an accuracy of {accuracy:g} with the integrator {experiment.integrator!r}",
            expected="the step of the run that is to be reproduced, and no accuracy",
            fix="leave the integrator out, and it is chosen",
            key="simulation.accuracy",
        )
    refuse_unsupported(representative(experiment)[1], producer="demlat", file=_place(experiment))
    choice = _Chooser(experiment, accuracy, only=only, seconds=seconds).choice()
    if not only and seconds == LEAST_SECONDS:
        _KNOWN[experiment] = choice
    return choice


def _place(experiment: Experiment) -> str | None:
    return None if experiment.path is None else str(experiment.path)


class _Chooser:
    """Carries what the parts of a choice share."""

    def __init__(
        self, experiment: Experiment, accuracy: float, *, only: tuple[str, ...], seconds: float
    ) -> None:
        self.experiment, self.accuracy = experiment, accuracy
        self.schemes = sorted(
            eligible_schemes(experiment, only=only),
            key=lambda scheme: _cost_rate(scheme, accuracy, experiment),
        )
        if not self.schemes:
            raise ConfigError(
                f"none of the integrators {', '.join(only)} runs this experiment",
                expected="a scene that one of them can do",
                fix="leave the back end to be chosen",
                key="simulation.accuracy",
            )
        self.reference = self._reference()
        rate = min(_cost_rate(scheme, accuracy, experiment) for scheme in self.schemes)
        budget = max(
            SHARE * rate * experiment.duration, seconds / _seconds_per_evaluation(experiment)
        )
        self.window = make_window(
            experiment, wanted=max(budget / (PILOT_RUNS * rate), _least_window(experiment))
        )
        self.share = max(experiment.duration / self.window.duration, 1.0)
        # What a window needs at least may be longer than the budget is for.
        needed = PILOT_RUNS * rate * self.window.duration
        self.pilot = Pilot(experiment, self.window, most=OVERRUN * max(budget, needed))
        self.unit = math.lcm(steps_unit(experiment), self.window.parts)

    def choice(self) -> AccuracyChoice:
        truth = Truth(self.pilot, self.reference, self._first_truth())
        if truth.trial.failed:
            raise ConfigError(
                f"the pilot breaks down with {self.reference.scheme.name} at every step that was"
                " tried",
                expected="a motion that some step can follow",
                fix="run it without an accuracy: the message then says where it breaks down",
                key="simulation.accuracy",
            )
        stability = self._stability(truth)
        search = Search(
            self.pilot, truth, accuracy=self.accuracy, share=self.share, stability=stability,
            unit=self.unit,
        )  # fmt: skip
        candidates = [search.follow(scheme) for scheme in self.schemes]
        reached = [one for one in candidates if one.verdict == "reached"]
        if not reached and search.aim > truth.rounding:
            # Better a long pilot than a wrong answer.
            self.pilot.most *= LONGER
            for at, scheme in enumerate(self.schemes):
                if candidates[at].verdict == "left":
                    candidates[at] = search.follow(scheme)
            reached = [one for one in candidates if one.verdict == "reached"]
        if reached:
            best = min(reached, key=lambda one: one.cost)
        else:
            best = min(candidates, key=lambda one: one.error)
        remarks = tuple(self._remarks(best, stability))
        if best.error > self.accuracy and not (stability.unstable or can_touch(self.experiment)):
            if best.error < LOST or self.experiment.precision == "float32":
                raise self._out_of_reach(best)
            remarks = (
                *remarks,
                f"the motion amplifies errors beyond what any step can follow: the least that the"
                f" pilot found is {best.error:.1e} instead of {self.accuracy:g}, so that only its"
                " statistics can be trusted",
            )
        return self._record(best, candidates, stability, remarks)

    def _reference(self) -> Eligible:
        for name in ("dop853", "rk4-dae", "rk4-projection", "rk4"):
            trial = replace(self.experiment, integrator=name)
            if not any(f.level == "error" for f in supports(with_scheme(trial, name))):
                return eligible_schemes(replace(trial, precision="float64"))[0]
        return self.schemes[0]

    def _first_truth(self) -> float:
        if self.reference.adaptive:
            wanted = 1e-2 * self.accuracy / min(self.share, 1e3)
            return 1.0 / min(max(wanted, 1e-12), 1e-6)
        coarsest = self.experiment.save_interval / self.reference.coarsest
        return 4.0 * self.unit * math.ceil(coarsest / self.unit)

    def _stability(self, truth: Truth) -> Stability:
        """Compare the truth with a twin of slightly other masses, where there is a rest to run."""
        if self.share <= 1.0 + 1e-9:
            return Stability()
        geometry = self.experiment.geometry
        size = 1e-5 if truth.trial.tolerance < 1e-7 else 1e-3
        shifts = np.random.default_rng(0).uniform(-size, size, geometry.n_nodes)
        other = replace(geometry, masses=geometry.masses * (1.0 + shifts))
        twin = Pilot(replace(self.experiment, geometry=other), self.window, most=self.pilot.most)
        trial = (
            twin.adaptive(self.reference, truth.trial.tolerance, exact=True)
            if self.reference.adaptive
            else twin.fixed(self.reference, truth.trial.n_steps, exact=True)
        )
        self.pilot.cost += twin.cost
        self.pilot.evaluations += twin.evaluations
        if trial.failed:
            return Stability()
        times = np.arange(self.window.n_frames, dtype=np.float64) * self.window.interval
        frames = truth.trial.positions
        # A motion that sets off takes its twin along: only what is more than that counts.
        moved = np.sqrt(np.mean(np.sum((frames - frames[0]) ** 2, axis=2), axis=1))
        share = np.maximum.accumulate(moved) / max(rms_displacement(frames), 1e-300)
        distance = error_curve(trial.positions, frames)
        return judge_twin(distance / np.clip(share, 1e-12, 1.0), times)

    def _remarks(self, best: Candidate, stability: Stability) -> list[str]:
        remarks = []
        rest = self.experiment.duration - self.window.duration
        if stability.unstable:
            remarks.append(
                f"the motion is unstable: neighbouring motions part by a factor of ten in"
                f" {math.log(10.0) / stability.rate:.3g} s, so that no step can promise"
                f" {self.accuracy:g} for the {rest:.3g} s after the pilot"
            )
        if can_touch(self.experiment):
            remarks.append(
                "contact: an impact that comes later, or not at all, changes the motion from there"
                " on, so that the accuracy is estimated and not promised"
            )
        remarks += self._later_signals()
        if best.verdict != "reached" and best.error > self.accuracy and remarks:
            remarks.append(f"the least error that the pilot found is {best.error:.1e}")
        return remarks

    def _later_signals(self) -> Iterator[str]:
        """Yield remarks on signals that do more after the pilot than during it."""
        for name in dict.fromkeys(actuator.signal for actuator in self.experiment.actuators):
            signal = self.experiment.signals[name]
            here, whole = (
                float(np.ptp(signal.values[: math.ceil(time / signal.dt) + 1], axis=0).max())
                for time in (self.window.duration, self.experiment.duration)
            )
            if whole > STRONGER * here:
                often = f"only 1/{whole / here:.2g} of its range" if here > 0.0 else "nothing"
                yield (
                    f"the pilot sees {often} of signal {name!r}: the error may be estimated too low"
                )

    def _out_of_reach(self, best: Candidate) -> ConfigError:
        single = self.experiment.precision == "float32"
        stated = self.experiment.integrator != AUTO
        least = 10.0 ** math.ceil(math.log10(2.0 * best.error)) if best.error > 0 else self.accuracy
        ways = [f"ask for {least:.0e} or more"]
        if single:
            ways.append("set simulation.precision to float64")
        if stated:
            ways.append("leave simulation.integrator out")
        return ConfigError(
            f"an accuracy of {self.accuracy:g} is out of reach: {best.name} comes to an estimated"
            f" {best.error:.1e}" + (" in float32" if single else "") + ", nothing else is better",
            expected=f"at least {least:.0e} here, over {self.experiment.duration:g} s",
            fix=", or ".join(ways),
            file=_place(self.experiment),
            key="simulation.accuracy",
        )

    def _record(
        self,
        best: Candidate,
        candidates: list[Candidate],
        stability: Stability,
        remarks: tuple[str, ...],
    ) -> AccuracyChoice:
        scheme = next(s for s in self.schemes if s.scheme.name == best.name)
        save = self.experiment.save_interval
        n_steps = best.n_steps or math.ceil(save / scheme.coarsest * (1.0 - 1e-12))
        per_unit = scheme.scheme.stages / scheme.cost(1, save / n_steps)
        if scheme.adaptive:
            per_unit = 1.0 / scheme.step_cost
        rest = sorted((one for one in candidates if one is not best), key=lambda one: one.cost)
        return AccuracyChoice(
            accuracy=self.accuracy,
            integrator=best.name,
            dt=save / n_steps,
            tolerance=best.tolerance or None,
            error=best.error,
            promised=best.error <= self.accuracy and not remarks,
            pilot_duration=self.window.duration,
            duration=self.experiment.duration,
            pilot_evaluations=self.pilot.evaluations,
            evaluations=round(best.cost * per_unit),
            pilot_share=self.pilot.cost / best.cost if best.cost else 0.0,
            candidates=(best, *rest),
            remarks=remarks,
            at_limit=bool(best.n_steps)
            and best.n_steps - self.unit < save / scheme.coarsest * (1.0 - 1e-12),
        )


def _cost_rate(scheme: Eligible, accuracy: float, experiment: Experiment) -> float:
    """Guess what a second of motion costs, in evaluations of all forces by rk4."""
    if not scheme.adaptive:
        # A third of the stable step for an error of one per cent, and finer by the order.
        finer = max(1.0, 3.0 * (1e-2 / accuracy) ** (1.0 / scheme.scheme.order))
        h = scheme.coarsest / finer
        return float(scheme.cost(1, h) / h)
    per_radian, power = run_cost.ADAPTIVE[scheme.scheme.name]
    radians = 1.0 / scheme.coarsest
    finer = max(1e-6 / accuracy, 1e-4) ** power
    return float(scheme.step_cost * per_radian * radians * finer)


def _seconds_per_evaluation(experiment: Experiment) -> float:
    geometry = experiment.geometry
    n_bars, n_hinges = len(geometry.bars), len(geometry.hinges) + len(geometry.bends)
    small = n_bars + n_hinges < LEAST_ELEMENTS and experiment.precision == "float64"
    bar = run_cost.PER_SINGLE_BAR if small else run_cost.PER_BAR
    hinge = run_cost.PER_SINGLE_HINGE if small else run_cost.PER_HINGE
    return run_cost.PER_EVALUATION + bar * n_bars + hinge * n_hinges


def _least_window(experiment: Experiment) -> float:
    """Return until when every signal has changed a few times, and the fastest mode more [s]."""
    omega = step_limit(representative(experiment)[0]).omega
    longest = 2.0 * math.pi * PERIODS / omega if omega > 0.0 else 0.0
    for name in dict.fromkeys(actuator.signal for actuator in experiment.actuators):
        signal = experiment.signals[name]
        moved = np.flatnonzero((signal.values != signal.values[0]).any(axis=1))
        if len(moved):
            step = signal.hold or signal.dt
            longest = max(longest, moved[0] * signal.dt + SYMBOLS * step)
    return min(longest, experiment.duration)
