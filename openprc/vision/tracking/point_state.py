"""What the tracker carries from one frame to the next."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from openprc.vision.tracking.status import Status

#: Frames over which the quality of a fresh template is averaged, and that of late.
FRESH, _LATE = 10, 10


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
    fresh, age : (N,)
        Quality soon after the template was cut, and the frames since then.
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
    fresh: NDArray[np.float64] = field(init=False)
    age: NDArray[np.intp] = field(init=False)
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
        self.fresh = np.full(n, np.nan)
        self.age = np.zeros(n, np.intp)
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

    def learn(self, found: NDArray[np.bool_]) -> None:
        """Learn from the last frame what quality the points `found` (N,) have."""
        late = np.where(np.isnan(self.usual), self.quality, self.usual)
        self.usual = np.where(found, late + (self.quality - late) / _LATE, self.usual)
        growing = found & (self.age < FRESH)
        self.age += found
        first = np.where(np.isnan(self.fresh), 0.0, self.fresh)
        mean = first + (self.quality - first) / np.maximum(self.age, 1)
        self.fresh[growing] = mean[growing]

    def forget(self, points: NDArray[np.intp]) -> None:
        """Let the quality of points with another template be learned anew."""
        self.fresh[points] = self.usual[points] = np.nan
        self.age[points] = 0


def gradients(warps: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the deformation gradients (n, 2, 2) of warps (n, 6)."""
    return warps[:, 2:].reshape(-1, 2, 2) + np.eye(2)


def warps_at(
    positions: NDArray[np.float64], deformation: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the warps (n, 6) that lead to `positions` (n, 2) with `deformation` (n, 2, 2)."""
    return np.hstack([positions, (deformation - np.eye(2)).reshape(-1, 4)])
