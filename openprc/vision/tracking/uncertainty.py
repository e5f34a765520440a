"""Normal equations of subset matching, and how noise gets into their solution.

With J the Jacobian of the template, orthogonal to the constant and to the template itself so
that offset and gain of the light drop out, the warp solves J'(g(warp) - f) = 0 in the image g.
With K the Jacobian of an image without noise, steps are M^-1 J'g with M = J'K, and noise of
variance s^2 in the differences makes the covariance

    s^2 M^-1 (J'J) M^-T,

which for J = K is the Cramer-Rao bound s^2 (J'J)^-1 (Kay 1993, Fundamentals of Statistical
Signal Processing I, chapter 3). Here J is made with a smoothed gradient of a noisy template, and

    M = r (J'J - s^2 N),

where N is what unit noise makes of J'J on average, and r is by how much smoothing weakens the
gradient. Without either, steps would be too short and deviations too small.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = ["GradientNoise", "Gradients", "Normal", "normal_equations"]

#: Up to this share of a diagonal element of M is taken for noise.
_MOST_NOISE = 0.7
#: Smallest eigenvalue, of M scaled to a unit diagonal, at which a step is determined; the same
#: for the part of the position, over the largest.
_SINGULAR = 1e-5
#: The same for a window that shows its deformation, but not its curvature.
_DEFORMS = 1e-2
#: The same for a window that shows its position and nothing else: a dot, but not an edge.
_ROUND = 0.1
#: And how far [px] the point may lie from what is seen: that turns around it unnoticed.
_LEVER = 0.75
#: Weight of a deformation that is not measured, so that nothing of it is taken for noise.
_KEPT = 1e12
#: Smallest spread of grey levels, over their size, that is no rounding error of the arithmetic.
_SMALLEST_CONTRAST = 1e-6

Gradients = tuple[NDArray[np.float64], NDArray[np.float64]]


class GradientNoise(NamedTuple):
    """What unit noise makes of the gradient, on average [1/px^2]."""

    smooth: float
    """Of the square of the smoothed gradient."""
    mixed: float
    """Of the product of the smoothed and the exact one."""


class Normal(NamedTuple):
    """Data of n templates; `good` says which have texture in every direction.

    Parameters come in the order of the kernels: two of the position, four of the deformation
    (a), six of the curvature (q). ``pull`` says by how much the others change for what is taken
    off these, ``weight`` is the inverse covariance, ``variance`` that of the position for two,
    six and twelve free parameters; all for differences with unit noise.
    """

    good: NDArray[np.bool_]
    energy: NDArray[np.float64]
    gradient_x: NDArray[np.float64]
    gradient_y: NDArray[np.float64]
    mean_jacobian: NDArray[np.float64]
    value_jacobian: NDArray[np.float64]
    to_translation: NDArray[np.float64]
    to_affine: NDArray[np.float64]
    to_quadratic: NDArray[np.float64]
    weight_a: NDArray[np.float64]
    weight_q: NDArray[np.float64]
    pull_a: NDArray[np.float64]
    pull_q: NDArray[np.float64]
    variance: NDArray[np.float64]


def _diagonal(matrices: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.einsum("nii->ni", matrices)


def _jacobian(
    gradients: Gradients, dx: NDArray[np.float64], dy: NDArray[np.float64]
) -> NDArray[np.float64]:
    gx, gy = gradients
    columns = [gx, gy, gx * dx, gx * dy, gy * dx, gy * dy]
    for g in gradients:
        columns += [g * dx * dx, g * dx * dy, g * dy * dy]
    return np.stack(columns, axis=1).reshape(len(gx), 12, -1)


def _set_aside(good: NDArray[np.bool_], *matrices: NDArray[np.float64]) -> None:
    """Put something that has an inverse in the place of what is not good."""
    for matrix in matrices:
        matrix[~good] = np.eye(matrix.shape[-1])


def _least(m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the smallest eigenvalue of matrices (n, k, k), scaled to a unit diagonal."""
    scale = np.sqrt(np.maximum(_diagonal(m), 1e-300))
    return np.linalg.eigvalsh(m / (scale[:, :, None] * scale[:, None, :]))[:, 0]


