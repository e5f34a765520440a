"""Subset matching by zero-mean normalised correlation, to a small fraction of a pixel.

A template is a square window of a reference image. It is found in another image by the
inverse-compositional Gauss-Newton iteration (Baker & Matthews 2004,
doi:10.1023/B:VISI.0000011205.11775.fd; for the zero-mean normalised sum of squared differences
Pan, Li & Tong 2013, doi:10.1007/s11340-013-9717-6): gradients and Hessian belong to the
template and are computed once.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from openprc.vision.tracking.bspline import PreparedImage
from openprc.vision.tracking.noise import estimate_noise
from openprc.vision.tracking.refinement import Reason, Refined, RefineSettings
from openprc.vision.tracking.subset_kernels import refine
from openprc.vision.tracking.templates import TemplateStore

__all__ = [
    "Correlator",
    "PreparedImage",
    "Reason",
    "RefineSettings",
    "Refined",
    "compose",
    "estimate_noise",
]


def compose(parent_warps: NDArray[Any], warps: NDArray[Any]) -> NDArray[np.float64]:
    """Return the warps from the parents' templates to the image.

    Parameters
    ----------
    parent_warps : (n, 6)
        From a template to the image out of which a second template was cut, at the warped
        position of the same point.
    warps : (n, 6)
        From the second template to the image.
    """
    first = np.asarray(parent_warps, np.float64)
    last = np.array(warps, np.float64)
    f = np.eye(2) + first[:, 2:].reshape(-1, 2, 2)
    g = np.eye(2) + last[:, 2:].reshape(-1, 2, 2)
    last[:, 2:] = (g @ f - np.eye(2)).reshape(-1, 4)
    return last


class Correlator:
    """Templates, and the search for them."""

    def __init__(self, settings: RefineSettings | None = None) -> None:
        self.settings = settings or RefineSettings()
        self._templates = TemplateStore(self.settings.subset)

    def prepare(self, intensity: NDArray[Any]) -> PreparedImage:
        """Make an image readable between its pixels."""
        return PreparedImage(intensity)

    def add_templates(self, image: PreparedImage, points: NDArray[np.float64]) -> NDArray[np.intp]:
        """Keep the windows around points; -1 where one leaves the image or has no texture."""
        return self._templates.add(image, np.asarray(points, np.float64).reshape(-1, 2))

    def refine(
        self, image: PreparedImage, ids: NDArray[np.intp], warps: NDArray[np.float64]
    ) -> Refined:
        """Find templates in an image, starting from guesses of their warps."""
        store, settings = self._templates, self.settings
        ids = np.asarray(ids, np.intp)
        ids = np.where(ids < store.n, ids, -1)
        guesses = np.ascontiguousarray(warps, np.float64).reshape(-1, 6)
        n = len(ids)
        found = np.empty((n, 6))
        zncc, rest, gain = np.empty(n), np.empty(n), np.empty(n)
        reason, iterations = np.empty(n, np.uint8), np.empty(n, np.int32)
        image.require_all()
        refine(
            image.coefficients,
            image.shape,
            ids,
            guesses,
            store.values,
            store.gradient_x,
            store.gradient_y,
            store.offset,
            store.mean,
            store.energy,
            store.mean_jacobian,
            store.value_jacobian,
            store.hessian,
            store.inverse,
            settings.model == "translation",
            settings.max_iterations,
            settings.tolerance,
            settings.max_shift,
            found,
            zncc,
            rest,
            gain,
            reason,
            iterations,
        )
        n_pixels = settings.subset**2
        known = np.where(ids >= 0, ids, 0)
        variance = rest / gain**2 / (n_pixels - 8)
        if store.n:
            inverse = store.inverse[known]
            sigma = np.sqrt(variance[:, None] * inverse[:, [0, 1], [0, 1]])
            noise = store.noise[known]
            gate = np.maximum(
                settings.max_znssd, np.minimum(6.0 * noise**2 * n_pixels / store.energy[known], 1.0)
            )
            with np.errstate(invalid="ignore"):
                reason[(reason == Reason.ACCEPTED) & ~(2.0 * (1.0 - zncc) <= gate)] = (
                    Reason.BELOW_GATE
                )
        else:
            sigma = np.full((n, 2), np.nan)
        return Refined(
            warps=found,
            zncc=zncc,
            sigma=sigma,
            accepted=reason == Reason.ACCEPTED,
            reason=reason,
            iterations=iterations,
        )
