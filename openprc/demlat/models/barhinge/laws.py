"""Force laws of the bar-hinge model: the one source of its physics, for every compiler.

Pure functions of numbers. They use arithmetic, `math`, `abs` and `select` only, have no
branches, allocate nothing and never look at the scene, so that the same lines are compiled for
single numbers, for vectors of lanes and for CUDA threads.

Lengths are in one unit, and so on: any consistent system will do.
"""

from __future__ import annotations

import math

#: Added to squared lengths and areas, so that an element that is only filling up a vector
#: (all zeros) gives a force of zero and not 0 / 0. It is far below rounding everywhere else.
TINY = 1e-36
QUARTER_PI = math.pi / 4.0
HALF_PI = math.pi / 2.0


def select(condition: bool, yes: float, no: float) -> float:
    """Return `yes` where the condition holds, else `no`; both are evaluated."""
    return yes if condition else no


# --- bars: tension [N] and energy [J] from stretch s = l - relaxed [m] and rate dl/dt [m/s] ----


def linear_tension(stretch: float, stiffness: float) -> float:
    """Return ``k s`` (the paper's axial force)."""
    return stiffness * stretch


def linear_energy(stretch: float, stiffness: float) -> float:
    """Return ``k s^2 / 2``."""
    return 0.5 * stiffness * stretch * stretch


def cubic_tension(stretch: float, stiffness: float, cubic: float) -> float:
    """Return ``k s + k3 s^3`` (Hauser et al. 2011, doi:10.1007/s00422-012-0471-0)."""
    return stretch * (stiffness + cubic * stretch * stretch)


def cubic_energy(stretch: float, stiffness: float, cubic: float) -> float:
    """Return ``k s^2 / 2 + k3 s^4 / 4``."""
    square = stretch * stretch
    return square * (0.5 * stiffness + 0.25 * cubic * square)


def taut(stretch: float) -> float:
    """Return the stretch of a cable: `stretch` where it is positive, else 0."""
    return 0.5 * (stretch + abs(stretch))


def pressed(stretch: float) -> float:
    """Return the stretch of a strut: `stretch` where it is negative, else 0."""
    return 0.5 * (stretch - abs(stretch))


def engaged(stretch: float) -> float:
    """Return 1 where `stretch` is positive, else 0: a slack cable does not damp either."""
    return 0.5 + math.copysign(0.5, stretch)


def ogden_tension(stretch: float, stiffness: float, relaxed: float) -> float:
    """Return ``k L ((1 + e)^4 - 1) / 4`` with ``e = s / L``.

    The axial force ``C0 A (lambda^4 - 1) / 4`` of an Ogden material with exponents 5 and 1
    (Liu & Paulino 2017, doi:10.1098/rspa.2017.0348), ``k = C0 A / L``; expanded in the strain,
    which loses nothing when that is small.
    """
    e = stretch / relaxed
    return stiffness * stretch * (1.0 + e * (1.5 + e * (1.0 + 0.25 * e)))


def ogden_energy(stretch: float, stiffness: float, relaxed: float) -> float:
    """Return the integral of `ogden_tension` over the stretch."""
    e = stretch / relaxed
    return stiffness * stretch * stretch * (0.5 + e * (0.5 + e * (0.25 + 0.05 * e)))


# --- hinges -------------------------------------------------------------------------------


def arctangent(y: float, x: float) -> float:
    """Return the angle of the vector (x, y) in [-pi, pi] [rad], as ``math.atan2`` does.

    Without branches, so that lanes can share it. The argument is reduced to at most
    tan(pi/8); there ``atan(t) = t + t^3 P(t^2)`` with a polynomial through Chebyshev nodes
    that is within 5e-18 of the function, so the error is that of rounding.
    """
    ax, ay = abs(x), abs(y)
    steep = ay > ax
    low, high = select(steep, ax, ay), select(steep, ay, ax)
    wide = low > 0.41421356237309503 * high
    t = select(wide, low - high, low) / (select(wide, low + high, high) + TINY)
    z = t * t
    p = -0.05085240174154878 + z * (0.03922560559586107 - 0.019169476385361265 * z)
    p = -0.06664506835133263 + z * (0.05858108856106755 + z * p)
    p = -0.09090904564022367 + z * (0.07692182863309693 + z * p)
    p = -0.14285714284662226 + z * (0.11111111014909221 + z * p)
    p = -0.3333333333333333 + z * (0.199999999999955 + z * p)
    angle = t + t * z * p + select(wide, QUARTER_PI, 0.0 * t)
    angle = select(steep, HALF_PI - angle, angle)
    angle = select(x < 0.0, math.pi - angle, angle)
    return math.copysign(angle, y)


