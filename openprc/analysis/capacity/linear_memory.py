"""The memory of a linear network in closed form: the limit of infinite data."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from openprc.errors import TaskError


def linear_network_memory(
    recurrent: ArrayLike, into: ArrayLike, *, max_delay: int, sensor_noise: float = 0.0
) -> NDArray[np.float64]:
    """Return the capacities C_0 ... C_max_delay of ``x(t) = W x(t-1) + v u(t)``.

    With a white input of unit variance the covariance S of the states solves
    ``S = W S W^T + v v^T``, and ``C_k = (W^k v)^T (S + s^2 I)^-1 (W^k v)`` (White, Lee and
    Sompolinsky 2004, doi:10.1103/PhysRevLett.92.148102). Without noise they add up to the
    number of independent states.

    Parameters
    ----------
    recurrent : (N, N)
        W, with a spectral radius below 1.
    into : (N,)
        v.
    max_delay : int
    sensor_noise : float
        Standard deviation s of white noise added to each state, relative to an input of unit
        standard deviation.

    Returns
    -------
    (max_delay + 1,)

    Raises
    ------
    TaskError
        When the shapes do not fit, or the network does not forget.
    """
    from scipy.linalg import solve_discrete_lyapunov

    w, v = np.asarray(recurrent, dtype=np.float64), np.asarray(into, dtype=np.float64)
    if w.ndim != 2 or w.shape != (len(v), len(v)) or v.ndim != 1:
        raise TaskError(
            f"the recurrent weights have shape {w.shape} and the input weights {v.shape}",
            expected="(N, N) and (N,)",
            fix="give one input weight per state",
            key="recurrent",
        )
    radius = float(np.abs(np.linalg.eigvals(w)).max())
    if not radius < 1.0:
        raise TaskError(
            f"the spectral radius is {radius:.4g}",
            expected="less than 1, or the past is never forgotten",
            fix="scale the recurrent weights down",
            key="recurrent",
        )
    covariance = solve_discrete_lyapunov(w, np.outer(v, v))
    response = np.empty((max_delay + 1, len(v)))
    response[0] = v
    for k in range(max_delay):
        response[k + 1] = w @ response[k]
    power, vectors = np.linalg.eigh(covariance)
    # Directions that the input never reaches hold nothing; rounding must not fill them.
    reached = power > len(v) * np.finfo(np.float64).eps * power[-1]
    coordinates = response @ vectors[:, reached]
    return np.asarray((coordinates**2 / (power[reached] + sensor_noise**2)).sum(axis=1))