def normal_equations(
    f: NDArray[np.float64],
    *,
    mean: NDArray[np.float64],
    smooth: Gradients,
    exact: Gradients,
    offset: NDArray[np.float64],
    noise: NDArray[np.float64],
    gain: GradientNoise,
) -> Normal:
    """Set up the normal equations of templates.

    Parameters
    ----------
    f : (n, S, S) [grey levels]
        Values, less their `mean` (n,).
    smooth, exact : two of (n, S, S) [grey levels/px]
        Gradient in x and y, smoothed and of the spline through the pixels.
    offset : (n, 2) [px]
        First pixel of the window, from the tracked point.
    noise : (n,) [grey levels]
        One standard deviation.
    gain : GradientNoise
    """
    n, side, _ = f.shape
    steps = np.arange(side)
    dx = np.broadcast_to((offset[:, 0, None] + steps)[:, None, :], f.shape)
    dy = np.broadcast_to((offset[:, 1, None] + steps)[:, :, None], f.shape)
    flat = f.reshape(n, -1)
    energy = np.einsum("ni,ni->n", flat, flat)
    j = _jacobian(smooth, dx, dy)
    mean_jacobian = j.mean(axis=2)
    good = np.isfinite(energy) & (energy > (_SMALLEST_CONTRAST * side * mean) ** 2)
    over = np.where(good, energy, 1.0)
    value_jacobian = (j @ flat[:, :, None])[:, :, 0] / over[:, None]
    square = (
        j @ j.transpose(0, 2, 1)
        - side**2 * mean_jacobian[:, :, None] * mean_jacobian[:, None, :]
        - over[:, None, None] * value_jacobian[:, :, None] * value_jacobian[:, None, :]
    )
    good &= np.isfinite(square).all(axis=(1, 2))
    _set_aside(good, square)
    good &= (_diagonal(square) > 0.0).all(axis=1)
    _set_aside(good, square)

    unit, zero = np.ones(f.shape), np.zeros(f.shape)
    of_x, of_y = _jacobian((unit, zero), dx, dy), _jacobian((zero, unit), dx, dy)
    pure = of_x @ of_x.transpose(0, 2, 1) + of_y @ of_y.transpose(0, 2, 1)
    share = gain.smooth * np.square(np.where(good, noise, 0.0))[:, None] * _diagonal(pure)
    share = (share / _diagonal(square)).max(axis=1)
    taken = np.where(good, noise, 0.0) ** 2 / np.maximum(share / _MOST_NOISE, 1.0)
    m = square - (gain.smooth * taken)[:, None, None] * pure
    # The trace of the part for the position says by how much smoothing weakened the gradient.
    product = sum(np.einsum("nji,nji->n", s, e) for s, e in zip(smooth, exact, strict=True))
    power = sum(np.einsum("nji,nji->n", s, s) for s in smooth)
    weakened = (product - 2.0 * side**2 * gain.mixed * taken) / np.where(
        good, power - 2.0 * side**2 * gain.smooth * taken, 1.0
    )
    good &= weakened > 0.0
    m *= np.where(good, weakened, 1.0)[:, None, None]
    _set_aside(good, m, square)
    position = np.linalg.eigvalsh(m[:, :2, :2])
    bends = _least(m) > _SINGULAR
    deforms = bends | (_least(m[:, :6, :6]) > _DEFORMS)
    good &= position[:, 0] > np.where(deforms, _SINGULAR, _ROUND) * position[:, 1]
    _set_aside(good, m, square)
    lever = np.linalg.inv(m[:, :2, :2]) @ m[:, :2, 2:6]
    good &= deforms | (np.abs(lever).max(axis=(1, 2)) < _LEVER)
    # What the pattern does not show, as the rotation of a round dot, stays as it was guessed.
    free = np.where(good & deforms, np.where(bends, 12, 6), np.where(good, 2, 12))
    held = np.arange(12) >= free[:, None]
    both = held[:, :, None] | held[:, None, :]
    m, square = (np.where(both, np.eye(12), matrix) for matrix in (m, square))

    sizes = (2, 6, 12)
    inverse = [np.linalg.inv(m[:, :k, :k]) for k in sizes]
    spread = [a @ square[:, :k, :k] @ a for a, k in zip(inverse, sizes, strict=True)]
    weight_a = np.linalg.inv(spread[1][:, 2:, 2:])
    weight_a[free == 2] *= _KEPT
    for k, of_all in zip(sizes, inverse, strict=True):
        of_all[held[:, :k]] = 0.0
    return Normal(
        good=good,
        energy=energy,
        gradient_x=smooth[0],
        gradient_y=smooth[1],
        mean_jacobian=mean_jacobian,
        value_jacobian=value_jacobian,
        to_translation=inverse[0],
        to_affine=inverse[1],
        to_quadratic=inverse[2],
        weight_a=weight_a,
        weight_q=np.linalg.inv(spread[2][:, 6:, 6:]),
        pull_a=inverse[0] @ m[:, :2, 2:6],
        pull_q=inverse[1] @ m[:, :6, 6:],
        variance=np.stack([_diagonal(v)[:, :2] for v in spread], axis=1),
    )