def turned_back(
    sine: float, cosine: float, sine_rest: float, cosine_rest: float
) -> tuple[float, float]:
    """Return sine and cosine of the bend minus the rest bend, times what they came with.

    ``sine`` is ``-|r_kj| n.r_ij`` and ``cosine`` is ``-m.n`` with ``m = r_ij x r_kj`` and
    ``n = r_kj x r_kl`` (Blondel & Karplus 1996,
    doi:10.1002/(SICI)1096-987X(19960715)17:9<1132::AID-JCC5>3.0.CO;2-T). The bend is the
    dihedral angle minus pi, so 0 is flat. Turning back by the rest angle before the arctangent
    is taken needs no wrapping and is exact near rest.
    """
    return sine * cosine_rest - cosine * sine_rest, cosine * cosine_rest + sine * sine_rest


def hinge_moment(difference: float, stiffness: float) -> float:
    """Return ``k (bend - rest)`` [N m]."""
    return stiffness * difference


def hinge_energy(difference: float, stiffness: float) -> float:
    """Return ``k (bend - rest)^2 / 2`` [J]."""
    return 0.5 * stiffness * difference * difference


def wall_moment(excess: float, stiffness: float, room: float) -> float:
    """Return what an enhanced-linear hinge adds beyond a limit [N m].

    Between the limits the hinge is linear; `excess` [rad] is how far it is beyond the upper
    limit (positive) or the lower one (negative), `room` the distance from that limit to where
    the panels meet: ``k (2 r / pi) tan(pi e / (2 r)) - k e``, added to the linear moment
    (Liu & Paulino 2017, doi:10.1098/rspa.2017.0348).
    """
    return stiffness * (room / HALF_PI * math.tan(HALF_PI * excess / room) - excess)


def wall_energy(excess: float, stiffness: float, room: float) -> float:
    """Return the integral of `wall_moment` over the excess [J]."""
    scale = room / HALF_PI
    return -stiffness * (scale * scale * math.log(math.cos(excess / scale)) + 0.5 * excess * excess)


# --- bends --------------------------------------------------------------------------------

#: Arms whose product of sines is below this share of their lengths lie on one line: what is left
#: is rounding, and says nothing about the side that they bend to.
COLLINEAR = 1e-13


def collinear(square: float, first: float, second: float) -> bool:
    """Say whether arms u and v lie on one line, from ``|u x v|^2``, ``u.u`` and ``v.v``."""
    return square < COLLINEAR * COLLINEAR * first * second


# --- tangents: derivatives of the laws above, for implicit schemes -----------------------------


def linear_tangent(stretch: float, stiffness: float) -> float:
    """Return d(tension)/d(stretch) [N/m] of `linear_tension`."""
    return stiffness + 0.0 * stretch


def cubic_tangent(stretch: float, stiffness: float, cubic: float) -> float:
    """Return d(tension)/d(stretch) [N/m] of `cubic_tension`; of cubic dashpots, by the rate."""
    return stiffness + 3.0 * cubic * stretch * stretch


def ogden_tangent(stretch: float, stiffness: float, relaxed: float) -> float:
    """Return d(tension)/d(stretch) [N/m] of `ogden_tension`: ``k (1 + e)^3``."""
    ratio = 1.0 + stretch / relaxed
    return stiffness * ratio * ratio * ratio


def wall_tangent(excess: float, stiffness: float, room: float) -> float:
    """Return d(moment)/d(angle) [N m/rad] of `wall_moment`: ``k tan(pi e / (2 r))^2``."""
    tangent = math.tan(HALF_PI * excess / room)
    return stiffness * tangent * tangent
