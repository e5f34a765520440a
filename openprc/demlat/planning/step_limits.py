"""How large a step an explicit scheme can take on a linear system ``y'' + C y' + K y = 0``.

K and C are small matrices here: a body's own, or their projections on a few of its modes.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Reals = NDArray[np.float64]
    Complexes = NDArray[np.complex128]

#: ``h |lambda|`` that the classical Runge-Kutta scheme bears on the imaginary axis, 2 sqrt(2),
#: and in the half-disc left of it whatever the direction (Hairer & Wanner, Solving Ordinary
#: Differential Equations II, sec. IV.2, doi:10.1007/978-3-642-05221-7).
RK4_UNDAMPED = 2.0 * np.sqrt(2.0)
RK4_HALF_DISC = 2.61
#: Coefficients of PEFRL (Omelyan, Mryglod & Folk 2002, doi:10.1016/S0010-4655(02)00451-4).
PEFRL_UNDAMPED = 2.989
PEFRL_XI, PEFRL_LAMBDA, PEFRL_CHI = 0.1786178958448091, -0.2123418310626054, -0.06626458266981849


class BindingMode(NamedTuple):
    """The largest step, and the mode that would grow beyond it.

    Attributes
    ----------
    step : float [s]
        Infinity when no mode bounds it.
    mode : (m,) complex
    rate : float [1/s]
        Magnitude of the mode's eigenvalue.
    """

    step: float
    mode: Complexes
    rate: float


def largest_step(scheme: str, stiffness: Reals, damping: Reals) -> BindingMode:
    """Return the largest step with which no decaying motion grows.

    Parameters
    ----------
    scheme : {"rk4", "verlet", "pefrl"}
    stiffness : (m, m) [1/s2]
    damping : (m, m) [1/s]
    """
    if scheme == "verlet":
        return _verlet(stiffness, damping)
    rates, modes = _eigenvalues(stiffness, damping)
    size = np.abs(rates)
    scale = float(np.max(size, initial=0.0))
    decays = (rates.real <= 1e-9 * scale) & (size > 1e-12 * scale)
    if not decays.any():
        return BindingMode(float("inf"), np.zeros(len(stiffness), complex), 0.0)
    rates, modes, size = rates[decays], modes[:, decays], size[decays]
    if scheme == "rk4":
        directions = np.minimum(rates.real, -1e-300) + 1j * np.abs(rates.imag)
        steps = rk4_reach(directions / np.abs(directions)) / size
    else:
        steps = pefrl_step(
            np.einsum("im,ij,jm->m", modes.conj(), stiffness, modes).real,
            np.einsum("im,ij,jm->m", modes.conj(), damping, modes).real,
        )
    first = int(np.argmin(steps))
    return BindingMode(float(steps[first]), modes[:, first], float(size[first]))


def _eigenvalues(stiffness: Reals, damping: Reals) -> tuple[Complexes, Complexes]:
    """Return eigenvalues of the first-order system, and its modes of norm 1."""
    m = len(stiffness)
    # Positions are measured in velocities over the fastest rate, which balances the blocks.
    unit = np.sqrt(max(float(np.abs(stiffness).max(initial=0.0)), 1e-300))
    system = np.zeros((2 * m, 2 * m))
    system[:m, m:] = unit * np.eye(m)
    system[m:, :m] = -stiffness / unit
    system[m:, m:] = -damping
    rates, vectors = np.linalg.eig(system)
    # Of a mode, x or v may vanish (a free motion, a pure decay): the larger one is taken.
    x, v = vectors[:m], vectors[m:]
    modes = np.where(np.linalg.norm(x, axis=0) > np.linalg.norm(v, axis=0), x, v)
    return rates.astype(complex), modes / np.linalg.norm(modes, axis=0)


def rk4_growth(z: Any) -> Any:
    """Return what a step of the classical Runge-Kutta scheme multiplies a mode by."""
    return 1.0 + z * (1.0 + z / 2.0 * (1.0 + z / 3.0 * (1.0 + z / 4.0)))


def rk4_reach(directions: Complexes) -> Reals:
    """Return how far from 0 the scheme is stable along unit vectors of the left half-plane."""
    low, high = np.full(directions.shape, 2.5), np.full(directions.shape, 3.5)
    for _ in range(50):
        middle = 0.5 * (low + high)
        stable = np.abs(rk4_growth(middle * directions)) <= 1.0
        low, high = np.where(stable, middle, low), np.where(stable, high, middle)
    return low


def rk4_loss(phase: float) -> float:
    """Return the share of an undamped mode's energy that the scheme loses in one period.

    Parameters
    ----------
    phase : float [rad]
        Step times angular frequency. For small ones the loss is ``2 pi phase^5 / 72``.
    """
    kept = 2.0 * np.log(abs(rk4_growth(np.array(1j * phase)))) * 2.0 * np.pi / phase
    return float(-np.expm1(kept))


def _verlet(stiffness: Reals, damping: Reals) -> BindingMode:
    """Damping from the predicted velocity ``v + h a``: stable while ``h^2 K + 4 h C < 4``."""
    m = len(stiffness)
    unit = np.sqrt(max(float(np.abs(stiffness).max(initial=0.0)), 1e-300))
    system = np.zeros((2 * m, 2 * m))
    # 1/h = s: (s^2 - s C - K / 4) y = 0, whose largest root bounds the step.
    system[:m, m:] = unit * np.eye(m)
    system[m:, :m] = stiffness / (4.0 * unit)
    system[m:, m:] = damping
    roots, vectors = np.linalg.eig(system)
    if m == 0 or not np.max(roots.real) > 0.0:
        return BindingMode(float("inf"), np.zeros(m, complex), 0.0)
    first = int(np.argmax(roots.real))
    mode = vectors[m:, first]
    return BindingMode(
        float(1.0 / roots[first].real),
        (mode / np.linalg.norm(mode)).astype(complex),
        float(2.0 * roots[first].real),
    )


def pefrl_step(stiffness: Reals, damping: Reals) -> Reals:
    """Return the largest steps of PEFRL for modes with ``omega^2`` and ``2 zeta omega``.

    By bisection on the spectral radius of the step's 2 x 2 matrix; 2.989 / omega undamped.
    """
    # A mode without stiffness of its own grows whatever the step; its damping still counts.
    stiffness = np.maximum(stiffness, 0.0)
    unit = np.maximum(np.maximum(np.sqrt(stiffness), np.abs(damping)), 1e-300)
    # Damping lets some modes bear more than undamped ones do; their neighbours may not.
    with np.errstate(divide="ignore"):
        top = np.minimum(PEFRL_UNDAMPED / np.sqrt(stiffness), 4.0 / unit)
    low = np.zeros_like(unit)
    # The first unstable step, not just some: walk up, then bisect.
    for share in np.linspace(0.01, 1.0, 100):
        stable = _pefrl_radius(share * top, stiffness, damping) <= 1.0 + 1e-12
        low = np.where(stable & (low >= (share - 0.0101) * top), share * top, low)
    high = np.minimum(low + 0.01 * top, top)
    for _ in range(40):
        middle = 0.5 * (low + high)
        stable = _pefrl_radius(middle, stiffness, damping) <= 1.0 + 1e-12
        low, high = np.where(stable, middle, low), np.where(stable, high, middle)
    return low


def pefrl_turn(phase: float) -> float:
    """Return the angle by which PEFRL turns an undamped mode in a step of that phase [rad].

    Half the trace of the step is its cosine, the determinant being one.
    """
    matrix = _pefrl_matrix(np.array([phase]), np.ones(1), np.zeros(1))[0]
    return float(np.arccos(np.clip(0.5 * np.trace(matrix), -1.0, 1.0)))


def _pefrl_radius(h: Reals, stiffness: Reals, damping: Reals) -> Reals:
    matrix = _pefrl_matrix(h, stiffness, damping)
    radius: Reals = np.abs(np.linalg.eigvals(matrix)).max(axis=-1)
    return radius


def _pefrl_matrix(h: Reals, stiffness: Reals, damping: Reals) -> Reals:
    matrix = np.zeros((*h.shape, 2, 2))
    matrix[..., 0, 0] = matrix[..., 1, 1] = 1.0
    kick = 0.5 * (1.0 - 2.0 * PEFRL_LAMBDA)
    middle = 1.0 - 2.0 * (PEFRL_CHI + PEFRL_XI)
    drifts = (PEFRL_XI, PEFRL_CHI, middle, PEFRL_CHI, PEFRL_XI)
    kicks = (kick, PEFRL_LAMBDA, PEFRL_LAMBDA, kick)
    for number, drift in enumerate(drifts):
        matrix[..., 0, :] += (drift * h)[..., None] * matrix[..., 1, :]
        if number < len(kicks):
            # A kick solves v' = -omega^2 x - c v at a fixed x with the Runge-Kutta scheme.
            span = kicks[number] * h
            z = -span * damping
            push = span * stiffness * (1.0 + z / 2.0 * (1.0 + z / 3.0 * (1.0 + z / 4.0)))
            velocity = rk4_growth(z)[..., None] * matrix[..., 1, :]
            matrix[..., 1, :] = velocity - push[..., None] * matrix[..., 0, :]
    return matrix
