"""What light, lens and sensor do to the grey levels."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Values = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Photometry:
    """From the brightness of the body to the grey levels of a frame.

    Parameters
    ----------
    noise : float
        One-sigma of white Gaussian noise [grey levels].
    gain, bias : callable, optional
        Frame to a factor and an offset [grey levels] of the whole image.
    slope : callable, optional
        Frame to the change of the gain from the left edge to the right one.
    defocus : callable, optional
        Frame to the sigma of a Gaussian blur [px]; the pattern must have a closed form under
        it. A blur in the plane of the body, so exact for motions without strain.
    shutter : float
        Part of the time between frames for which the shutter is open, from the frame's time on
        symmetrically; frame 0 is sharp. 0 freezes the motion.
    exposures : int
        Images that are averaged over an open shutter.
    """

    noise: float = 0.0
    gain: Callable[[int], float] | None = None
    bias: Callable[[int], float] | None = None
    slope: Callable[[int], float] | None = None
    defocus: Callable[[int], float] | None = None
    shutter: float = 0.0
    exposures: int = 9

    def expose(self, brightness: Values, k: int) -> Values:
        """Return the grey levels of frame `k` before noise and rounding, (H, W)."""
        image = brightness
        if self.slope is not None:
            place = np.linspace(-0.5, 0.5, image.shape[1])
            image = image * (1.0 + self.slope(k) * place)
        if self.gain is not None:
            image = image * self.gain(k)
        if self.bias is not None:
            image = image + self.bias(k)
        return image


@dataclass(frozen=True, kw_only=True)
class Occluder:
    """A textured bar before the body, that moves from left to right.

    Parameters
    ----------
    width : float [px]
    left : callable
        Frame to the x of its left edge [px].
    level, contrast : float
        Mean and root mean square of its own speckle [grey levels].
    """

    width: float
    left: Callable[[int], float]
    level: float = 60.0
    contrast: float = 20.0
    seed: int = 99

    def covers(self, x: Values, k: int, *, margin: float = 0.0) -> NDArray[np.bool_]:
        """Return where x [px] is behind the bar, widened by `margin` [px] on both sides."""
        left = self.left(k)
        inside: NDArray[np.bool_] = (x >= left - margin) & (x < left + self.width + margin)
        return inside
