"""Patterns in closed form: grey level and its gradient at any place, never interpolated."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

Values = NDArray[np.float64]

#: A table of so many cells repeats; at 4.5 px a cell every 1152 px.
_PERIOD = 256


class Texture(Protocol):
    """Grey levels over the plane of the body."""

    def sample(self, x: Values, y: Values, *, blur: float = 0.0) -> tuple[Values, Values, Values]:
        """Return value and gradient (d/dx, d/dy) [grey levels, grey levels / px] at places [px].

        `blur` [px] is the sigma of a Gaussian that the pattern is convolved with.
        """
        ...


@dataclass(frozen=True, kw_only=True)
class Speckle:
    """Bright and dark Gaussian blobs of normally distributed height in a jittered grid.

    Parameters
    ----------
    contrast : float
        Root mean square about the mean [grey levels].
    mean : float
        [grey levels]
    sigma : (float, float)
        Range of the blobs' sigma [px].
    cell : float
        One blob in every square of this side [px].
    seed : int
    """

    contrast: float = 30.0
    mean: float = 128.0
    sigma: tuple[float, float] = (1.2, 2.2)
    cell: float = 4.5
    seed: int = 0

    @cached_property
    def blobs(self) -> Values:
        """The table (rows, columns, [x, y, amplitude, sigma]), amplitudes scaled to contrast."""
        rng = np.random.default_rng(self.seed)
        table = np.empty((_PERIOD, _PERIOD, 4))
        table[..., :2] = rng.uniform(0.0, 1.0, (_PERIOD, _PERIOD, 2))
        table[..., 2] = rng.standard_normal((_PERIOD, _PERIOD))
        table[..., 3] = rng.uniform(*self.sigma, (_PERIOD, _PERIOD))
        # Blobs of random weight are shot noise: Campbell's theorem gives the variance,
        # density times the integral of the squared blob, pi sigma^2.
        table[..., 2] *= self.contrast / np.sqrt(np.pi * (table[..., 3] ** 2).mean() / self.cell**2)
        return table

    def sample(self, x: Values, y: Values, *, blur: float = 0.0) -> tuple[Values, Values, Values]:
        """Return value and gradient at places [px]; see `Texture`."""
        from openprc.vision.synth.blob_kernel import (  # noqa: PLC0415 - loads the compiler
            evaluate_blobs,
        )

        flat_x, flat_y = (np.ascontiguousarray(a, np.float64).ravel() for a in (x, y))
        value, slope_x, slope_y = (np.empty(flat_x.size) for _ in range(3))
        # Six sigma: what is left out is below 1e-7 of a blob.
        reach = int(np.ceil(6.0 * np.hypot(self.sigma[1], blur) / self.cell))
        evaluate_blobs(flat_x, flat_y, self.blobs, self.cell, reach, blur, value, slope_x, slope_y)
        shape = np.shape(x)
        return (
            self.mean + value.reshape(shape),
            slope_x.reshape(shape),
            slope_y.reshape(shape),
        )


@dataclass(frozen=True, kw_only=True)
class MiuraFacets:
    """A zig-zag folding pattern: bright and dark facets, dark creases, and a fine grain.

    Parameters
    ----------
    facet : (float, float)
        Width and height of a facet [px].
    rise : float
        How far a horizontal crease rises and falls [px].
    contrast : float
        Of the facets about the mean [grey levels].
    crease : (float, float)
        Depth [grey levels] and sigma [px] of the dark lines.
    grain : Speckle, optional
        Its mean is not used.
    mean : float
    """

    facet: tuple[float, float] = (56.0, 44.0)
    rise: float = 14.0
    contrast: float = 28.0
    crease: tuple[float, float] = (45.0, 1.5)
    grain: Speckle | None = None
    mean: float = 128.0
    seed: int = 0

    def sample(self, x: Values, y: Values, *, blur: float = 0.0) -> tuple[Values, Values, Values]:
        """Return value and gradient at places [px]; see `Texture`.

        Raises
        ------
        ValueError
            With a blur: edges and lines have no closed form under it.
        """
        if blur:
            raise ValueError("MiuraFacets has no closed form under a blur; use Speckle")
        width, height = self.facet
        # The zig-zag is a rounded triangular wave, so that the pattern is smooth everywhere.
        k = np.pi / width
        sine, cosine = np.sin(k * x), np.cos(k * x)
        round_off = 0.995
        zig = self.rise * 2.0 / np.pi * np.arcsin(round_off * cosine)
        zig_x = (
            -self.rise * 2.0 / np.pi * round_off * k * sine
            / np.sqrt(1.0 - (round_off * cosine) ** 2)
        )  # fmt: skip
        m = np.pi / height
        phase = m * (y - zig)
        depth, sigma = self.crease
        sharp = 12.0
        upright, upright_slope = np.tanh(sharp * sine), sharp * k * cosine
        level, level_slope = np.tanh(sharp * np.sin(phase)), sharp * m * np.cos(phase)
        value = self.mean + self.contrast * upright * level
        along_x = self.contrast * (1.0 - upright**2) * upright_slope * level
        by_phase = self.contrast * upright * (1.0 - level**2) * level_slope
        # Distance from a crease, as far as it is small: sine over wave number.
        a, b = sine / k, np.sin(phase) / m
        dark_a = depth * np.exp(-0.5 * (a / sigma) ** 2)
        dark_b = depth * np.exp(-0.5 * (b / sigma) ** 2)
        value = value - dark_a - dark_b
        along_x = along_x + dark_a * a / sigma**2 * cosine
        by_phase = by_phase + dark_b * b / sigma**2 * np.cos(phase)
        slope_x, slope_y = along_x - by_phase * zig_x, by_phase
        grain = self.grain or Speckle(contrast=6.0, sigma=(1.2, 1.6), seed=self.seed)
        fine, fine_x, fine_y = grain.sample(x, y)
        return value + fine - grain.mean, slope_x + fine_x, slope_y + fine_y


def speckle(**settings: object) -> Speckle:
    """Return a `Speckle`; keywords are its fields."""
    return Speckle(**settings)  # type: ignore[arg-type]


def miura(**settings: object) -> MiuraFacets:
    """Return `MiuraFacets`; keywords are its fields."""
    return MiuraFacets(**settings)  # type: ignore[arg-type]
