"""Force laws of the bar-hinge model: pure functions of numbers, for any compiler.

Every compiled backend is built from these functions, so that there is one source for the
physics. They use `math` only, allocate nothing, and never look at the scene.
"""

from __future__ import annotations

import math

#: Slack, in samples, within which a time counts as lying on a sample of a signal.
SAMPLE_SLACK = 1e-6
LINEAR, HOLD, CUBIC = 0, 1, 2


def bar_force(
    length: float, rate: float, stiffness: float, relaxed: float, damping: float
) -> float:
    """Return the tension of a bar [N]: ``k (l - l0) + c dl/dt``, positive when it pulls.

    The spring is Eq. "axial force" of the OpenPRC paper. The dashpot acts on the rate of the
    length [m/s] only: a damper on the whole relative velocity would slow a rigid rotation.
    """
    return stiffness * (length - relaxed) + damping * rate


def bar_energy(length: float, stiffness: float, relaxed: float) -> float:
    """Return the elastic energy of a bar [J]: ``k (l - l0)^2 / 2``."""
    stretch = length - relaxed
    return 0.5 * stiffness * stretch * stretch


def wrap_angle(angle: float) -> float:
    """Return `angle` [rad] moved into [-pi, pi] by whole turns."""
    return angle - 2.0 * math.pi * math.floor((angle + math.pi) / (2.0 * math.pi))


def bend_angle(crease: float, n_dot_rij: float, m_dot_n: float) -> float:
    """Return the bend of a hinge [rad]: the dihedral angle minus pi, so 0 is flat.

    ``atan2(-|r_kj| n.r_ij, -m.n)`` with ``m = r_ij x r_kj`` and ``n = r_kj x r_kl``
    (Blondel & Karplus 1996, doi:10.1002/(SICI)1096-987X(19960715)17:9<1132::AID-JCC5>3.0.CO;2-T).
    Unlike an arc cosine it is exact near flat; the cut lies where the hinge is folded shut.
    """
    return math.atan2(-crease * n_dot_rij, -m_dot_n)


def hinge_moment(difference: float, rate: float, stiffness: float, damping: float) -> float:
    """Return the moment of a hinge [N m]: ``k (bend - rest) + c d(bend)/dt``.

    `difference` is wrapped, so a rest angle may be given in any turn and means the shorter
    way round.
    """
    return stiffness * difference + damping * rate


def hinge_energy(difference: float, stiffness: float) -> float:
    """Return the elastic energy of a hinge [J]: ``k (bend - rest)^2 / 2``."""
    return 0.5 * stiffness * difference * difference


def first_segment(time: float, sample_dt: float) -> int:
    """Return the segment of a signal that begins at or before `time` [s]."""
    return math.floor(time / sample_dt + SAMPLE_SLACK)


def last_segment(time: float, sample_dt: float) -> int:
    """Return the segment of a signal that ends at or after `time` [s]."""
    return math.ceil(time / sample_dt - SAMPLE_SLACK) - 1


def linear_value(s: float, left: float, right: float) -> float:
    """Return the chord through two samples at ``s`` in [0, 1]."""
    return left + (right - left) * s


def cubic_value(
    s: float, left: float, right: float, left_slope: float, right_slope: float
) -> float:
    """Return the cubic with given end values and slopes (per segment) at ``s`` in [0, 1]."""
    r = 1.0 - s
    return r * r * ((1.0 + 2.0 * s) * left + s * left_slope) + s * s * (
        (1.0 + 2.0 * r) * right - r * right_slope
    )


def cubic_rate(s: float, left: float, right: float, left_slope: float, right_slope: float) -> float:
    """Return the derivative of `cubic_value` with respect to ``s``."""
    r = 1.0 - s
    return (
        6.0 * s * r * (right - left)
        + r * (r - 2.0 * s) * left_slope
        + s * (s - 2.0 * r) * right_slope
    )
