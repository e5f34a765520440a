"""What is known of every point in one frame."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import NDArray

from openprc.vision.tracking.status import Status

if TYPE_CHECKING:
    from openprc.vision.source.frame import Frame


@dataclass(frozen=True, slots=True)
class FrameTracks:
    """All points in one frame.

    Attributes
    ----------
    index : int
        Number of the frame.
    stamp : float [s]
        Time as the container says it, NaN where it does not.
    duplicate : bool
        The image is that of the frame before.
    positions : (N, 2) [px]
        NaN where the point was not found.
    status : (N,)
        Codes of `openprc.vision.Status`.
    quality : (N,)
        Zero-normalised cross-correlation with the template, NaN where there is none.
    sigma : (N, 2) [px]
        One-sigma of the position from noise and gradient, NaN where it is not known.
    template : (N,)
        How many times the point's template has been renewed; 0 is the reference frame.
    deformation : (N, 2, 2)
        Deformation gradient of the surroundings since the reference frame, NaN where it is
        not known.
    """

    index: int
    stamp: float
    duplicate: bool
    positions: NDArray[np.float64]
    status: NDArray[np.uint8]
    quality: NDArray[np.float32]
    sigma: NDArray[np.float32]
    template: NDArray[np.int32]
    deformation: NDArray[np.float32]

    @classmethod
    def unseen(cls, frame: Frame, n_points: int) -> FrameTracks:
        """Return a frame in which no point has been looked for: all LOST."""
        return cls(
            index=frame.index,
            stamp=frame.stamp,
            duplicate=frame.duplicate,
            positions=np.full((n_points, 2), np.nan),
            status=np.full(n_points, Status.LOST, np.uint8),
            quality=np.full(n_points, np.nan, np.float32),
            sigma=np.full((n_points, 2), np.nan, np.float32),
            template=np.zeros(n_points, np.int32),
            deformation=np.full((n_points, 2, 2), np.nan, np.float32),
        )


class Follower(Protocol):
    """A method that follows points: placed in one frame, then shown the next ones in order."""

    @property
    def notes(self) -> tuple[str, ...]:
        """What the user should know."""

    def place(self, frame: Frame, points: NDArray[np.float64]) -> FrameTracks:
        """Take `points` (N, 2) [px] as they lie in the reference frame."""

    def step(self, frame: Frame) -> FrameTracks:
        """Find them in the next frame."""
