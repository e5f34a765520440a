"""When a point needs a new template, and what its deformation is then.

A template of the reference frame keeps errors from adding up, so a new one is cut only when
the surroundings have changed too much for the first to be recognised; each new one adds its own
error once.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from openprc.vision.tracking.config import KLTConfig
from openprc.vision.tracking.local_motion import masked_median

#: Part of a point's wear that its neighbours must show as well.
_SHARED = 0.75


def rotation(deformation: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the angle [deg] of the rotation in deformation gradients (n, 2, 2).

    The rotation of the polar decomposition F = R U, in closed form for the plane.
    """
    f = deformation
    return np.degrees(np.arctan2(f[:, 1, 0] - f[:, 0, 1], f[:, 0, 0] + f[:, 1, 1]))


def strain(deformation: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the largest stretch less one, in magnitude, of (n, 2, 2).

    The principal stretches are the singular values of F, in closed form for the plane.
    """
    f = deformation
    turning = np.hypot(f[:, 0, 0] + f[:, 1, 1], f[:, 1, 0] - f[:, 0, 1]) / 2
    shearing = np.hypot(f[:, 0, 0] - f[:, 1, 1], f[:, 1, 0] + f[:, 0, 1]) / 2
    return np.maximum(np.abs(turning + shearing - 1), np.abs(turning - shearing - 1))


def wear(
    quality: NDArray[np.float64], fresh: NDArray[np.float64], *, max_znssd: float
) -> NDArray[np.float64]:
    """Return how far correlations have gone from what they were (0) to being refused (1).

    Parameters
    ----------
    quality : (n,)
        Zero-normalised cross-correlation of late.
    fresh : (n,)
        The same soon after the template was cut: what the noise alone leaves.
    max_znssd : float
        The sum of squared differences, 2 (1 - quality), that is accepted without noise.
    """
    noise = 1.0 - fresh
    refused = np.maximum(max_znssd / 2, np.minimum(3 * noise, 0.5))
    # In images so noisy that they hardly pass, a small loss must not count as wear.
    return (fresh - quality) / np.maximum(refused - noise, 0.1 * noise + max_znssd / 4)


def worn(
    quality: NDArray[np.float64],
    fresh: NDArray[np.float64],
    deformation: NDArray[np.float64],
    neighbours: NDArray[np.intp],
    found: NDArray[np.bool_],
    *,
    config: KLTConfig,
) -> NDArray[np.bool_]:
    """Return which points (N,) need a new template.

    What wears a template down for good, such as folding or a change of light, does the same to
    its neighbours. What passes in front of a point does it to the points at its edge only, and
    must not be taken into a template: it would be followed from then on.
    """
    worn_by = wear(quality, fresh, max_znssd=config.refinement.max_znssd)
    worn_by = np.where(found & np.isfinite(worn_by), worn_by, 0.0)
    deformed = rotation(deformation)
    changed = (np.abs(deformed) > config.key_rotation) | (strain(deformation) > config.key_strain)
    limit = np.where(changed, config.key_quality / 2, config.key_quality)
    due = found & (worn_by > limit)
    if due.any() and neighbours.shape[1]:
        around = masked_median(worn_by[neighbours], found[neighbours])
        due &= ~(around < _SHARED * worn_by)
    return due
