"""How far the fastest mode of an undamped body gets out of phase in a run."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from openprc.demlat.integrators import INTEGRATORS
from openprc.demlat.planning.stability import step_limit
from openprc.demlat.planning.step_limits import pefrl_turn, rk4_growth
from openprc.demlat.planning.tangent_operators import TangentOperators

if TYPE_CHECKING:
    from openprc.schema.experiment import Experiment

#: Radians by which the fastest mode may be out of phase at the end without a word.
MOST = 1.0


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


def drift_remarks(experiment: Experiment) -> Iterator[str]:
    """Yield how far the fastest mode gets out of phase, where nothing damps it.

    A mode that is damped has died out by then, and schemes that choose their steps go by a
    tolerance.
    """
    scheme = INTEGRATORS.get(experiment.integrator)
    if scheme is None or scheme.step != "fixed" or experiment.damping > 0.0:
        return
    geometry = experiment.geometry
    dampers = (geometry.bars, geometry.hinges, geometry.bends)
    if any(elements.damping.any() for elements in dampers) or geometry.bars.damping_cubic.any():
        return
    steps = experiment.steps_per_frame * (experiment.n_frames - 1)
    bound = math.sqrt(TangentOperators(experiment).stiffness_bound())
    if _drift(experiment, bound, steps) <= MOST:
        return
    omega = step_limit(experiment).omega
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
