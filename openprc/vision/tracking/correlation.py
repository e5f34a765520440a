"""Subset matching by zero-mean normalised correlation, to a small fraction of a pixel.

A template is a square window of a reference image. It is found in another image by the
inverse-compositional Gauss-Newton iteration (Baker & Matthews 2004,
doi:10.1023/B:VISI.0000011205.11775.fd; for the zero-mean normalised sum of squared differences
Pan, Li & Tong 2013, doi:10.1007/s11340-013-9717-6): gradients and Hessian belong to the
template and are computed once.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from openprc.errors import ConfigError
from openprc.vision.tracking.bspline import NOISE_LEFT, PreparedImage
from openprc.vision.tracking.noise import estimate_noise
from openprc.vision.tracking.refinement import Reason, Refined, RefineSettings
from openprc.vision.tracking.subset_kernels import refine, search_boxes
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

#: Free parameters of each model; "auto" may go on to twelve, or back to two.
_FREE = {"translation": 2, "affine": 6, "quadratic": 12, "auto": 6}
#: Significance, in units of the noise, up to which deformation and curvature are taken for noise.
PENALTY_DEFORMATION = 7.0
PENALTY_CURVATURE = 14.0


class _Out(NamedTuple):
    warps: NDArray[np.float64]
    zncc: NDArray[np.float64]
    sigma: NDArray[np.float64]
    reason: NDArray[np.uint8]
    iterations: NDArray[np.int32]


def _nothing_found(guesses: NDArray[np.float64]) -> _Out:
    n = len(guesses)
    return _Out(
        guesses.copy(),
        np.full(n, np.nan),
        np.full((n, 2), np.nan),
        np.full(n, Reason.NO_TEMPLATE, np.uint8),
        np.zeros(n, np.int32),
    )


def _way(side: int) -> NDArray[np.float64]:
    """Root mean square way of a window's pixels [px] for a unit of each parameter."""
    linear, pure, mixed = side / np.sqrt(12.0), side**2 / np.sqrt(80.0), side**2 / 12.0
    return np.array([1.0, 1.0, *[linear] * 4, *[pure, mixed, pure] * 2])


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
    """Templates, and the search for them.

    A refinement looks at one template and one image only; nothing is carried over from one call
    to the next.

    With the model "auto" a window is matched by an affine warp; where the residual shows
    curvature beyond noise, a quadratic one follows, and where six parameters are too many for
    the noise, the deformation of the guess is kept. What is found of curvature and deformation
    is then drawn towards zero by the factor 1 - (c s² / w)², zero below w = c s², with w their
    significance in units of the noise s², much as the estimator of James and Stein does it
    (doi:10.1007/978-1-4612-0919-5_30). The position follows without a jump.

    ``sigma`` is of the whole error of a position: half of its square comes from the noise of the
    template, which is the same in all frames, half from that of the image. For "auto", where
    deformation or curvature is barely significant, a bias of the order of one sigma remains.
    """

    def __init__(self, settings: RefineSettings | None = None) -> None:
        self.settings = settings or RefineSettings()
        self._templates = TemplateStore(self.settings.subset)

    def prepare(self, intensity: NDArray[Any]) -> PreparedImage:
        """Make an image (H, W) [grey levels] readable between its pixels."""
        return PreparedImage(intensity)

    def add_templates(self, image: PreparedImage, points: NDArray[np.float64]) -> NDArray[np.intp]:
        """Keep the windows around points.

        Parameters
        ----------
        image : PreparedImage
        points : (n, 2) [px]
            Anywhere between the pixels: the windows are of whole pixels, around the nearest.

        Returns
        -------
        (n,)
            Numbers of the templates; -1 where a window leaves the image, has pixels without a
            value, or no texture in some direction.
        """
        return self._templates.add(image, np.asarray(points, np.float64).reshape(-1, 2))

    def refine(
        self, image: PreparedImage, ids: NDArray[np.intp], warps: NDArray[np.float64]
    ) -> Refined:
        """Find templates in an image, starting from guesses of their warps.

        Parameters
        ----------
        image : PreparedImage
        ids : (n,)
            Numbers from `add_templates`; negative ones are answered with a reason.
        warps : (n, 6)
            px, py [px], a, b, c, d, as in `Refined`. NaN and infinity are answered with a reason.
        """
        store, settings = self._templates, self.settings
        ids = np.ascontiguousarray(ids, np.intp).reshape(-1)
        ids = np.where(ids < store.n, ids, -1)
        guesses = np.ascontiguousarray(warps, np.float64)
        if guesses.shape != (len(ids), 6):
            raise ConfigError(
                f"guesses of shape {guesses.shape} for {len(ids)} templates",
                expected=f"({len(ids)}, 6): px, py, a, b, c, d for each",
                fix="give one warp for each template",
            )
        boxes = np.empty((len(ids), 4), np.int64)
        # Half the way again, for the corners of a window that deforms on its way.
        margin = 1.5 * settings.max_shift
        search_boxes(ids, guesses, store.arrays, image.shape, margin, boxes)
        image.require(boxes)
        free = _FREE[settings.model]
        out = _nothing_found(guesses)
        refine(
            image.coefficients,
            image.shape,
            ids,
            guesses,
            boxes,
            store.arrays,
            store.noise,
            (
                free,
                settings.model == "auto",
                (settings.max_iterations, settings.tolerance, settings.max_shift),
                _way(settings.subset),
                PENALTY_DEFORMATION,
                PENALTY_CURVATURE,
            ),
            NOISE_LEFT,
            out,
        )
        if store.n:
            known = np.where(ids >= 0, ids, 0)
            noise, energy = store.noise[known], store.arrays.energy[known]
            # Noise s in both images makes 2 s² n / energy of the difference.
            gate = np.maximum(
                settings.max_znssd, np.minimum(6.0 * noise**2 * settings.subset**2 / energy, 1.0)
            )
            with np.errstate(invalid="ignore"):
                worse = ~(2.0 * (1.0 - out.zncc) <= gate)
                worse |= ~(out.sigma <= settings.max_sigma).all(axis=1)
            out.reason[(out.reason == Reason.ACCEPTED) & worse] = Reason.BELOW_GATE
        return Refined(accepted=out.reason == Reason.ACCEPTED, **out._asdict())
