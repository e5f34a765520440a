"""What the tracker carries from one frame to the next."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from openprc.vision.tracking.status import Status


@dataclass
class PointState:
    """All points after a frame.

    Attributes
    ----------
    reference : (N, 2) [px]
        Where they were placed.
    warps : (N, 6)
        Position [px] and deformation since the point's template (`a b c d` in
        (1 + a, b; c, 1 + d)); of a lost point, where and how it is expected.
    tracked : (N,)
        Found in the last frame.
    status : (N,)
    quality, sigma : (N,), (N, 2)
        Of the last position.
    usual : (N,)
        Quality that the point usually has, NaN before the first frame.
    velocity : (N, 2) [px per frame]
        Last step between two frames in which the point was found.
    coasting : (N, 2) [px]
        Where a lost point is if it goes on as it did.
    missed : (N,)
        Frames since the point was found.
    first_template, template : (N,)
        Of the reference frame, -1 for points that have none, and the one in use.
    depth : (N,)
        Templates between the one in use and the reference frame.
    base : (N, 2, 2)
        Deformation gradient of the template in use since the reference frame.
    base_sigma : (N, 2) [px]
        One-sigma of the position at which the template in use was cut.
    """

    reference: NDArray[np.float64]
    first_template: NDArray[np.intp]
    warps: NDArray[np.float64] = field(init=False)
    tracked: NDArray[np.bool_] = field(init=False)
    status: NDArray[np.uint8] = field(init=False)
    quality: NDArray[np.float64] = field(init=False)
    sigma: NDArray[np.float64] = field(init=False)
    usual: NDArray[np.float64] = field(init=False)
    velocity: NDArray[np.float64] = field(init=False)
    coasting: NDArray[np.float64] = field(init=False)
    missed: NDArray[np.intp] = field(init=False)
    template: NDArray[np.intp] = field(init=False)
    depth: NDArray[np.int32] = field(init=False)
    base: NDArray[np.float64] = field(init=False)
    base_sigma: NDArray[np.float64] = field(init=False)

    def __post_init__(self) -> None:
        n = len(self.reference)
        self.warps = np.zeros((n, 6))
        self.warps[:, :2] = self.reference
        self.tracked = self.first_template >= 0
        self.status = np.where(self.tracked, Status.REFERENCE, Status.LOST).astype(np.uint8)
        self.quality = np.where(self.tracked, 1.0, np.nan)
        self.sigma = np.full((n, 2), np.nan)
        self.usual = np.full(n, np.nan)
        self.velocity = np.zeros((n, 2))
        self.coasting = self.reference.copy()
        self.missed = np.zeros(n, np.intp)
        self.template = self.first_template.copy()
        self.depth = np.zeros(n, np.int32)
        self.base = np.tile(np.eye(2), (n, 1, 1))
        self.base_sigma = np.zeros((n, 2))

    @property
    def positions(self) -> NDArray[np.float64]:
        """Where the points are, or are expected, (N, 2) [px]."""
        return self.warps[:, :2]


def gradients(warps: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the deformation gradients (n, 2, 2) of warps (n, 6)."""
    return warps[:, 2:].reshape(-1, 2, 2) + np.eye(2)


def warps_at(
    positions: NDArray[np.float64], deformation: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the warps (n, 6) that lead to `positions` (n, 2) with `deformation` (n, 2, 2)."""
    return np.hstack([positions, (deformation - np.eye(2)).reshape(-1, 4)])
