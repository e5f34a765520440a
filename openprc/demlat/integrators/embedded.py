"""Explicit Runge-Kutta pairs as tables, and one step of any of them.

Velocities are unknowns whose rates are ``F / m``, and positions are unknowns whose rates are
the stages' velocities; putting the first into the second leaves

    v_i = v + h sum_j a_ij F_j / m,      x_i = x + c_i h v + h^2 sum_j (A A)_ij F_j / m,

which are the same numbers with half of the stages to keep (Hairer, Norsett & Wanner, Solving
Ordinary Differential Equations I, sec. II.14, doi:10.1007/978-3-540-78862-1). Forces are kept
as they come and divided by the mass once. Work and loss are further unknowns of the system.

The tables are run-time arrays, so that one compiled loop serves every pair.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numba import types
from numpy.typing import NDArray

from openprc.demlat.compiled.jit import chosen_by_type, jit
from openprc.demlat.compiled.lanes import load, splat, store
from openprc.demlat.integrators.copying import copy
from openprc.demlat.models.barhinge.drive_kernels import place_driven
from openprc.demlat.models.barhinge.dynamics_kernels import evaluate
from openprc.demlat.models.barhinge.tables import Reals


class Tableau(NamedTuple):
    """An explicit pair of n stages that ends with the first stage of the next step.

    Attributes
    ----------
    order : int
    stages : int
        n; row n of `weights` holds the weights of the step itself.
    error_order : int
        Of the step in the estimated error: it is proportional to its power.
    parts : (3, 2) i8
        From which stage to before which one: of the start, of a step, of the dense output.
    nodes : (S,)
        Of all stages; after the first n + 1 come those of the dense output.
    weights, double_weights : (S, S)
        A, and A times itself.
    error, double_error : (2, S)
        Weights of two estimates, of which the second one corrects the first and may be zero;
        and these times A.
    dense, double_dense : (R, S)
        Weights of what `basis` is multiplied by; and these times A.
    """

    order: int
    stages: int
    error_order: int
    parts: NDArray[np.int64]
    nodes: Reals
    weights: Reals
    double_weights: Reals
    error: Reals
    double_error: Reals
    dense: Reals
    double_dense: Reals

    @classmethod
    def of(
        cls,
        *,
        order: int,
        rows: Sequence[Sequence[float]],
        error: Sequence[Sequence[float]],
        error_order: int,
        dense: Sequence[Sequence[float]],
        stages: int,
    ) -> Tableau:
        """Return the tables.

        Parameters
        ----------
        rows : S rows of A, the first of which is empty
            The one with number `stages` are the weights of the step.
        error : one or two rows
        dense : rows
            Of the dense output in nested form, after the three that any Hermite interpolant
            has (Hairer, Norsett & Wanner, sec. II.6).
        """
        size = len(rows)
        weights = _padded(rows, size)
        estimates = np.zeros((2, size))
        estimates[: len(error)] = _padded(error, size)
        step, first, last = weights[stages], np.eye(size)[0], np.eye(size)[stages]
        hermite = [step, first - step, 2.0 * step - first - last]
        interpolant = np.array([*hermite, *_padded(dense, size)])
        return cls(
            order=order,
            stages=stages,
            error_order=error_order,
            parts=np.array([[0, 1], [1, stages + 1], [stages + 1, size]]),
            nodes=weights.sum(axis=1),
            weights=weights,
            double_weights=weights @ weights,
            error=estimates,
            double_error=estimates @ weights,
            dense=interpolant,
            double_dense=interpolant @ weights,
        )


def _padded(rows: Sequence[Sequence[float]], size: int) -> Reals:
    return np.array([[*row, *([0.0] * (size - len(row)))] for row in rows])


class Stages(NamedTuple):
    """Work arrays of a pair, for K coordinates.

    Attributes
    ----------
    pitch : int
        Between the forces of two stages in `forces`.
    forces : (S * pitch,) [N]
    rates : (5 or 6 * LEDGER_STRIDE,) [W] or None
    kept : (S, 5 or 6 * LEDGER_STRIDE) [W] or None
        Powers of all stages.
    x, v : (K,)
        A stage, and at last the end of the step.
    evaluations : (1,) i8
        Of all forces so far.
    old_x, old_v, old_ledger
        The start of the last step.
    out_x, out_v, out_ledger
        What is to be saved.
    """

    pitch: int
    forces: Reals
    rates: Reals | None
    kept: Reals | None
    x: Reals
    v: Reals
    evaluations: NDArray[np.int64]
    old_x: Reals
    old_v: Reals
    old_ledger: Reals
    out_x: Reals
    out_v: Reals
    out_ledger: Reals


@jit
def weighted_sums(
    stages: Any, lanes: Any, weights: Any, double: Any, row: int, count: int, at: int
) -> Any:
    """Return the weighted sums of forces of one vector of coordinates."""
    gain, path = splat(lanes, 0.0), splat(lanes, 0.0)
    for j in range(count):
        force = load(lanes, stages.forces, at, j * stages.pitch)
        gain += weights[row, j] * force
        path += double[row, j] * force
    return gain, path


def keep_rates(lanes: Any, kept: Any, row: int, rates: Any) -> None:
    """Keep the powers of a stage, if there are any."""


@chosen_by_type(keep_rates)
def _keep_rates(lanes, kept, row, rates):
    if isinstance(rates, types.NoneType):
        return lambda lanes, kept, row, rates: None
    return lambda lanes, kept, row, rates: copy(lanes, kept[row], rates)


@jit
def run_stages(
    table: Any, stages: Any, body: Any, x: Any, v: Any, part: Any, t: float, t_to: float
) -> None:
    """Compute the stages of a row of `Tableau.parts`, of a step from (x, v) at `t`.

    The stage state is that of the last one then.
    """
    # All in one loop: functions that return sums of vectors, or are called with all these
    # tables for each stage, take half of the time that the forces take.
    lanes, pitch, h = body.lanes, stages.pitch, t_to - t
    stages.evaluations[0] += part[1] - part[0]
    for row in range(part[0], part[1]):
        ahead = table.nodes[row] * h
        for at in range(0, x.size, len(lanes)):
            gain, path = splat(lanes, 0.0), splat(lanes, 0.0)
            for j in range(row):
                force = load(lanes, stages.forces, at, j * pitch)
                gain += table.weights[row, j] * force
                path += table.double_weights[row, j] * force
            mobility = h * load(lanes, body.inverse_mass, at, 0)
            u = load(lanes, v, at, 0)
            store(lanes, stages.v, at, u + mobility * gain)
            moved = ahead * u + h * mobility * path
            store(lanes, stages.x, at, load(lanes, x, at, 0) + moved)
        now = t_to if row == table.stages else t + ahead
        place_driven(body.drives, stages.x, stages.v, now, t, t_to)
        result = stages.forces[row * pitch : row * pitch + x.size]
        evaluate(body, stages.x, stages.v, result, stages.rates, now, t, t_to)
        keep_rates(body.lanes, stages.kept, row, stages.rates)


def blend_ledger(target: Any, source: Any, rates: Any, weights: Any, h: float) -> None:
    """Set a ledger to another one plus `h` times the weighted powers of the stages."""


@chosen_by_type(blend_ledger)
def _blend_ledger(target, source, rates, weights, h):
    if isinstance(rates, types.NoneType):
        return lambda target, source, rates, weights, h: None

    def blend(target, source, rates, weights, h):
        for at in range(rates.shape[1]):
            target[at] = source[at]
        for j in range(rates.shape[0]):
            share = h * weights[j]
            if share != 0.0:
                for at in range(rates.shape[1]):
                    target[at] += share * rates[j, at]

    return blend


@jit
def begin_next(table: Any, stages: Any, body: Any, size: int) -> None:
    """Make the force at the end of the last step that of the first stage."""
    last = table.stages * stages.pitch
    copy(body.lanes, stages.forces[:size], stages.forces[last : last + size])
    copy_row(body.lanes, stages.kept, table.stages)


def copy_row(lanes: Any, kept: Any, row: int) -> None:
    """Make the powers of a stage those of the first one, if there are any."""


@chosen_by_type(copy_row)
def _copy_row(lanes, kept, row):
    if isinstance(kept, types.NoneType):
        return lambda lanes, kept, row: None
    return lambda lanes, kept, row: copy(lanes, kept[0], kept[row])


@jit
def interpolate(
    table: Any,
    stages: Any,
    body: Any,
    weights: Any,
    t: float,
    h: float,
    t_to: float,
    now: float,
) -> None:
    """Set what is to be saved to the state at `now` within the last step, from `t` to `t_to`.

    The interpolant is ``y + q_0 (w_0 + ...)`` with ``q_0 = s``, ``q_1 = s (1 - s)``,
    ``q_2 = s^2 (1 - s)``, ... (Hairer, Norsett & Wanner, sec. II.6); `weights` is (2, S).
    """
    s = (now - t) / h
    weights[:, :] = 0.0
    basis = 1.0
    for row in range(table.dense.shape[0]):
        basis *= s if row % 2 == 0 else 1.0 - s
        for j in range(weights.shape[1]):
            weights[0, j] += basis * table.dense[row, j]
            weights[1, j] += basis * table.double_dense[row, j]
    a, b, lanes = weights[0:1], weights[1:2], body.lanes
    for at in range(0, stages.x.size, len(lanes)):
        gain, path = weighted_sums(stages, lanes, a, b, 0, weights.shape[1], at)
        mobility = h * load(lanes, body.inverse_mass, at, 0)
        start = load(lanes, stages.old_v, at, 0)
        store(lanes, stages.out_v, at, start + mobility * gain)
        moved = s * h * start + h * mobility * path
        store(lanes, stages.out_x, at, load(lanes, stages.old_x, at, 0) + moved)
    place_driven(body.drives, stages.out_x, stages.out_v, now, t, t_to)
    blend_ledger(stages.out_ledger, stages.old_ledger, stages.kept, weights[0], h)
