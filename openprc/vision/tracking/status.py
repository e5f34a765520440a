"""What can be said of a point in a frame."""

from __future__ import annotations

from enum import IntEnum


class Status(IntEnum):
    """Why a position is there, or why it is not; positions of the middle three are NaN."""

    TRACKED = 0
    """Found, and every check passed."""
    LOST = 1
    """Not found."""
    OOB = 2
    """Out of bounds: outside the image, or so near its edge that the window leaves it."""
    DRIFT = 3
    """Found, but the check forward and backward, or against its neighbours, failed."""
    INTERPOLATED = 4
    """Filled in afterwards between two frames in which it was found."""
    REFERENCE = 5
    """Where the point was placed, in the reference frame."""
