"""Windows of reference images, with everything about them that does not change."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from openprc.vision.tracking.bspline import BORDER, PreparedImage
from openprc.vision.tracking.noise import local_noise

__all__ = ["TemplateStore"]

#: Sum of the squares of the gradient filter: variance of the gradient in white noise of one.
#: Across: (1 - z-transform) of the spline's derivative at the pixels, computed below.
_MARGIN = 2


class TemplateStore:
    """Template data in arrays that grow.

    The values f of a window, their gradient, and for the warp parameters (px, py, a, b, c, d)
    the Hessian of the normalised differences with gain and offset projected out
    (Baker & Matthews 2004, doi:10.1023/B:VISI.0000011205.11775.fd).
    """

    def __init__(self, subset: int) -> None:
        self.subset = subset
        self.n = 0
        side = subset
        self.values = np.empty((0, side, side), np.float32)
        self.gradient_x = np.empty((0, side, side), np.float32)
        self.gradient_y = np.empty((0, side, side), np.float32)
        self.offset = np.empty((0, 2))  # first pixel of the window, from the tracked point
        self.points = np.empty((0, 2))
        self.mean = np.empty(0)
        self.energy = np.empty(0)  # sum of (f - mean)^2
        self.noise = np.empty(0)
        self.mean_jacobian = np.empty((0, 12))
        self.value_jacobian = np.empty((0, 12))  # sum of J f, over the energy
        self.hessian = np.empty((0, 12, 12))
        self.inverse = np.empty((0, 6, 6))

    _NAMES = (
        "values",
        "gradient_x",
        "gradient_y",
        "offset",
        "points",
        "mean",
        "energy",
        "noise",
        "mean_jacobian",
        "value_jacobian",
        "hessian",
        "inverse",
    )

    def _reserve(self, n: int) -> None:
        if n <= len(self.mean):
            return
        room = max(n, 2 * len(self.mean))
        for name in self._NAMES:
            old = getattr(self, name)
            new = np.empty((room, *old.shape[1:]), old.dtype)
            new[: self.n] = old[: self.n]
            setattr(self, name, new)

    def add(self, image: PreparedImage, points: NDArray[np.float64]) -> NDArray[np.intp]:
        """Cut out the windows around points; -1 where that cannot be done."""
        ids = np.full(len(points), -1, np.intp)
        half = self.subset // 2
        height, width = image.shape
        with np.errstate(invalid="ignore"):
            corner = np.rint(points) - half
            inside = (
                np.isfinite(points).all(axis=1)
                & (corner >= 0).all(axis=1)
                & (corner + self.subset <= (width, height)).all(axis=1)
            )
        candidates = np.flatnonzero(inside)
        if not candidates.size:
            return ids
        points, corner = points[candidates], corner[candidates].astype(np.int64)
        last = corner + self.subset
        image.require(
            np.stack([corner[:, 0] - 2, last[:, 0] + 1, corner[:, 1] - 2, last[:, 1] + 1], axis=1)
        )
        around = np.arange(-1, self.subset + 1)
        c = image.coefficients[
            corner[:, 1, None, None] + around[:, None] + BORDER,
            corner[:, 0, None, None] + around + BORDER,
        ].astype(np.float64)
        smooth_y = (c[:, :-2] + 4.0 * c[:, 1:-1] + c[:, 2:]) / 6.0
        smooth_x = (c[:, :, :-2] + 4.0 * c[:, :, 1:-1] + c[:, :, 2:]) / 6.0
        gradient_x = (smooth_y[:, :, 2:] - smooth_y[:, :, :-2]) / 2.0
        gradient_y = (smooth_x[:, 2:] - smooth_x[:, :-2]) / 2.0
        inner = np.arange(self.subset)
        f = image.intensity[
            corner[:, 1, None, None] + inner[:, None], corner[:, 0, None, None] + inner
        ].astype(np.float64)
        mean = f.mean(axis=(1, 2))
        f -= mean[:, None, None]
        energy = np.einsum("nji,nji->n", f, f)
        offset = corner - points
        noise = local_noise(f)

        n_pixels = self.subset**2
        dx = (offset[:, 0, None] + inner)[:, None, :] * np.ones((1, self.subset, 1))
        dy = (offset[:, 1, None] + inner)[:, :, None] * np.ones((1, 1, self.subset))
        powers = np.stack([np.ones_like(dx), dx, dy, dx * dx, dx * dy, dy * dy], axis=1)
        jacobian = np.concatenate(
            [gradient_x[:, None] * powers, gradient_y[:, None] * powers], axis=1
        ).reshape(len(f), 12, n_pixels)
        flat = f.reshape(len(f), n_pixels, 1)
        mean_jacobian = jacobian.mean(axis=2)
        with np.errstate(invalid="ignore", divide="ignore"):
            value_jacobian = (jacobian @ flat)[:, :, 0] / energy[:, None]
            hessian = (
                jacobian @ jacobian.transpose(0, 2, 1)
                - n_pixels * mean_jacobian[:, :, None] * mean_jacobian[:, None, :]
                - energy[:, None, None] * value_jacobian[:, :, None] * value_jacobian[:, None, :]
            )
        affine = np.array([0, 6, 1, 2, 7, 8])
        small = hessian[:, affine[:, None], affine]
        good = np.isfinite(hessian).all(axis=(1, 2)) & np.isfinite(energy) & (energy > 0.0)
        scale = np.sqrt(np.einsum("nii->ni", np.where(good[:, None, None], small, 1.0)))
        good &= (scale > 0.0).all(axis=1)
        scaled = np.where(good[:, None, None], small, np.eye(6)) / np.where(
            good[:, None, None], scale[:, :, None] * scale[:, None, :], 1.0
        )
        good &= np.linalg.eigvalsh(scaled)[:, 0] > 1e-6
        keep = np.flatnonzero(good)
        inverse = np.linalg.inv(small[keep])
        slots = np.arange(self.n, self.n + keep.size)
        self._reserve(self.n + keep.size)
        for name, value in (
            ("values", f),
            ("gradient_x", gradient_x),
            ("gradient_y", gradient_y),
            ("offset", offset),
            ("points", points),
            ("mean", mean),
            ("energy", energy),
            ("noise", noise),
            ("mean_jacobian", mean_jacobian),
            ("value_jacobian", value_jacobian),
            ("hessian", hessian),
        ):
            getattr(self, name)[slots] = value[keep]
        self.inverse[slots] = inverse
        self.n += keep.size
        ids[candidates[keep]] = slots
        return ids
