"""Windows of reference images, with everything about them that does not change."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from openprc.vision.tracking.bspline import BORDER, PIXEL_DERIVATIVE, PreparedImage
from openprc.vision.tracking.noise import local_noise
from openprc.vision.tracking.uncertainty import GradientNoise, Gradients, Normal, normal_equations

__all__ = ["TemplateArrays", "TemplateStore"]

#: Windows that are worked on at once.
BLOCK = 512
#: Derivative of a Gaussian of 0.7 px, and the Gaussian across. Noise of the gradient is noise
#: of the position, so the gradient by which differences are weighed is a smoothed one.
_TAPS = np.arange(-2, 3)
_ACROSS = np.exp(-(_TAPS**2) / (2.0 * 0.7**2))
_ACROSS /= _ACROSS.sum()
_ALONG = _TAPS * _ACROSS
_ALONG /= (_TAPS * _ALONG).sum()
_NOISE_GAIN = GradientNoise(
    smooth=float((_ALONG**2).sum() * (_ACROSS**2).sum()),
    mixed=float(_ACROSS[2] * (_ALONG * PIXEL_DERIVATIVE[_TAPS + len(PIXEL_DERIVATIVE) // 2]).sum()),
)


class TemplateArrays(NamedTuple):
    """Template data as the kernels want them: one row for each template."""

    values: NDArray[np.float32]
    gradient_x: NDArray[np.float32]
    gradient_y: NDArray[np.float32]
    offset: NDArray[np.float64]
    mean: NDArray[np.float64]
    energy: NDArray[np.float64]
    floor: NDArray[np.float64]
    mean_jacobian: NDArray[np.float64]
    value_jacobian: NDArray[np.float64]
    to_translation: NDArray[np.float64]
    to_affine: NDArray[np.float64]
    to_quadratic: NDArray[np.float64]
    weight_a: NDArray[np.float64]
    weight_q: NDArray[np.float64]
    pull_a: NDArray[np.float64]
    pull_q: NDArray[np.float64]
    variance: NDArray[np.float64]


def _windows(
    field: NDArray[np.generic], corner: NDArray[np.int64], side: int, margin: int = 0
) -> NDArray[np.float64]:
    around = np.arange(-margin, side + margin)
    rows = corner[:, 1, None, None] + around[:, None]
    columns = corner[:, 0, None, None] + around
    return field[rows, columns].astype(np.float64)


def _gradients(
    image: PreparedImage, corner: NDArray[np.int64], side: int
) -> tuple[Gradients, Gradients]:
    """Return the smoothed gradient in windows, and that of the spline through the pixels."""
    height, width = image.shape
    around = np.arange(-2, side + 2)
    rows, columns = corner[:, 1, None] + around, corner[:, 0, None] + around
    # Mirrored about the edge of the image, as the spline is.
    rows = (height - 1) - np.abs((height - 1) - np.abs(rows))
    columns = (width - 1) - np.abs((width - 1) - np.abs(columns))
    pixels = image.intensity[rows[:, :, None], columns[:, None, :]].astype(np.float64)
    wide = sliding_window_view(pixels, 5, axis=2)
    smooth = (
        sliding_window_view(wide @ _ALONG, 5, axis=1) @ _ACROSS,
        sliding_window_view(wide @ _ACROSS, 5, axis=1) @ _ALONG,
    )
    image.require(np.concatenate([corner, corner + side], axis=1)[:, [0, 2, 1, 3]])
    c = _windows(image.coefficients, corner + BORDER, side, margin=1)
    middle = slice(1, -1)
    across_y = (c[:, :-2] + 4.0 * c[:, middle] + c[:, 2:]) / 6.0
    across_x = (c[:, :, :-2] + 4.0 * c[:, :, middle] + c[:, :, 2:]) / 6.0
    exact = (
        (across_y[:, :, 2:] - across_y[:, :, :-2]) / 2.0,
        (across_x[:, 2:] - across_x[:, :-2]) / 2.0,
    )
    return smooth, exact


class TemplateStore:
    """Templates, numbered in the order in which they came."""

    def __init__(self, subset: int) -> None:
        self.subset = subset
        self.n = 0
        s = subset
        shapes: dict[str, tuple[int, ...]] = {
            "values": (s, s),
            "gradient_x": (s, s),
            "gradient_y": (s, s),
            "offset": (2,),
            "mean": (),
            "energy": (),
            "floor": (),
            "mean_jacobian": (12,),
            "value_jacobian": (12,),
            "to_translation": (2, 2),
            "to_affine": (6, 6),
            "to_quadratic": (12, 12),
            "weight_a": (4, 4),
            "weight_q": (6, 6),
            "pull_a": (2, 4),
            "pull_q": (6, 6),
            "variance": (3, 2),
        }
        single = ("values", "gradient_x", "gradient_y")
        self.arrays = TemplateArrays(
            **{
                name: np.empty((0, *shape), np.float32 if name in single else np.float64)
                for name, shape in shapes.items()
            }
        )
        self.noise = np.empty(0)

    def _reserve(self, n: int) -> None:
        room = len(self.noise)
        if n <= room:
            return
        more = max(n, 2 * room) - room
        self.arrays = TemplateArrays(
            *(
                np.concatenate([old, np.empty((more, *old.shape[1:]), old.dtype)])
                for old in self.arrays
            )
        )
        self.noise = np.concatenate([self.noise, np.empty(more)])

    def add(self, image: PreparedImage, points: NDArray[np.float64]) -> NDArray[np.intp]:
        """Cut out the windows around points; -1 where that cannot be done."""
        # What is worked out on the way takes a hundred times the room of a window.
        parts = [self._add(image, points[k : k + BLOCK]) for k in range(0, len(points), BLOCK)]
        return np.concatenate(parts) if parts else np.zeros(0, np.intp)

    def _add(self, image: PreparedImage, points: NDArray[np.float64]) -> NDArray[np.intp]:
        ids = np.full(len(points), -1, np.intp)
        side = self.subset
        height, width = image.shape
        corner = np.rint(points) - side // 2
        with np.errstate(invalid="ignore"):
            inside = (corner >= 0).all(axis=1) & (corner + side <= (width, height)).all(axis=1)
        candidates = np.flatnonzero(inside)
        if not candidates.size:
            return ids
        points, corner = points[candidates], corner[candidates].astype(np.int64)
        f = _windows(image.intensity, corner, side)
        mean = f.mean(axis=(1, 2))
        f -= mean[:, None, None]
        noise = local_noise(f)
        offset = corner - points
        smooth, exact = _gradients(image, corner, side)
        normal = normal_equations(
            f,
            mean=mean,
            smooth=smooth,
            exact=exact,
            offset=offset,
            noise=noise,
            gain=_NOISE_GAIN,
        )
        keep = np.flatnonzero(normal.good)
        slots = np.arange(self.n, self.n + keep.size)
        self._reserve(self.n + keep.size)
        # Rounding to whole grey levels is noise too, even where there is no other.
        floor = 1.0 / 12.0 if image.intensity.dtype.kind in "ui" else 0.0
        self.arrays.offset[slots] = offset[keep]
        self.arrays.values[slots] = f[keep]
        self.arrays.mean[slots] = mean[keep]
        self.arrays.floor[slots] = floor
        self.noise[slots] = noise[keep]
        for name in Normal._fields:
            if name != "good":
                getattr(self.arrays, name)[slots] = getattr(normal, name)[keep]
        self.n += keep.size
        ids[candidates[keep]] = slots
        return ids
