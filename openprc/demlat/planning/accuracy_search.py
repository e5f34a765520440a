"""Finding the setting of each scheme that has a wanted error on the pilot, and what it costs."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from openprc.demlat.planning.accuracy_growth import Stability, grown
from openprc.demlat.planning.accuracy_pilot import Pilot, Trial, error_curve, rms_displacement

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from openprc.demlat.planning.accuracy_schemes import Eligible

    Reals = NDArray[np.float64]

#: The estimate that is aimed at, as a share of the accuracy: where the pilot is the whole run,
#: and where it has to be extrapolated.
AIM, EXTRAPOLATED_AIM = 0.5, 0.25
#: A setting is good enough from this share of the aim on.
CLOSE = 0.2
#: Schemes that cost more than this many times the best one so far are not followed further.
DEARER = 2.0
#: The truth is good enough for errors this many times its own.
CLEAR = 10.0
#: By what the truth is refined: a tolerance, and a number of steps.
TIGHTER, FINER = 1e-3, 4
#: Tolerances: none is looser than the accuracy or this, since what large steps do depends on
#: where they happen to fall; and the finest that the truth is run with.
LOOSEST, TIGHTEST = 1e-2, 1e-14
#: Trials of one scheme.
MOST_TRIALS = 9

Verdict = Literal["reached", "dearer", "stalled", "left", "diverged"]


@dataclass(frozen=True, kw_only=True)
class Candidate:
    """What became of a scheme.

    Attributes
    ----------
    name : str
    verdict : {"reached", "dearer", "stalled", "left", "diverged"}
        "left" where another trial would have cost more than a pilot may.
    n_steps : int
        In a frame; 0 of an adaptive scheme.
    tolerance : float
        0 of a fixed step.
    error : float [1]
        Estimated for the whole run; infinity where nothing was stable.
    cost : float
        Of the whole run, in evaluations of all forces by rk4; where the scheme was not followed
        to the aim, what it would at least be.
    """

    name: str
    verdict: Verdict
    n_steps: int
    tolerance: float
    error: float
    cost: float


class Truth:
    """The most exact trial so far, and how exact it is.

    Parameters
    ----------
    pilot : Pilot
    scheme : Eligible
        The scheme of the highest order that can run the experiment.
    resolution : float
        ``1 / tolerance``, or the number of steps in a frame.
    """

    def __init__(self, pilot: Pilot, scheme: Eligible, resolution: float) -> None:
        self.pilot, self.scheme = pilot, scheme
        # Of this scheme: resolution, pilot error. A tolerance is about the error that it gives.
        self.error_at = (1.0, 1.0)
        self._exhausted = False
        self.trial = self._run(resolution)
        while self.trial.failed and self.can_refine:
            self.trial = self._run(self.trial.resolution * self._factor)
        if not scheme.adaptive and not self.trial.failed:
            coarse = pilot.fixed(scheme, self.trial.n_steps // FINER, exact=True)
            if not coarse.failed:
                difference = error_curve(coarse.positions, self.trial.positions)
                self.learn(coarse, float(difference.max()))

    @property
    def _factor(self) -> float:
        return 1.0 / TIGHTER if self.scheme.adaptive else float(FINER)

    @property
    def can_refine(self) -> bool:
        """Whether a more exact one is within reach."""
        dearer = TIGHTER ** (-1.0 / self.scheme.scheme.order) if self.scheme.adaptive else FINER
        if self._exhausted or not self.pilot.affords(self.trial.cost * dearer):
            return False
        if self.scheme.adaptive:
            return self.trial.tolerance > 1.5 * TIGHTEST
        return self.trial.n_steps < 64 * self._first

    def _run(self, resolution: float) -> Trial:
        if self.scheme.adaptive:
            tolerance = max(1.0 / resolution, TIGHTEST)
            return self.pilot.adaptive(self.scheme, tolerance, exact=True)
        self._first = getattr(self, "_first", round(resolution))
        return self.pilot.fixed(self.scheme, round(resolution), exact=True)

    def refine(self) -> None:
        """Take a more exact one."""
        better = self._run(self.trial.resolution * self._factor)
        if better.failed:
            self._exhausted = True
        else:
            self.trial = better

    @property
    def rounding(self) -> float:
        """Error that the rounding of positions alone makes."""
        frames = self.trial.positions
        scale = rms_displacement(frames)
        if scale == 0.0:
            return 0.0
        return 20.0 * float(np.finfo(np.float64).eps) * float(np.abs(frames).max()) / scale

    def uncertainty(self) -> float:
        """Estimate the pilot error of the truth itself, by the order of its scheme."""
        resolution, error = self.error_at
        power = 1.0 if self.scheme.adaptive else float(min(self.scheme.scheme.order, 2))
        return float(max(error * (resolution / self.trial.resolution) ** power, self.rounding))

    def learn(self, trial: Trial, error: float) -> None:
        """Take in how large the error of its own scheme is at some resolution."""
        self.error_at = (trial.resolution, error)


class Search:
    """Looks for the cheapest setting of one scheme after the other.

    Parameters
    ----------
    pilot : Pilot
    truth : Truth
    accuracy : float
    share : float
        Duration of the run over that of the pilot.
    stability : Stability
    unit : int
        Of the number of steps in a frame.
    """

    def __init__(
        self,
        pilot: Pilot,
        truth: Truth,
        *,
        accuracy: float,
        share: float,
        stability: Stability,
        unit: int,
    ) -> None:
        self.pilot, self.truth = pilot, truth
        self.share, self.stability, self.unit = share, stability, unit
        self.aim = accuracy * (AIM if share <= 1.0 + 1e-9 else EXTRAPOLATED_AIM)
        self.loosest = min(accuracy, LOOSEST)
        self.best = math.inf

    def follow(self, scheme: Eligible) -> Candidate:
        """Return the cheapest setting of a scheme whose error is small enough."""
        tried: list[tuple[float, float, Trial]] = []
        resolution = self._first(scheme)
        verdict: Verdict = "stalled"
        least = self._least_cost(scheme, resolution)
        if least > DEARER * self.best:
            return Candidate(
                name=scheme.scheme.name, verdict="dearer", n_steps=0, tolerance=0.0,
                error=math.inf, cost=least,
            )  # fmt: skip
        for _ in range(MOST_TRIALS):
            if tried and self._cost_at(scheme, tried, resolution) > DEARER * self.best:
                verdict = "dearer"
                break
            if tried and not self.pilot.affords(
                self._cost_at(scheme, tried, resolution) / self.share
            ):
                verdict = "left"
                break
            trial = self._trial(scheme, resolution)
            tried.append((trial.resolution, self.error_of(scheme, trial), trial))
            following = self._next(scheme, tried)
            if following is None:
                break
            resolution = following
        good = [(trial.cost, error, trial) for _, error, trial in tried if error <= self.aim]
        if good:
            verdict = "reached"
            _, error, trial = min(good, key=lambda item: item[0])
            cost = trial.cost * self.share
            self.best = min(self.best, cost)
        else:
            _, error, trial = min(tried, key=lambda item: item[1])
            cost = trial.cost * self.share
            if verdict == "dearer":
                cost = max(cost, self._cost_at(scheme, tried, resolution))
            elif not math.isfinite(error):
                verdict = "diverged"
        return Candidate(
            name=scheme.scheme.name,
            verdict=verdict,
            n_steps=trial.n_steps,
            tolerance=trial.tolerance,
            error=error,
            cost=cost,
        )

    def error_of(self, scheme: Eligible, trial: Trial) -> float:
        """Return the estimated error of the whole run with the setting of a trial."""
        if trial.failed:
            return math.inf
        while True:
            curve = error_curve(trial.positions, self.truth.trial.positions)
            here = float(curve.max())
            if scheme.scheme.name == self.truth.scheme.scheme.name and here > 0.0:
                self.truth.learn(trial, here)
            doubt = self.truth.uncertainty() if here > 0.0 else 0.0
            error = self._grown(scheme, curve)
            # Whether it is a thousandth of what is aimed at, or less, does not matter.
            enough = error + self._grown(scheme, np.full_like(curve, doubt)) < 0.1 * self.aim
            if here >= CLEAR * doubt or enough or not self.truth.can_refine:
                return max(error, doubt)
            self.truth.refine()

    def _grown(self, scheme: Eligible, curve: Reals) -> float:
        rest = self.pilot.window.duration * (self.share - 1.0)
        rate_time = self.stability.rate * rest
        return grown(curve, self.share, damped=scheme.damped, rate_time=rate_time)

    # --- steps of the search --------------------------------------------------------------------

    def _first(self, scheme: Eligible) -> float:
        if scheme.adaptive:
            return 1.0 / min(max(self.aim, self._finest(scheme)), self.loosest)
        frame = self.pilot.experiment.save_interval
        return float(self._whole(frame / scheme.coarsest * (1.0 - 1e-12)))

    def _least_cost(self, scheme: Eligible, resolution: float) -> float:
        """Return what the whole run costs at least, where that is known without a trial."""
        experiment, truth = self.pilot.experiment, self.truth
        if not scheme.adaptive:
            n_steps = round(resolution)
            frames = experiment.n_frames - 1
            return scheme.cost(frames * n_steps, experiment.save_interval / n_steps)
        if scheme.scheme.name != truth.scheme.scheme.name:
            return 0.0
        looser = (1.0 / self.loosest / truth.trial.resolution) ** (1.0 / scheme.scheme.order)
        return float(truth.trial.cost * self.share * looser)

    def _finest(self, scheme: Eligible) -> float:
        """Return the smallest tolerance that can be judged."""
        eps = float(np.finfo(self.pilot.experiment.precision).eps)
        return max(10.0 * eps, 30.0 * TIGHTEST)

    def _whole(self, steps: float) -> int:
        return self.unit * max(1, math.ceil(steps / self.unit))

    def _trial(self, scheme: Eligible, resolution: float) -> Trial:
        if scheme.adaptive:
            return self.pilot.adaptive(scheme, 1.0 / resolution)
        return self.pilot.fixed(scheme, round(resolution))

    def _cost_at(
        self, scheme: Eligible, tried: list[tuple[float, float, Trial]], resolution: float
    ) -> float:
        """Predict what the whole run costs at a resolution."""
        at, _, trial = tried[-1]
        power = 1.0 / scheme.scheme.order if scheme.adaptive else 1.0
        return float(trial.cost * self.share * (resolution / at) ** power)

    def _next(self, scheme: Eligible, tried: list[tuple[float, float, Trial]]) -> float | None:
        """Return the next resolution to try; None where the search is over."""
        resolution, error, trial = tried[-1]
        if trial.failed:
            return self._bounded(scheme, 2.0 * resolution, tried)
        order = self._order(scheme, tried)
        if order is None:
            return None
        wanted = resolution * (error / (0.8 * self.aim)) ** (1.0 / order) if error > 0.0 else 0.0
        if error <= self.aim:
            if error >= CLOSE * self.aim or resolution <= self._first(scheme):
                loosest = scheme.adaptive and 1.0 / resolution < self.loosest
                if error >= CLOSE * self.aim or not loosest:
                    return None
            # Coarser, but not where it is known to be too coarse.
            bad = max((r for r, e, _ in tried if e > self.aim), default=0.0)
            wanted = max(wanted, math.sqrt(bad * resolution))
            if wanted > 0.8 * resolution:
                return None
            return self._bounded(scheme, wanted, tried)
        most = 30.0 if scheme.adaptive else 8.0 if error < 0.1 else 3.0
        good = min((r for r, e, _ in tried if e <= self.aim), default=math.inf)
        wanted = min(
            max(wanted, 1.05 * resolution), most * resolution, math.sqrt(good * resolution)
        )
        if wanted > 0.9 * good:
            return None
        return self._bounded(scheme, wanted, tried)

    def _bounded(
        self, scheme: Eligible, wanted: float, tried: list[tuple[float, float, Trial]]
    ) -> float | None:
        if scheme.adaptive:
            wanted = min(max(wanted, 1.0 / self.loosest), 1.0 / self._finest(scheme))
        else:
            wanted = max(float(self._whole(wanted)), self._first(scheme))
        return None if any(abs(r / wanted - 1.0) < 1e-6 for r, _, _ in tried) else wanted

    def _order(self, scheme: Eligible, tried: list[tuple[float, float, Trial]]) -> float | None:
        """Return the order that two trials show; None where refining no longer helps."""
        nominal = 1.0 if scheme.adaptive else float(scheme.scheme.order)
        sound = sorted((r, e) for r, e, _ in tried if math.isfinite(e) and e > 0.0)
        if len(sound) < 2:
            return nominal
        (r0, e0), (r1, e1) = sound[-2:]
        shown = math.log(e0 / e1) / math.log(r1 / r0)
        if shown < 0.2 and r1 / r0 > 1.4 and e1 > self.aim and e0 < 0.1:
            return None
        return min(max(shown, 0.4 * nominal), 1.5 * nominal)
