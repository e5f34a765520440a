"""Normal equations of subset matching, and how noise gets into their solution.

With J the Jacobian of the template by the smoothed gradient and K that by the exact one, both
orthogonal to the constant and to the template itself, so that offset and gain of the light drop
out, the warp solves J'(g(warp) - f) = 0. Steps are M^-1 J'g with M = J'K, and noise of variance
s^2 in the differences makes the covariance

    s^2 M^-1 (J'J) M^-T,

which for J = K is the Cramer-Rao bound s^2 (J'J)^-1. Noise of the template's own pixels adds
to J'J and to M; what it adds to M on average is taken off, or steps would be too short and
deviations too small.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = ["Normal", "normal_equations"]

#: Up to this share of a diagonal element is taken for noise.
_MOST_NOISE = 0.7
#: Smallest eigenvalue, of the matrix scaled to a unit diagonal, at which a step is determined.
_SINGULAR = 1e-5


class Normal(NamedTuple):
    """Data of n templates; `good` says which have texture in every direction."""

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


def _jacobian(
    gradients: tuple[NDArray[np.float64], NDArray[np.float64]],
    dx: NDArray[np.float64],
    dy: NDArray[np.float64],
) -> NDArray[np.float64]:
    gx, gy = gradients
    columns = [gx, gy, gx * dx, gx * dy, gy * dx, gy * dy]
    for g in gradients:
        columns += [g * dx * dx, g * dx * dy, g * dy * dy]
    return np.stack(columns, axis=1).reshape(len(gx), 12, -1)


def normal_equations(
    f: NDArray[np.float64],
    *,
    smooth: tuple[NDArray[np.float64], NDArray[np.float64]],
    exact: tuple[NDArray[np.float64], NDArray[np.float64]],
    offset: NDArray[np.float64],
    noise: NDArray[np.float64],
    smooth_noise: float,
    mixed_noise: float,
) -> Normal:
    """Set up the normal equations of templates.

    Parameters
    ----------
    f : (n, S, S) [grey levels]
        Values, less their mean.
    smooth, exact : two of (n, S, S) [grey levels/px]
        Gradient in x and y.
    offset : (n, 2) [px]
        First pixel of the window, from the tracked point.
    noise : (n,) [grey levels]
    smooth_noise, mixed_noise : float [1/px^2]
        Mean square of the smoothed gradient of unit noise, and its mean product with the exact.
    """
    n, side, _ = f.shape
    steps = np.arange(side)
    dx = np.broadcast_to((offset[:, 0, None] + steps)[:, None, :], f.shape)
    dy = np.broadcast_to((offset[:, 1, None] + steps)[:, :, None], f.shape)
    flat = f.reshape(n, -1)
    energy = np.einsum("ni,ni->n", flat, flat)
    j, k = _jacobian(smooth, dx, dy), _jacobian(exact, dx, dy)
    mean_jacobian = j.mean(axis=2)
    with np.errstate(invalid="ignore", divide="ignore"):
        value_jacobian = np.einsum("nki,ni->nk", j, flat) / energy[:, None]
        k_mean = k.mean(axis=2)
        k_value = np.einsum("nki,ni->nk", k, flat) / energy[:, None]
        size = side * side

        def projected(left: NDArray, mean: NDArray, value: NDArray) -> NDArray[np.float64]:
            return (
                j @ left.transpose(0, 2, 1)
                - size * mean_jacobian[:, :, None] * mean[:, None, :]
                - energy[:, None, None] * value_jacobian[:, :, None] * value[:, None, :]
            )

        square = projected(j, mean_jacobian, value_jacobian)
        mixed = projected(k, k_mean, k_value)
    mixed = 0.5 * (mixed + mixed.transpose(0, 2, 1))
    good = np.isfinite(square).all(axis=(1, 2)) & np.isfinite(mixed).all(axis=(1, 2))
    good &= np.isfinite(energy) & (energy > 0.0)
    # What a gradient of pure noise would make of M.
    unit = np.ones_like(dx)
    zero = np.zeros_like(dx)
    of_x, of_y = _jacobian((unit, zero), dx, dy), _jacobian((zero, unit), dx, dy)
    pure = of_x @ of_x.transpose(0, 2, 1) + of_y @ of_y.transpose(0, 2, 1)
    diagonal = np.where(good, np.einsum("nii->ni", mixed).min(axis=1), 1.0)
    good &= diagonal > 0.0
    mixed[~good], square[~good] = np.eye(12), np.eye(12)
    share = (
        (mixed_noise * noise**2)[:, None] * np.einsum("nii->ni", pure) / np.einsum("nii->ni", mixed)
    )
    taken = np.where(
        good,
        np.minimum(noise**2, noise**2 * _MOST_NOISE / np.maximum(share.max(axis=1), _MOST_NOISE)),
        0.0,
    )
    mixed = mixed - (mixed_noise * taken)[:, None, None] * pure
    sq = square - (smooth_noise * taken)[:, None, None] * pure
    eta = np.einsum("nii->ni", mixed)[:, :2].sum(1) / np.einsum("nii->ni", sq)[:, :2].sum(1)
    mixed = eta[:, None, None] * sq
    scale = np.sqrt(np.einsum("nii->ni", mixed))
    scaled = mixed / (scale[:, :, None] * scale[:, None, :])
    good &= np.linalg.eigvalsh(scaled)[:, 0] > _SINGULAR
    mixed[~good], square[~good] = np.eye(12), np.eye(12)

    inverse = [np.linalg.inv(mixed[:, :m, :m]) for m in (2, 6, 12)]
    spread = [
        a @ square[:, :m, :m] @ a.transpose(0, 2, 1)
        for a, m in zip(inverse, (2, 6, 12), strict=True)
    ]
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
        weight_a=np.linalg.inv(spread[1][:, 2:, 2:]),
        weight_q=np.linalg.inv(spread[2][:, 6:, 6:]),
        pull_a=inverse[0] @ mixed[:, :2, 2:6],
        pull_q=inverse[1] @ mixed[:, :6, 6:],
        variance=np.stack([np.einsum("nii->ni", v)[:, :2] for v in spread], axis=1),
    )
