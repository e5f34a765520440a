"""Motions and equilibria that have a formula."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Reals = NDArray[np.float64]

#: Standard gravity as scenes use it [m/s2].
GRAVITY = 9.81


# --- one degree of freedom ---------------------------------------------------------------------


def released(times: Reals, *, omega: float, decay: float = 0.0) -> Reals:
    """Return y(t) of ``y'' + 2 decay y' + omega^2 y = 0``, let go at 1 from rest: (T,) [1].

    ``exp(-d t) (cos w t + d / w sin w t)`` with ``w^2 = omega^2 - d^2``; hyperbolic functions
    where that is negative, and ``exp(-d t) (1 + d t)`` where it vanishes.

    Parameters
    ----------
    times : (T,) [s]
    omega, decay : float [rad/s], [1/s]
    """
    square = omega**2 - decay**2
    root = math.sqrt(abs(square))
    if root <= 1e-9 * omega:
        return np.exp(-decay * times) * (1.0 + decay * times)
    if square > 0.0:
        swing = np.cos(root * times) + decay / root * np.sin(root * times)
        return np.exp(-decay * times) * swing
    slow, fast = decay - root, decay + root
    # fast * slow = omega^2: the difference of two numbers that are nearly equal is avoided.
    slow = omega**2 / fast
    settled: Reals = (fast * np.exp(-slow * times) - slow * np.exp(-fast * times)) / (fast - slow)
    return settled


def pendulum_angle(times: Reals, *, start: float, rate: float) -> Reals:
    """Return the angle of a pendulum let go at `start` [rad] from rest: (T,) [rad].

    ``sin(angle / 2) = k cd(rate t, k)`` with ``k = sin(start / 2)`` and ``rate = sqrt(g / L)``
    (NIST Digital Library of Mathematical Functions, 22.19.2, https://dlmf.nist.gov/22.19).
    """
    from scipy.special import ellipj

    modulus = math.sin(start / 2.0)
    _, cn, dn, _ = ellipj(rate * times, modulus**2)
    angle: Reals = 2.0 * np.arcsin(modulus * cn / dn)
    return angle


def pendulum_period(*, start: float, rate: float) -> float:
    """Return the period ``4 K(sin(start / 2)) / rate`` of a pendulum [s]."""
    from scipy.special import ellipk

    return float(4.0 * ellipk(math.sin(start / 2.0) ** 2) / rate)


def bounce_heights(times: Reals, *, height: float, restitution: float) -> Reals:
    """Return how high a point is that falls from `height` on a floor: (T,) [m].

    It meets the floor at ``t_0 = sqrt(2 h / g)`` with the speed ``v = g t_0`` and flies for
    ``2 e^n v / g`` after impact n; all flights end at ``t_0 (1 + e) / (1 - e)``.
    """
    fall = math.sqrt(2.0 * height / GRAVITY)
    speed, begin = GRAVITY * fall, fall
    above = height - 0.5 * GRAVITY * times**2
    above = np.where(times < fall, above, 0.0)
    last = float(times.max(initial=0.0))
    while begin <= last:
        speed *= restitution
        span = 2.0 * speed / GRAVITY
        if span <= 1e-12 * fall:
            break
        since = times - begin
        flying = (since >= 0.0) & (since < span)
        above = np.where(flying, since * (speed - 0.5 * GRAVITY * since), above)
        begin += span
    return above


# --- chains ------------------------------------------------------------------------------------


def hanging_chain_modes(n: int) -> tuple[Reals, Reals]:
    """Return the modes of a hanging chain of `n` equal masses on equal links, lowest first.

    The squares of the frequencies in units of g / l are the roots of the Laguerre polynomial
    ``L_n``, and the mass that has i links below it moves by ``L_i`` at that root: the equation of
    motion ``(2 i + 1 - x) y_i = (i + 1) y_(i+1) + i y_(i-1)`` is the recurrence of these
    polynomials (NIST Digital Library of Mathematical Functions, 18.9.1).

    Returns
    -------
    roots : (n,) [1]
    shapes : (n, n + 1) [1]
        Sideways displacements of all nodes of each mode, the pivot first, the tip 1.
    """
    from numpy.polynomial import laguerre  # noqa: PLC0415 - only chains need it

    roots: Reals = laguerre.lagroots([0.0] * n + [1.0])
    shapes = np.array([laguerre.lagval(roots, [0.0] * i + [1.0]) for i in range(n, -1, -1)]).T
    shapes[:, 0] = 0.0
    return roots, shapes


def chain_of_links(angles: Reals, *, link: float) -> Reals:
    """Return positions in the plane y = 0 of a chain of links: (..., n) [rad] to (..., n + 1, 3).

    Angles are counted from straight down.
    """
    ends = np.zeros((*angles.shape[:-1], angles.shape[-1] + 1, 3))
    ends[..., 1:, 0] = link * np.cumsum(np.sin(angles), axis=-1)
    ends[..., 1:, 2] = -link * np.cumsum(np.cos(angles), axis=-1)
    return ends


def swinging_links(times: Reals, *, n: int, link: float, start: float) -> Reals:
    """Return the angles of `n` rigid links with equal masses at their ends: (T, n) [rad].

    Lagrange's equations ``sum_j c_ij (cos(a_i - a_j) a_j'' + sin(a_i - a_j) a_j'^2) = -(n - i)
    g / l sin a_i`` with ``c_ij = n - max(i, j)`` (i, j from 0), by DOP853 to 1e-12.

    Parameters
    ----------
    times : (T,) [s]
        Rising, from 0 or later.
    start : float [rad]
        Angle of all links at t = 0, at rest.
    """
    from scipy.integrate import solve_ivp

    number = np.arange(n)
    carried = n - np.maximum.outer(number, number).astype(float)
    weight = (n - number) * GRAVITY / link

    def slope(_: float, state: Reals) -> Reals:
        angle, speed = state[:n], state[n:]
        apart = angle[:, np.newaxis] - angle
        push = -weight * np.sin(angle) - (carried * np.sin(apart)) @ speed**2
        return np.concatenate([speed, np.linalg.solve(carried * np.cos(apart), push)])

    initial = np.concatenate([np.full(n, start), np.zeros(n)])
    found = solve_ivp(
        slope, (0.0, float(times[-1])), initial, "DOP853", times, rtol=1e-12, atol=1e-12
    )
    angles: Reals = found.y[:n].T
    return angles


def cantilever_deflection(*, force: float, length: float, rigidity: float, segments: int) -> float:
    """Return how far the tip of a clamped chain of bars and bends moves under a small load [m].

    ``F L^3 / (3 E I) (1 - 3 / (2 n) + 1 / (2 n^2))``: each of the n - 1 inner nodes turns by
    ``F (L - x) l / (E I)``, and the sum over them is exact; n to infinity gives Euler's beam.
    """
    n = segments
    return force * length**3 / (3.0 * rigidity) * (1.0 - 1.5 / n + 0.5 / n**2)


# --- snap-through ------------------------------------------------------------------------------


def von_mises_force(height: Reals, *, span: float, rise: float, stiffness: float) -> Reals:
    """Return the force that holds the apex of a von Mises truss at `height`: (...) [N], down.

    ``2 k z (L0 / sqrt(b^2 + z^2) - 1)``, for half span b, rise h and ``L0 = sqrt(b^2 + h^2)``.
    """
    relaxed = math.hypot(span, rise)
    force: Reals = 2.0 * stiffness * height * (relaxed / np.hypot(span, height) - 1.0)
    return force


def von_mises_limit(*, span: float, rise: float, stiffness: float) -> tuple[float, float]:
    """Return the limit load [N] and the height [m] at which a von Mises truss snaps.

    ``2 k (L0^(2/3) - b^(2/3))^(3/2)`` at ``z^2 = (L0 b^2)^(2/3) - b^2``.
    """
    relaxed = math.hypot(span, rise)
    # L0^(2/3) - b^(2/3) without the loss of digits of shallow trusses.
    gap = span ** (2 / 3) * math.expm1(math.log1p((rise / span) ** 2) / 3.0)
    height = span * math.sqrt(math.expm1(2.0 / 3.0 * math.log(relaxed / span)))
    return 2.0 * stiffness * gap**1.5, height


# --- folds -------------------------------------------------------------------------------------


def miura_tilt(half_width: Reals, *, b: float, sector: float) -> Reals:
    """Return the tilt of the panels of a Miura sheet whose cells are ``2 s`` wide: (...) [rad].

    The inverse of ``s = b cos(tilt) tan(sector) / sqrt(1 + cos(tilt)^2 tan(sector)^2)`` (Schenk &
    Guest 2013, doi:10.1073/pnas.1217998110).
    """
    cosine = half_width / np.sqrt(b**2 - half_width**2) / math.tan(sector)
    tilt: Reals = np.arccos(np.clip(cosine, 0.0, 1.0))
    return tilt


def miura_places(
    tilt: Reals, *, columns: int, rows: int, a: float, b: float, sector: float
) -> Reals:
    """Return the nodes of a Miura sheet of rigid panels at tilts (T,) [rad]: (T, N, 3) [m].

    Node (i, j), numbered along y first, is at ``(s i, l j + v (i odd), h (j odd))`` with ``h = a
    sin(sector) sin(tilt)``, ``l = a sqrt(1 - sin(tilt)^2 sin(sector)^2)``, ``v = b / q``, ``s = b
    cos(tilt) tan(sector) / q`` and ``q = sqrt(1 + cos(tilt)^2 tan(sector)^2)`` (as above).
    """
    i, j = np.divmod(np.arange((2 * columns + 1) * (2 * rows + 1)), 2 * rows + 1)
    flat = (np.cos(tilt) * math.tan(sector))[:, np.newaxis]
    q = np.sqrt(1.0 + flat**2)
    sine = (np.sin(tilt) * math.sin(sector))[:, np.newaxis]
    s, length = b * flat / q, a * np.sqrt(1.0 - sine**2)
    return np.stack([s * i, length * j + b / q * (i % 2), a * sine * (j % 2)], axis=2)


def miura_fold_energy(
    tilt: float, relaxed: float, *, columns: int, rows: int, a: float, b: float, sector: float,
    stiffness: float,
) -> float:  # fmt: skip
    """Return the energy in the folds of a Miura sheet of rigid panels [J].

    Folds along x are bent by ``2 tilt``, folds along y by ``2 atan(cos(sector) tan(tilt))``.

    Parameters
    ----------
    tilt, relaxed : float [rad]
        Now, and where the folds are at rest.
    stiffness : float [N*m/rad per m]
    """

    def bent(angle: float) -> tuple[float, float]:
        return 2.0 * angle, 2.0 * math.atan(math.cos(sector) * math.tan(angle))

    major, minor = (now - rest for now, rest in zip(bent(tilt), bent(relaxed), strict=True))
    lengths = b * 2 * columns * (2 * rows - 1), a * 2 * rows * (2 * columns - 1)
    return 0.5 * stiffness * (lengths[0] * major**2 + lengths[1] * minor**2)
