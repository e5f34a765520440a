"""The first part of a run, tried with several integrators and steps in memory."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from openprc.demlat.models.barhinge.model import BarHingeModel
from openprc.demlat.planning.accuracy_schemes import Eligible, with_scheme
from openprc.errors import Diverged

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from openprc.schema.experiment import Experiment

    Reals = NDArray[np.float64]

#: Coordinates that are kept of a trial, at most.
MOST_NUMBERS = 400_000
#: Frames that are compared, if there are as many.
MOST_FRAMES, LEAST_FRAMES = 600, 16


@dataclass(frozen=True, kw_only=True)
class Window:
    """The part of the run that is tried.

    Attributes
    ----------
    duration : float [s]
        At most about that of the run.
    interval : float [s]
        Between compared frames: a multiple or a whole part of the save interval.
    parts : int
        How many intervals are in a frame of the run, where it is a part.
    n_frames : int
        The one at t = 0 included.
    """

    duration: float
    interval: float
    parts: int
    n_frames: int


def make_window(experiment: Experiment, *, wanted: float) -> Window:
    """Return the window of about `wanted` seconds."""
    save, whole = experiment.save_interval, experiment.n_frames - 1
    size = 3 * experiment.geometry.n_nodes
    most = max(LEAST_FRAMES, min(MOST_FRAMES, MOST_NUMBERS // size))
    frames = min(whole, max(1, math.ceil(wanted / save * (1.0 - 1e-9))))
    if frames >= LEAST_FRAMES:
        # Every few frames; the last stride may end a little after the run.
        stride = max(1, math.ceil(frames / most))
        count = math.ceil(frames / stride)
        return Window(
            duration=count * stride * save, interval=stride * save, parts=1, n_frames=count + 1
        )
    span = min(wanted, whole * save)
    parts = max(1, math.ceil(LEAST_FRAMES * save / span))
    count = min(whole * parts, math.ceil(span * parts / save * (1.0 - 1e-9)))
    return Window(
        duration=count * save / parts, interval=save / parts, parts=parts, n_frames=count + 1
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class Trial:
    """A scheme at one setting on the window.

    Attributes
    ----------
    n_steps : int
        In a frame of the run; of an adaptive scheme 0.
    tolerance : float
        Of an adaptive scheme; else 0.
    positions : (F, N, 3) [m]
        Empty where the run diverged.
    cost : float
        In evaluations of all forces by rk4.
    evaluations : int
        Of all forces, as counted or planned.
    """

    n_steps: int
    tolerance: float
    positions: Reals
    cost: float
    evaluations: int

    @property
    def failed(self) -> bool:
        """Whether there is nothing to compare."""
        return len(self.positions) == 0

    @property
    def resolution(self) -> float:
        """What grows as the trial gets finer."""
        return float(self.n_steps) if self.n_steps else 1.0 / self.tolerance


class Pilot:
    """Runs trials on a window, and counts what they cost.

    Parameters
    ----------
    experiment : Experiment
    window : Window
    most : float
        What all trials together may cost; see `affords`.
    """

    def __init__(self, experiment: Experiment, window: Window, *, most: float) -> None:
        self.experiment = experiment
        self.window = window
        self.most = most
        self.cost = 0.0
        self.evaluations = 0

    def fixed(self, scheme: Eligible, n_steps: int, *, exact: bool = False) -> Trial:
        """Run a scheme with `n_steps` steps in a frame of the run, a multiple of `parts`."""
        window = self.window
        h = self.experiment.save_interval / n_steps
        trial = self._experiment(scheme, exact=exact, dt=h)
        total = round(window.duration / h)
        stages = scheme.scheme.stages
        positions, _ = self._run(trial)
        return self._booked(
            Trial(
                n_steps=n_steps,
                tolerance=0.0,
                positions=positions,
                cost=scheme.cost(total, h),
                evaluations=stages * total,
            )
        )

    def adaptive(self, scheme: Eligible, tolerance: float, *, exact: bool = False) -> Trial:
        """Run a scheme that chooses its steps, to a relative error per step."""
        first = self.window.interval / math.ceil(self.window.interval / scheme.coarsest)
        trial = replace(self._experiment(scheme, exact=exact, dt=first), tolerance=tolerance)
        positions, evaluations = self._run(trial)
        return self._booked(
            Trial(
                n_steps=0,
                tolerance=tolerance,
                positions=positions,
                cost=scheme.step_cost * evaluations,
                evaluations=evaluations,
            )
        )

    def affords(self, cost: float) -> bool:
        """Say whether another trial may cost that much."""
        return self.cost + cost <= self.most

    def _booked(self, trial: Trial) -> Trial:
        self.cost += trial.cost
        self.evaluations += trial.evaluations
        return trial

    def _experiment(self, scheme: Eligible, *, exact: bool, dt: float) -> Experiment:
        window = self.window
        # Of single precision the truth has to know nothing.
        precision = "float64" if exact else self.experiment.precision
        return replace(
            with_scheme(self.experiment, scheme.scheme.name),
            duration=window.duration,
            save_interval=window.interval,
            dt=dt,
            precision=precision,
        )

    @staticmethod
    def _run(experiment: Experiment) -> tuple[Reals, int]:
        """Return frames (F, N, 3) [m], none if the run breaks down, and evaluations."""
        model = BarHingeModel(experiment, backend="cpu")
        frames = []
        try:
            frames = [block.x.copy() for _, block in model.blocks()]
        except Diverged:
            frames = []
        evaluations = model.effort.get("evaluations", 0)
        if not frames:
            return np.zeros((0, 0, 0)), evaluations
        positions = np.concatenate(frames)
        # A flat scene has two coordinates, but in single precision it has three.
        return np.pad(positions, ((0, 0), (0, 0), (0, 3 - positions.shape[2]))), evaluations


def error_curve(positions: Reals, truth: Reals) -> Reals:
    """Return the error of every frame, relative to the rms displacement: (F,).

    The displacement is that of `truth` from its first frame, over all nodes and frames; where
    nothing moves, errors are 0.
    """
    scale = rms_displacement(truth)
    wrong = np.sqrt(np.mean(np.sum((positions - truth) ** 2, axis=2), axis=1))
    if not np.isfinite(wrong).all():
        return np.full(len(truth), np.inf)
    curve: Reals = wrong / scale if scale > 0.0 else np.zeros(len(truth))
    return curve


def rms_displacement(frames: Reals) -> float:
    """Return the rms displacement from the first frame, over nodes and frames [m]."""
    return float(np.sqrt(np.mean(np.sum((frames - frames[0]) ** 2, axis=2))))
