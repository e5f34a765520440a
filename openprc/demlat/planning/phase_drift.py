"""How far the fastest mode of an undamped body gets out of phase in a run."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from openprc.demlat.integrators import INTEGRATORS
from openprc.demlat.planning.stability import step_limit
from openprc.demlat.planning.step_limits import pefrl_turn, rk4_growth
from openprc.demlat.planning.tangent_operators import TangentOperators

if TYPE_CHECKING:
    from openprc.schema.experiment import Experiment

#: Radians by which the fastest mode may be out of phase at the end without a word.
MOST = 0.15
#: Share of the motion that rounding may add up to without a word, where nothing damps it.
MOST_ROUNDED = 5e-3
#: Share of the motion that the errors of steps within the tolerance may add up to likewise.
MOST_TOLERATED = 5e-3


def turn(scheme: str, phase: float) -> float:
    """Return the angle that an undamped mode turns by in a step, as the scheme has it.

    Parameters
    ----------
    scheme : str
        Name of an integrator with a fixed step.
    phase : float [rad]
        Step times angular frequency: what it ought to be.

    Notes
    -----
    rk4: the argument of its growth factor at ``i phase``. Verlet and what is made of it:
    ``2 asin(phase / 2)``. Midpoint: ``2 atan(phase / 2)`` (Hairer, Lubich & Wanner, Geometric
    Numerical Integration, sec. I.5, doi:10.1007/3-540-30666-8). PEFRL: half the trace of its
    step is the cosine.
    """
    kind = "verlet" if scheme == "respa" else INTEGRATORS[scheme].stability
    if scheme == "midpoint":
        return 2.0 * math.atan(0.5 * phase)
    if kind == "rk4":
        return float(np.angle(rk4_growth(np.array(1j * phase))))
    if kind == "verlet":
        return 2.0 * math.asin(min(0.5 * phase, 1.0))
    return pefrl_turn(phase) if kind == "pefrl" else phase


def is_undamped(experiment: Experiment) -> bool:
    """Say whether nothing but the scheme takes energy."""
    geometry = experiment.geometry
    dampers = (geometry.bars, geometry.hinges, geometry.bends)
    return not (
        experiment.damping > 0.0
        or any(elements.damping.any() for elements in dampers)
        or geometry.bars.damping_cubic.any()
    )


def drift_remarks(experiment: Experiment) -> Iterator[str]:
    """Yield how far the fastest mode gets out of phase, where nothing damps it.

    A mode that is damped has died out by then, and schemes that choose their steps go by a
    tolerance.
    """
    scheme = INTEGRATORS.get(experiment.integrator)
    if scheme is None or scheme.step != "fixed" or not is_undamped(experiment):
        return
    steps = experiment.steps_per_frame * (experiment.n_frames - 1)
    rounded = float(np.finfo(experiment.precision).eps) * steps
    if rounded > MOST_ROUNDED:
        yield (
            f"nothing damps the body, and each of {steps:,} steps rounds to"
            f" {experiment.precision}: up to {rounded:.2g} of the motion by the end"
            + ("; float64 rounds a billion times less" if experiment.precision != "float64" else "")
        )
    bound = math.sqrt(TangentOperators(experiment).stiffness_bound())
    if _drift(experiment, bound, steps) <= MOST:
        return
    # The limit of respa leaves out the bars, which its inner steps look after.
    whole = experiment
    if experiment.integrator == "respa":
        whole = replace(experiment, integrator="verlet")
    omega = step_limit(whole).omega
    drift = _drift(experiment, omega, steps)
    if drift > MOST:
        yield (
            f"{experiment.integrator} turns the fastest mode ({omega:.3g} rad/s, undamped) by"
            f" {drift:.2g} rad too far or too little in the {steps:,} steps of this run: where it"
            " matters, positions are out of phase by then, while energies and spectra stay; take"
            " a smaller dt, pefrl or dop853"
        )


def _drift(experiment: Experiment, omega: float, steps: int) -> float:
    """Return the difference of turns over a run [rad]."""
    if not math.isfinite(omega):
        return math.inf
    phase, parts = omega * experiment.dt, 1
    if experiment.integrator == "respa":
        # The inner steps are 0.8 of the stability limit at most.
        parts = max(1, math.ceil(phase / 1.6))
    part = phase / parts
    return abs(turn(experiment.integrator, part) - part) * parts * steps


def tolerance_remarks(experiment: Experiment, steps: int) -> Iterator[str]:
    """Yield what the errors of so many steps, each within the tolerance, may add up to."""
    tolerance = 1e-6 if experiment.tolerance is None else experiment.tolerance
    share = tolerance * steps
    if share > MOST_TOLERATED and is_undamped(experiment):
        yield (
            f"nothing damps the body, and {experiment.integrator} took {steps:,} steps, each with"
            f" an error of up to {tolerance:g} of the motion: up to {share:.2g} by the end if they"
            " add up; lower the tolerance"
        )
