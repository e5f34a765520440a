"""The search for all points in one frame: attempts from several guesses, until one holds."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from openprc.vision.tracking.config import KLTConfig
from openprc.vision.tracking.correlation import Correlator, PreparedImage, Refined
from openprc.vision.tracking.point_state import PointState

#: Reason of the correlator: the subset leaves the image.
_LEFT_IMAGE = 2
#: Largest change of a component of the deformation gradient from its guess.
_MOST_CHANGE = 0.4


@dataclass
class FrameSearch:
    """What has been found so far in a frame.

    Attributes
    ----------
    found : (N,)
    warps : (N, 6)
        Of the points found.
    quality, sigma : (N,), (N, 2)
    template : (N,)
        The template by which each was found.
    led : (N,)
        Found from where Lucas-Kanade led, there and back.
    left : (N,)
        The last attempt ended because the subset leaves the image.
    """

    correlator: Correlator
    image: PreparedImage
    state: PointState
    config: KLTConfig
    found: NDArray[np.bool_] = field(init=False)
    warps: NDArray[np.float64] = field(init=False)
    quality: NDArray[np.float64] = field(init=False)
    sigma: NDArray[np.float64] = field(init=False)
    template: NDArray[np.intp] = field(init=False)
    led: NDArray[np.bool_] = field(init=False)
    left: NDArray[np.bool_] = field(init=False)

    def __post_init__(self) -> None:
        n = len(self.state.reference)
        self.found = np.zeros(n, bool)
        self.warps = self.state.warps.copy()
        self.quality = np.full(n, np.nan)
        self.sigma = np.full((n, 2), np.nan)
        self.template = self.state.template.copy()
        self.led = np.zeros(n, bool)
        self.left = np.zeros(n, bool)

    def attempt(
        self,
        points: NDArray[np.intp],
        guess: NDArray[np.float64],
        *,
        templates: NDArray[np.intp] | None = None,
        floor: NDArray[np.float64] | float = 0.0,
        steps_from: NDArray[np.float64] | None = None,
        within: float = np.inf,
    ) -> None:
        """Refine `points` (n,) from `guess` (n, 6), and keep those that are accepted.

        Parameters
        ----------
        templates : (n,), optional
            Those in use where left out.
        floor : (n,)
            Least quality, beyond what the correlator asks for.
        steps_from : (n, 2) [px], optional
            Positions in the frame before, for the limit on the step.
        within : float [px]
            Farthest from the guess, where that is less than the configuration's.
        """
        known = np.isfinite(guess).all(axis=1)
        points, guess = points[known], guess[known]
        if not len(points):
            return
        templates = self.state.template[points] if templates is None else templates[known]
        refined = self.correlator.refine(self.image, templates, guess)
        kept = self.acceptable(refined, guess)
        kept &= refined.zncc >= (floor if np.isscalar(floor) else np.asarray(floor)[known])
        if np.isfinite(within):
            kept &= np.linalg.norm(refined.positions - guess[:, :2], axis=1) <= within
        if steps_from is not None and self.config.max_step is not None:
            step = np.linalg.norm(refined.positions - steps_from[known], axis=1)
            kept &= step <= self.config.max_step
        self.left[points] = refined.reason == _LEFT_IMAGE
        self.keep(points[kept], refined, kept, templates[kept])

    def acceptable(self, refined: Refined, guess: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return which refinements from `guess` (n, 6) can be believed on their own."""
        offset = np.linalg.norm(refined.positions - guess[:, :2], axis=1)
        with np.errstate(invalid="ignore"):
            near = offset <= self.config.max_offset
            # A window that has been turned inside out or shrunk to a dot matches anything.
            change = np.abs(refined.warps[:, 2:] - guess[:, 2:]).max(axis=1)
            sound = change <= _MOST_CHANGE
        return refined.accepted & near & sound

    def keep(
        self,
        points: NDArray[np.intp],
        refined: Refined,
        chosen: NDArray[np.bool_],
        templates: NDArray[np.intp],
    ) -> None:
        """Take the `chosen` rows of `refined` as what was found of `points`."""
        self.found[points] = True
        self.warps[points] = refined.warps[chosen]
        self.quality[points] = refined.zncc[chosen]
        self.sigma[points] = refined.sigma[chosen]
        self.template[points] = templates
