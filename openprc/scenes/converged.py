"""The motion of an experiment by a solver that shares nothing with the schemes of producers.

SciPy's DOP853 on the forces of the experiment, stopped where a drive is not smooth.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from openprc.errors import NotConverged

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from openprc.demlat.forces import ForceField
    from openprc.schema.experiment import Experiment

    Reals = NDArray[np.float64]

#: Relative and absolute (in units of the body's size) tolerance of references.
TOLERANCE = 1e-11


def converged_motion(
    experiment: Experiment, *, tolerance: float = TOLERANCE
) -> Callable[[Reals], Reals]:
    """Return the function of time that an experiment's positions follow.

    Nothing is computed before the function is called; it integrates from 0 to the last time it
    is asked for (Hairer, Norsett & Wanner 1993, Solving Ordinary Differential Equations I, II.5,
    for the scheme).

    Parameters
    ----------
    experiment : Experiment
        Without rigid elements and without contact; times, scheme and precision do not matter.
    tolerance : float
        Relative, and in units of the body's size (and of that per second) absolute, per step.

    Returns
    -------
    callable
        Rising times (T,) [s], from 0 or later, to positions (T, N, 3) [m]. Raises
        `NotConverged` where the solver fails.
    """

    def motion(times: Reals) -> Reals:
        # Compiled code and SciPy are loaded when somebody asks for the motion.
        from openprc.demlat.forces import ForceField  # noqa: PLC0415

        field = ForceField(replace(experiment, step_check="warn"), vectors=False)
        return _integrate(experiment, field, np.asarray(times, dtype="f8"), tolerance)

    return motion


def _integrate(experiment: Experiment, field: ForceField, times: Reals, tolerance: float) -> Reals:
    from scipy.integrate import solve_ivp

    geometry = experiment.geometry
    n = geometry.n_nodes
    free = ~experiment.held_axes
    inverse = np.where(free, 1.0 / np.where(free, geometry.masses[:, np.newaxis], 1.0), 0.0)
    x, v = np.array(geometry.positions), np.array(geometry.velocities)
    forces = np.empty((n, 3))
    n_free = int(free.sum())
    found = np.empty((len(times), n, 3))

    def spread(state: Reals, time: float, late: bool) -> None:
        x[free], v[free] = state[:n_free], state[n_free:]
        field.place(x, v, time=time, side="before" if late else "after")

    spread(np.concatenate([x[free], v[free]]), 0.0, False)
    if not times[-1:].any():
        return np.repeat(x[np.newaxis], len(times), axis=0)
    knots = _knots(experiment, float(times[-1]))
    state = np.concatenate([x[free], v[free]])
    size = float(np.ptp(geometry.positions, axis=0).max()) or 1.0
    done = 0
    for begin, end in pairwise(knots.tolist()):
        middle = 0.5 * (begin + end)

        def slope(time: float, state: Reals, middle: float = middle) -> Reals:
            spread(state, time, time > middle)
            field(x, v, time=time, side="before" if time > middle else "after", out=forces)
            return np.concatenate([v[free], (forces * inverse)[free]])

        upto = int(np.searchsorted(times, end, side="right"))
        asked = times[done:upto]
        path = solve_ivp(
            slope,
            (begin, end),
            state,
            "DOP853",
            np.append(asked[asked < end], end),
            rtol=tolerance,
            atol=tolerance * size,
        )
        if path.status != 0:
            reached = path.t[-1] if len(path.t) else begin
            raise NotConverged(
                f"the reference stops at {reached:g} s: {path.message}",
                expected=f"a motion up to {float(times[-1]):g} s",
                fix="take a softer body, or a looser tolerance",
            )
        for row, time in enumerate(asked):
            spread(path.y[:, min(row, path.y.shape[1] - 1)], float(time), time > middle)
            found[done + row] = x
        done, state = upto, path.y[:, -1]
    return found


def _knots(experiment: Experiment, last: float) -> Reals:
    """Return 0, every time at which a drive is not smooth, and the last time: (K,) [s]."""
    knots = [np.array([0.0, last])]
    for name in dict.fromkeys(actuator.signal for actuator in experiment.actuators):
        signal = experiment.signals[name]
        if signal.interpolation == "cubic":
            inner = np.array([(len(signal.values) - 1) * signal.dt])
        else:
            inner = np.arange(1, len(signal.values) + 1) * signal.dt
        knots.append(inner[inner < last])
    every: Reals = np.unique(np.concatenate(knots))
    # Two signals may say the same time in numbers that differ by rounding.
    every = every[np.append(True, np.diff(every) > 1e-9 * last)]
    every[-1] = last
    return every
